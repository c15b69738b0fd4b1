"""The table on the page about methods agrees with the attributes of the methods."""

import re
from pathlib import Path

import pytest

from solve.commands.app import run
from solve.methods.choice import METHODS, chosen

PAGE = Path(__file__).parents[3] / "docs" / "methods.md"
ROWS = {
    row[0].strip(" `"): [cell.strip() for cell in row[1:]]
    for row in (re.split(r"(?<!\\)\|", line)[1:-1] for line in PAGE.read_text("utf-8").splitlines())
    if row and row[0].strip().strip("`") in METHODS
}


def test_every_method_has_its_row():
    assert set(ROWS) == set(METHODS)


@pytest.mark.parametrize("name", [name for name in METHODS if name not in ("auto", "fourier", "hill")])
def test_table_matches_orders_and_l_stability_of_each_method(name):
    method = chosen(name)
    orders, keeps_out, follows, *_ = ROWS[name]
    if method.order == 0:
        assert orders == "none"
    elif name != "march":
        assert orders.startswith(f"{method.order}, {method.curve_order}")
    assert keeps_out.startswith("yes" if method.l_stable else "no")
    if follows != "π":
        assert float(follows.split()[0].rstrip(";")) == method.follows


@pytest.mark.parametrize(("name", "place"), [("cam", 0), ("four_bar", 1)])
def test_page_states_the_step_limit_of_fourier(name, place, capsys):
    """For 3 and for 27 coordinates."""
    most = re.search(r"limits of `--steps` are half as large, (\d+) and (\d+)", PAGE.read_text("utf-8"))
    elements = ("--option", "elements=3") if name == "four_bar" else ()
    given = ("floquet", name, "--speed", "286 rpm", *elements, "--method", "fourier", "--steps")
    assert run([*given, str(int(most[1 + place]) + 1)]) == 2
    assert f"takes at most {most[1 + place]} steps" in capsys.readouterr().err
