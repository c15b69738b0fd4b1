"""The page that follows a number through the packages names each package once, in the order of the calls."""

import re
import sys
from pathlib import Path

import pytest

import solve
from solve.commands.app import run
from solve.kernel.library import trouble

PAGE = (Path(__file__).parents[2] / "docs" / "walk.md").read_text("utf-8")
PARTS = {path.stem for path in Path(solve.__file__).parent.iterdir() if path.is_dir() or path.suffix == ".py"}
BOTTOM = {
    "approximation",
    "arguments",
    "array_files",
    "arrays",
    "contracts",
    "errors",
    "labels",
    "matrices",
    "op4",
    "terminal",
    "threads",
    "units",
}
STOPS = [
    (package, name)
    for package, names in re.findall(r"^\d+\. \*\*(\w+)\*\*, ((?:`\w+`,? ?)+)\.", PAGE, re.MULTILINE)
    for name in re.findall(r"\w+", names)
]


def test_page_is_short_and_names_each_package_once():
    assert len(PAGE.splitlines()) <= 60
    named = re.findall(r"\*\*(\w+)\*\*", PAGE)
    assert sorted(named) == sorted(PARTS - BOTTOM - {"__init__", "__main__", "__pycache__", "public"})


@pytest.mark.skipif(bool(trouble()), reason=trouble() or "compiles")
def test_command_calls_functions_in_the_order_of_the_page(capsys):
    """The order is that of the first calls of the functions and classes that the page names."""
    entered: dict[tuple[str, str], None] = {}
    folder = str(Path(solve.__file__).parent)

    def note(frame, event, argument):
        if event == "call" and frame.f_code.co_filename.startswith(folder):
            package = Path(frame.f_code.co_filename).relative_to(folder).parts[0].removesuffix(".py")
            name = frame.f_code.co_qualname.replace(".__init__", "").split(".")[-1]
            entered.setdefault((package, name))

    sys.setprofile(note)
    try:
        status = run(["periodic", "cam", "--speed", "600 rpm", "--set", "k1=9e4"])
    finally:
        sys.setprofile(None)
    assert status == 0
    assert "k1" in capsys.readouterr().out
    assert [stop for stop in entered if stop in STOPS] == STOPS
