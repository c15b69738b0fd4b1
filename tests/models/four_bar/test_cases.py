"""Case file and checks of the parameters."""

import math
from pathlib import Path

import pytest

import models.four_bar
from solve import case_numbers
from solve.errors import MissingValueError, UnknownNameError, ValueOutOfBoundsError

CASES = Path(models.four_bar.__path__[0]) / "cases.toml"

TABLE_41 = {
    "L1": 0.170, "L2": 0.328, "L3": 0.525, "L4": 0.547,
    "A1": 157.5e-6, "A2": 85.5e-6, "A3": 78.75e-6,
    "I1": 520.47e-12, "I2": 83.34e-12, "I3": 65.12e-12,
    "h1": 6.35e-3, "h2": 3.42e-3, "h3": 3.15e-3,
    "E": 210e9, "rho": 7850.0, "mA": 0.174, "mB": 0.174, "zeta": 0.02,
}  # fmt: skip
"""Thesis Table 4.1, the thicknesses of Table 3.2, ζ = 2 %."""


def test_table_41_is_the_default():
    computed = case_numbers("four_bar")
    assert computed.name == "table41"
    assert computed.speed is None
    assert computed.parameters == pytest.approx(TABLE_41, rel=1e-14)


def test_table_32_has_sections_of_its_widths_and_thicknesses():
    values = case_numbers("four_bar", "table32").parameters
    for k, (width, thickness) in enumerate(((24.8, 6.35), (25, 3.42), (25, 3.15)), start=1):
        assert values[f"A{k}"] == pytest.approx(width * thickness * 1e-6, rel=1e-9)
        assert values[f"I{k}"] == pytest.approx(width * thickness**3 / 12 * 1e-12, rel=1e-6)
        assert values[f"h{k}"] == pytest.approx(thickness * 1e-3)
    assert values["mA"] == values["mB"] == 0.0


def test_printed_second_moment_differs_from_the_section():
    """Table 4.1 of the thesis prints 520.47e-12 m⁴, but the section in Table 3.2 has 529.17e-12 m⁴. The other
    values agree."""
    printed, derived = (case_numbers("four_bar", case).parameters for case in ("table41", "table32"))
    assert printed["I1"] / derived["I1"] == pytest.approx(0.98357, abs=1e-5)
    assert printed["I2"] / derived["I2"] == pytest.approx(1.0, abs=1e-4)
    assert printed["I3"] / derived["I3"] == pytest.approx(1.0, abs=1e-4)


def test_values_can_be_replaced():
    assert case_numbers("four_bar", parameters={"L2": 0.4}).parameters["L2"] == 0.4


@pytest.mark.parametrize("name", TABLE_41)
def test_values_out_of_bounds_are_refused(name):
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueOutOfBoundsError, match=rf"{name} \(.*\) is .*allowed: >"):
            case_numbers("four_bar", parameters={name: wrong})


def test_unknown_names_are_refused():
    with pytest.raises(UnknownNameError, match=r"unknown case of four_bar 'table14'"):
        case_numbers("four_bar", "table14")
    with pytest.raises(UnknownNameError, match="unknown parameter of four_bar 'roh'; did you mean 'rho'"):
        case_numbers("four_bar", parameters={"roh": 1.0})


def test_missing_value_is_rejected(tmp_path):
    text = CASES.read_text(encoding="utf-8")
    file = tmp_path / "mine.toml"
    file.write_text("\n".join(line for line in text.splitlines() if not line.startswith("rho")))
    with pytest.raises(MissingValueError, match=r"no value for rho; .*: rho=NUMBER"):
        case_numbers("four_bar", cases=file)
    assert case_numbers("four_bar", cases=file, parameters={"rho": 2700.0}).parameters["rho"] == 2700.0
