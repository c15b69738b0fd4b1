"""Natural frequencies by element type (Figs. 4.6 and 5.3 of the thesis)."""

import json

import numpy as np
import pytest

import solve
from models.four_bar.studies.modes import element_kinds
from solve.errors import ValueOutOfBoundsError


@pytest.fixture(scope="module")
def kinds():
    return element_kinds(solve.load("four_bar"), ["cubic:1", "cubic:3", "dynamic:1"], turn=6)


def test_every_element_type_equals_the_model_with_that_option(kinds):
    single = solve.load("four_bar", options={"elements": 3})
    np.testing.assert_array_equal(kinds.values[1], single.frequencies(kinds.positions, 4))
    assert kinds.freedoms == (9, 27, 9)


def test_finite_element_frequencies_converge_from_above(kinds):
    errors = kinds.mean_errors
    assert (errors[0] > errors[1]).all()
    assert (errors[1] > 0).all()
    np.testing.assert_array_equal(errors[2], 0.0)


def test_figure_has_one_panel_per_frequency(kinds):
    axes = [place for place in kinds.plot().axes if place.lines]
    assert [len(place.lines) for place in axes] == [3] * 4
    np.testing.assert_array_equal(axes[1].lines[0].get_ydata()[:-1], kinds.values[0, :, 1])


def test_command_prints_the_means_of_the_thesis(answer, tmp_path):
    out, _ = answer("elements", "--json", "--kinds", "cubic:1,dynamic:1", "--plot", str(tmp_path / "k.png"))
    rows = json.loads(out)["kinds"]
    assert rows[0]["means"] == pytest.approx([184.085, 363.082, 577.383, 867.215], abs=5e-4)
    assert rows[1]["means"] == pytest.approx([166.535, 353.486, 529.454, 682.538], abs=5e-4)
    assert (tmp_path / "k.png").stat().st_size > 10_000
    assert "+10.538 %" in answer("elements", "--kinds", "cubic:1")[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--kinds", "cubic"], "element type is 'cubic'; allowed: KIND:N, such as cubic:3"),
        (["--kinds", "quartic:1"], "unknown value of option element 'quartic'; did you mean 'cubic'?"),
        (["--count", "0"], "0 frequencies at 36 positions; allowed: 1 … 9 at 1 … 3600"),
    ],
)
def test_invalid_input_is_refused_in_one_line(arguments, message, refusal):
    assert refusal("elements", *arguments) == message


def test_invalid_numbers_are_refused_in_python():
    with pytest.raises(ValueOutOfBoundsError, match="0 positions"):
        element_kinds(solve.load("four_bar"), ["cubic:1"], turn=0)
