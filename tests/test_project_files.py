"""Files that maintainers and other programs expect: versions, citation, hooks, schemas, llms.txt."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

from solve.commands.app import run
from tests.pages import DOCS, EVERY, ROOT

yaml = pytest.importorskip("yaml")
jsonschema = pytest.importorskip("jsonschema")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]
SCHEMAS = sorted((DOCS / "schemas").glob("*.json"))
LINES = [
    "periodic cam --speed '600 rpm' --harmonics 2 --rtol 1e-4 --json",
    "periodic mathieu --set delta=1.3 --json",
    "periodic coupler --speed '600 rpm' --nonlinear --rtol 1e-4 --json",
    "floquet gear_pair --json",
    "floquet mathieu --set delta=1 --set epsilon=0.5 --json",
    "sweep cam --speed '300 rpm' --over k1=7e4:9e4:2 --json",
    "sweep coupler --speed '300 rpm' --over l2=0.05:1:2 --json",
]
RECIPES = re.findall(r"^\| [^|]+\| `(solve [^`]*--json)`", (DOCS / "for_scripts.md").read_text("utf-8"), re.M)


def loaded(name):
    return yaml.safe_load((ROOT / name).read_text("utf-8"))


def test_all_files_state_the_project_version():
    stated = PROJECT["project"]["version"]
    assert version("parametric-vibration") == stated
    assert loaded("CITATION.cff")["version"] == stated
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert re.search(r"^## (\d+\.\d+\.\d+)", changes, flags=re.MULTILINE)[1] == stated


def test_citation_has_the_keys_that_its_format_requires():
    """The format is Citation File Format 1.2.0: cff-version, message, title and authors."""
    citation = loaded("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert citation["title"] == PROJECT["project"]["name"]


@pytest.mark.parametrize("package", ["solve", "derive"])
def test_packages_have_the_marker_of_type_information(package):
    """The marker is py.typed (PEP 561)."""
    assert (ROOT / package / "py.typed").is_file()


def test_hooks_use_tools_of_the_development_environment():
    tools = {re.split(r"[\[<>= ]", each)[0] for each in EXTRAS["dev"]} | {"lint-imports", "python"}
    checks = re.sub(r'"\$(?:bin/|python\b)|"', "", (ROOT / ".ci" / "run").read_text("utf-8"))
    (repository,) = loaded(".pre-commit-config.yaml")["repos"]
    for hook in repository["hooks"]:
        assert hook["entry"].split()[0] in tools
        assert hook["entry"].removeprefix("python ") in checks, hook


def test_public_host_runs_the_checks_with_every_python_version():
    jobs = loaded(".github/workflows/checks.yml")["jobs"]
    assert {"run": "bash .ci/run"} in jobs["all"]["steps"]
    tested = jobs["quick"]["strategy"]["matrix"]["python-version"]
    oldest = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert tested == [oldest, "3.12", "3.13", "3.14"]
    extras = re.search(r"\.\[([\w,]+)\]", str(jobs["quick"]["steps"]))[1].split(",")
    assert set(extras) <= EXTRAS.keys()


def test_every_file_of_the_live_page_is_in_the_package():
    """The wheel contains whole packages. The files of the page are in one of them."""
    page = ROOT / "solve" / "views" / "live" / "page"
    assert {file.suffix for file in page.iterdir()} == {".css", ".html", ".js"}
    assert "solve" in PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]


def test_links_of_llms_txt_lead_to_pages():
    targets = re.findall(r"\]\(([^)]+)\.html\)", (DOCS / "llms.txt").read_text("utf-8"))
    assert len(targets) > 10
    assert {DOCS / f"{target}.md" for target in targets} <= set(EVERY)


def test_schemas_are_valid():
    assert [file.stem for file in SCHEMAS] == ["floquet", "periodic", "sweep"]
    for file in SCHEMAS:
        jsonschema.Draft202012Validator.check_schema(json.loads(file.read_text("utf-8")))


@pytest.mark.parametrize("line", LINES)
def test_output_has_the_keys_of_its_schema(line, capsys):
    assert run(shlex.split(line)) == 0
    found = json.loads(capsys.readouterr().out)
    validated(line.split()[0], found)


def validated(command, found):
    schema = json.loads((DOCS / "schemas" / f"{command}.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(schema).validate(found)


def test_schema_refuses_output_without_a_key(capsys):
    assert run(shlex.split(LINES[3])) == 0
    found = json.loads(capsys.readouterr().out)
    del found["error_estimate"]
    with pytest.raises(jsonschema.ValidationError, match="'error_estimate' is a required property"):
        validated("floquet", found)


def test_output_in_an_older_encoding_is_unchanged():
    """The encoding is that of a pipe on Windows."""
    words = ["floquet", "mathieu", "--method", "newmark", "--steps", "4", "--json"]
    command = [sys.executable, "-m", "solve", *words]

    def printed(encoding):
        environment = {**os.environ, "PYTHONIOENCODING": encoding}
        ran = subprocess.run(command, env=environment, capture_output=True, check=True)
        return json.loads(ran.stdout.decode(encoding))

    assert "ω" in printed("utf-8")["warnings"][0]
    assert printed("cp1252") == printed("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("line", RECIPES)
def test_recipe_prints_one_object_with_the_listed_keys(line, capsys):
    assert run(shlex.split(line)[1:]) == 0
    out = capsys.readouterr().out
    found = json.loads(out)
    assert out.count("\n") == 1
    row = next(row for row in (DOCS / "for_scripts.md").read_text("utf-8").splitlines() if f"`{line}`" in row)
    for key in re.findall(r"`([a-z_]+)[^`]*`", row.split("|")[3]):
        assert key in found, (line, key)


def test_recipes_are_found():
    assert len(RECIPES) >= 9
    assert Path(DOCS / "for_scripts.md").is_file()
