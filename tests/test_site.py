"""Documentation site, as far as it can be checked without building it: links, table of contents, entries of
all public names."""

import inspect
import pkgutil
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import derive
import derive.errors
import solve
import solve.errors
import solve.results
from solve.methods.choice import METHODS
from solve.results.result import Result
from tests import pages

ENTRIES = "".join(page.read_text("utf-8") for page in (pages.DOCS / "api").glob("*.md"))
NAMED = set(re.findall(r"\b(?:solve|derive)(?:\.\w+)+", ENTRIES))
EXECUTED = [page for page in pages.EVERY if "```console\n" in page.read_text("utf-8")]


@pytest.mark.parametrize("page", pages.EVERY, ids=lambda page: page.name)
def test_relative_links_have_a_target(page):
    for link in pages.links(page):
        assert link.target.exists(), link
        assert not link.anchor or link.anchor in pages.anchors(link.target), link


def test_broken_link_is_detected(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# One, two: `three`\n[a](#one-two-three) [b](no.md) ![c](#one)\n```\n[d](x)\n# e\n```\n")
    assert [(link.target.name, link.anchor) for link in pages.links(page)] == [
        ("page.md", "one-two-three"),
        ("no.md", ""),
        ("page.md", "one"),
    ]
    assert pages.anchors(page) == {"one-two-three"}


def test_every_page_is_in_the_table_of_contents():
    notebooks = pages.DOCS.glob("notebooks/*.ipynb")
    assert {*pages.EVERY, *notebooks} - pages.of_the_site() == set()


@pytest.mark.parametrize("package", [solve, derive])
def test_every_public_name_has_its_entry(package):
    assert {f"{package.__name__}.{name}" for name in package.__all__} - NAMED == set()


def test_every_public_name_has_a_docstring():
    """Without a docstring, a dataclass would have its signature instead."""
    for name in solve.__all__:
        docstring = inspect.getdoc(getattr(solve, name)) or ""
        assert docstring, name
        assert not docstring.startswith(f"{name}("), name


def test_every_result_and_method_has_its_entry():
    modules = pkgutil.iter_modules(solve.results.__path__, "solve.results.")
    imported = [import_module(module.name) for module in modules]
    results = [var for module in imported for var in vars(module).values() if inspect.isclass(var)]
    requested = {result for result in results if issubclass(result, Result)}
    requested |= {method for method in METHODS.values() if inspect.isclass(method)}
    assert len(requested) > 25
    for each in requested:
        assert {f"{each.__module__}.{each.__name__}", f"solve.{each.__name__}"} & NAMED, each


def test_every_error_has_its_entry():
    for module in (solve.errors, derive.errors):
        assert f"automodule:: {module.__name__}" in ENTRIES
        classes = [
            var
            for var in vars(module).values()
            if getattr(var, "__module__", "") == module.__name__ and inspect.isclass(var)
        ]
        assert len(classes) > 10
        assert all(class_.__doc__ for class_ in classes)


def digits(text: str) -> tuple[str, list[float]]:
    """Return a text without its numbers and without padding that depends on their widths, and the numbers."""
    number = r"[-±]?\d+(?:\.\d+)?(?:e[-+]\d+)?"
    return re.sub(r"[\s─]+", " ", re.sub(number, "#", text)), [
        float(each.lstrip("±")) for each in re.findall(number, text)
    ]


def test_machine_dependent_output_is_removed_from_pages(tmp_path):
    page = tmp_path / "page.md"
    docstring = "derive: 10 s so far: 0 of 1 mechanisms", "compiling figures", "wrote a.png"
    page.write_text("```console\n$ printf '%s\\n' " + " ".join(f"'{each}'" for each in docstring) + "\n```\n")
    subprocess.run([sys.executable, str(pages.DOCS / "extensions" / "executed.py"), page], check=True)
    assert page.read_text().splitlines()[2:] == ["wrote a.png", "```"]


@pytest.mark.slow
@pytest.mark.parametrize("page", EXECUTED, ids=lambda page: page.name)
def test_page_matches_the_output_of_its_commands(page, tmp_path):
    """The comparison is word by word. Numbers may differ by rounding, and error estimates of this size depend
    on the machine."""
    copy = shutil.copy(page, tmp_path)
    subprocess.run([sys.executable, str(pages.DOCS / "extensions" / "executed.py"), copy], check=True)
    (words, expected), (now, found) = (digits(each.read_text("utf-8")) for each in (page, Path(copy)))
    assert now == words
    for one, other in zip(expected, found, strict=True):
        assert other == pytest.approx(one, rel=1e-3, abs=1e-6)


@pytest.mark.slow
def test_kernels_of_the_site_start_without_a_warning(tmp_path):
    """Kernels are started with the configuration of the site."""
    pytest.importorskip("myst_nb", reason="the site needs the extra `docs`")
    code = "import runpy, sys; runpy.run_path(sys.argv[1]); " + KERNEL
    run = [sys.executable, "-c", code, str(pages.DOCS / "conf.py")]
    ran = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("3\n", "")


KERNEL = """
import nbformat, nbclient
notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 + 2")])
print(nbclient.NotebookClient(notebook).execute().cells[0].outputs[0].data["text/plain"])
"""
