"""Live page of twenty models: models of the package with moving parts, and mechanism files from the
documentation."""

import re
import shlex
from itertools import pairwise

import pytest

import solve
from derive.command import run as derive
from tests.pages import DOCS

pytestmark = pytest.mark.slow
pytest.importorskip("tornado", reason="the live window needs the extra `explore`")

PACKAGE = ["cam", "coupler", "four_bar", "gear_backlash", "gear_pair", "manipulator", "mathieu", "meissner"]
TEXT = "".join((DOCS / f"{page}.md").read_text("utf-8") for page in ("machines", "own_mechanism"))
FILES = dict(re.findall(r"```python\n# (\w+)\.py\n(.*?)```", TEXT, re.DOTALL))
LINES = dict(re.findall(r"^python -m solve \w+ (\w+)\.py (.*--set.*)$", TEXT, re.MULTILINE))
OWN = [name for name in FILES if "--case" not in LINES.get(name, "--case")][:12]


def stated(name):
    """Return the parameter values and the initial speed of a command printed on a page."""
    words = shlex.split(LINES[name])
    pairs = dict(pairwise(words))
    speed = pairs.get("--speed") or re.sub(r":[^ ]*", "", pairs["--speeds"])
    return dict(re.findall(r"(\w+)=(\S+)", " ".join(words))), speed


def loaded(name, folder):
    """Return a model of the package, or of a file that is written and derived."""
    if name in PACKAGE:
        return solve.load(name), None
    (folder / f"{name}.py").write_text(FILES[name], encoding="utf-8")
    assert not derive([f"{name}.py"])
    values, speed = stated(name)
    return solve.load(f"{name}.py", **values), speed


@pytest.mark.parametrize("name", [*PACKAGE, *OWN])
def test_live_page_of_a_model_follows_its_sliders(name, chromium, folder):
    model, speed = loaded(name, folder)
    live = solve.explore(model, speed)
    try:
        tab = chromium.open(live.address)
        drawn = "Number(document.documentElement.dataset.drawn || 0)"
        tab.wait(drawn)
        slider = "document.querySelector('.control:nth-child(2) input[type=range]')"
        before = tab.evaluate(drawn)
        tab.evaluate(f"{slider}.value = 520; {slider}.dispatchEvent(new Event('input'))")
        tab.wait(f"{drawn} > {before}")
        orbit = solve.periodic(live.model, live.speed)
        assert dict(live.model.parameters) != dict(model.parameters)
        assert tab.text("#fault") == ""
        assert tab.text("#verdict") == orbit.verdict
        assert tab.evaluate("[...document.querySelectorAll('.curve .line')].every(e => e.getAttribute('d'))")
        assert tab.errors == []
    finally:
        live.close()


def test_twenty_models_are_tested():
    assert len({*PACKAGE, *OWN}) == 20
