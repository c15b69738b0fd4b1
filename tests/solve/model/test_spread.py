"""Spreads of parameters: their text forms, units and entries in case files."""

import numpy as np
import pytest

import solve
from solve.errors import CaseFileError, UnitError, UnknownNameError, ValueOutOfBoundsError
from solve.model.cases import read_cases
from solve.model.spread import spread_of

UNITS = {"k": "N/m", "m": "kg", "a1": "m", "a2": "m"}


@pytest.mark.parametrize(
    ("text", "file_unit", "expected"),
    [
        ("±2 %", None, (False, 196.0, 204.0)),
        ("+/-2%", None, (False, 196.0, 204.0)),
        ("± 0.5 N/mm", None, (False, -300.0, 700.0)),
        ("±0.01", "N/mm", (False, 190.0, 210.0)),
        ("normal(210, 4)", None, (True, 210.0, 4.0)),
        ("normal(0.2 N/mm, 4 N/m)", None, (True, 200.0, 4.0)),
        ("uniform( 0.1 , 0.3 )", "N/mm", (False, 100.0, 300.0)),
    ],
)
def test_spread_text_is_converted_to_the_unit_of_the_model(text, file_unit, expected):
    normal, first, second = spread_of("k", text, 200.0, "N/m", file_unit)[1:]
    assert normal is expected[0]
    assert (first, second) == pytest.approx(expected[1:])


@pytest.mark.parametrize(
    ("text", "value", "error", "message"),
    [
        ("2 %", 1.0, ValueOutOfBoundsError, "write '±2 %'"),
        ("±x %", 1.0, ValueOutOfBoundsError, "without a percentage"),
        ("±2 %", 0.0, ValueOutOfBoundsError, "the range is empty"),
        ("±-1", 1.0, ValueOutOfBoundsError, "the range is empty"),
        ("±nan", 1.0, ValueOutOfBoundsError, "'nan' is not a finite number"),
        ("±3 kg", 1.0, UnitError, "kg"),
        ("normal(1, 0)", 1.0, ValueOutOfBoundsError, "standard deviation > 0"),
        ("normal(1, inf)", 1.0, ValueOutOfBoundsError, "'inf' is not a finite number"),
        ("uniform(2, 1)", 1.0, ValueOutOfBoundsError, "upper end is below its lower end"),
        ("beta(2, 1)", 1.0, ValueOutOfBoundsError, "write '±2 %'"),
        ("", 1.0, ValueOutOfBoundsError, "write '±2 %'"),
    ],
)
def test_invalid_spread_text_is_refused_in_one_line(text, value, error, message):
    with pytest.raises(error, match=message) as caught:
        spread_of("k", text, value, "N/m")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["uniform(70, 90)", "normal(80, 2)"])
def test_values_have_the_stated_distribution_and_slopes(text):
    spread, z = spread_of("k", text, 80.0, "N/m"), np.linspace(-3, 3, 7)
    values = spread.values(z)
    numeric = (spread.values(z + 1e-6) - spread.values(z - 1e-6)) / 2e-6
    np.testing.assert_allclose(spread.slopes(z), numeric, rtol=1e-7)
    assert values[3] == pytest.approx(80.0)
    sample = spread.values(np.random.default_rng(0).standard_normal(100_000))
    assert sample.std() == pytest.approx(20 / np.sqrt(12) if "uniform" in text else 2.0, rel=0.01)


def write(tmp_path, entries):
    file = tmp_path / "cases.toml"
    file.write_text(f"[case.1.parameters]\n{entries}\n", encoding="utf-8")
    return file


def test_case_contains_spreads_in_the_unit_of_the_entry(tmp_path):
    file = write(
        tmp_path,
        'k = { value = 2, unit = "N/mm", source = "s", distribution = "normal(2, 0.1)" }\n'
        'm = { value = 3, unit = "kg", source = "s" }\n'
        'a = { values = [1, 2], unit = "mm", source = "s", tolerance = "±1 %" }',
    )
    case = read_cases(file, UNITS)["1"]
    assert case.spreads == {"k": "normal(2, 0.1)", "a1": "±1 %", "a2": "±1 %"}
    spread = spread_of("k", case.spreads["k"], 2000.0, "N/m", case.units["k"])
    assert (spread.first, spread.second) == (2000.0, pytest.approx(100.0))


def test_replaced_value_keeps_tolerance_but_not_distribution(tmp_path):
    file = write(
        tmp_path,
        'k = { value = 2, unit = "N/mm", source = "s", distribution = "normal(2, 0.1)" }\n'
        'm = { value = 3, unit = "kg", source = "s", tolerance = "±1 %" }',
    )
    case = read_cases(file, UNITS)["1"].replaced({"k": 5.0, "m": 4.0})
    assert case.spreads == {"m": "±1 %"}


@pytest.mark.parametrize(
    ("entry", "error", "message"),
    [
        ('tolerance = "2 %"', CaseFileError, "cases.toml: spread of m is '2 %'"),
        ("tolerance = 2", CaseFileError, "requires exactly one string"),
        ('tolerance = "±1 %", distribution = "normal(1, 1)"', CaseFileError, "requires exactly one string"),
        ('tolerance = "±1 m"', UnitError, "spread of m"),
        ('toleranc = "±1 %"', UnknownNameError, "did you mean 'tolerance'"),
    ],
)
def test_invalid_spreads_in_a_case_file_are_refused(tmp_path, entry, error, message):
    file = write(tmp_path, f'm = {{ value = 3, unit = "kg", source = "s", {entry} }}')
    with pytest.raises(error, match=message):
        read_cases(file, UNITS)


def test_loaded_model_has_the_spreads_of_its_case(tmp_path, capsys):
    from solve.commands.app import run

    file = tmp_path / "cases.toml"
    entry = '{{ value = {}, unit = "{}", source = "s"{} }}\n'
    file.write_text(
        "[case.1.parameters]\n"
        + "delta = "
        + entry.format(1.0, "1/s^2", ', tolerance = "±0.1"')
        + "epsilon = "
        + entry.format(0.3, "1/s^2", "")
        + "zeta = "
        + entry.format(0.05, "1", ""),
        encoding="utf-8",
    )
    line = f"tolerances mathieu --cases {file} --speed 1rad/s --samples 64 --index-samples 0"
    assert run(line.split()) == 0
    assert "±0.1" in capsys.readouterr().out
    assert solve.load("mathieu").setup.case.spreads == {}
