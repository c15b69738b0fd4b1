"""Tables in case files: fitted series, and all kinds of invalid tables."""

import numpy as np
import pytest

import solve
from derive import Mechanism, rate
from solve.errors import CaseFileError, SolveError, UnitError, UnknownNameError
from solve.model.cases import read_cases
from solve.model.tables import Series

SERIES = {
    "P": Series("P", "cosine-sine", False, "P", "Pa", "Pb", 3),
    "U": Series("U", "cosine-sine", True, "", "a", "b", 3),
    "k": Series("k", "amplitude-phase", False, "k0", "k", "gamma", 3),
    "e": Series("e", "amplitude-phase", False, "", "e", "alpha", 3),
}
UNITS = {"P": "Pa", "k0": "N/m"}
for _k in (1, 2, 3):
    UNITS |= {f"Pa{_k}": "Pa", f"Pb{_k}": "Pa", f"a{_k}": "m", f"b{_k}": "m"}
    UNITS |= {f"k{_k}": "N/m", f"gamma{_k}": "rad", f"e{_k}": "m", f"alpha{_k}": "rad"}
UNEVEN = np.array([300, 10, 33.5, 61, 88, 120, 151, 199, 240, 265, 340, 221.0])


@pytest.fixture
def read(tmp_path):
    """Return a function that reads the first case of a file with this entry and a table with these rows."""

    def reading(entry, rows, header="angle (deg),value (Pa)"):
        text = "\n".join([header, *(",".join(map(str, row)) for row in rows)])
        (tmp_path / "mine.csv").write_text(text, encoding="utf-8")
        (tmp_path / "mine.toml").write_text(f"[case.1.parameters]\n{entry}", encoding="utf-8")
        return read_cases(tmp_path / "mine.toml", UNITS, SERIES)["1"]

    return reading


def entry(name, unit, harmonics=3, angle="deg"):
    columns = f'["angle ({angle})", "value ({unit})"]'
    return f'"{name}" = {{ table = "mine.csv", columns = {columns}, harmonics = {harmonics} }}'


def rows(function, degrees=UNEVEN):
    return zip(degrees, function(np.radians(degrees)), strict=True)


def test_fitted_series_equals_the_tabulated_series(read):
    def pressure(x):
        return 20 + 3 * np.cos(x) - 0.5 * np.sin(x) + 0.25 * np.sin(3 * x)

    case = read(entry("P", "bar"), rows(pressure), "angle (deg),value (bar)")
    expected = {"P": 20, "Pa1": 3, "Pa2": 0, "Pa3": 0, "Pb1": -0.5, "Pb2": 0, "Pb3": 0.25}
    assert case.parameters == {
        name: pytest.approx(1e5 * value, rel=1e-12, abs=1e-6) for name, value in expected.items()
    }
    fit = case.fits["P"]
    x = np.linspace(0, 7, 20)
    np.testing.assert_allclose(fit.at(x), 1e5 * pressure(x), rtol=1e-12)
    assert fit.sentence.startswith("P is fitted to mine.csv with 3 harmonics: deviation up to ")


def test_lift_and_slope_tables_give_the_same_series(read):
    """The lift is 5 + 2 cos x + sin 2x and the slope −2 sin x + 2 cos 2x. The mean is not included."""
    lift = read(entry("U", "mm"), rows(lambda x: 5 + 2 * np.cos(x) + np.sin(2 * x)), "angle (deg),value (mm)")
    slope = read(
        entry("U'", "mm"), rows(lambda x: -2 * np.sin(x) + 2 * np.cos(2 * x)), "angle (deg),value (mm)"
    )
    for case in (lift, slope):
        computed = [case.parameters[name] for name in ("a1", "a2", "a3", "b1", "b2", "b3")]
        np.testing.assert_allclose(computed, [0, 2e-3, 0, -2e-3, 0, 0], atol=1e-15)


def test_series_may_use_amplitudes_and_phase_angles(read):
    def stiffness(x):
        return 4 + 2 * np.cos(x + 0.3) + 0.5 * np.cos(2 * x - 1.1)

    case = read(entry("k", "N/mm", 2), rows(stiffness), "angle (deg),value (N/mm)")
    assert case.parameters["k0"] == pytest.approx(4e3)
    assert [case.parameters[f"k{i}"] for i in (1, 2, 3)] == pytest.approx([2e3, 5e2, 0])
    assert [case.parameters[f"gamma{i}"] for i in (1, 2, 3)] == pytest.approx([0.3, -1.1, 0])
    error = read(entry("e", "m", 1), rows(lambda x: np.cos(x - 2)), "angle (deg),value (m)")
    assert error.parameters.keys() == {f"{name}{i}" for name in ("e", "alpha") for i in (1, 2, 3)}
    assert (error.parameters["e1"], error.parameters["alpha1"]) == (pytest.approx(1), pytest.approx(-2))


def test_fit_error_equals_the_omitted_harmonics(read):
    """At evenly spaced angles, harmonics are orthogonal. The fit error is therefore the sum of the omitted
    harmonics."""
    degrees = np.arange(0.0, 360, 10)
    case = read(entry("P", "Pa", 1), rows(lambda x: np.sin(x) + 0.1 * np.cos(4 * x), degrees))
    assert abs(case.fits["P"].errors).max() == pytest.approx(0.1, rel=1e-9)
    assert "with 1 harmonic: deviation up to 0.1 Pa" in case.fits["P"].sentence
    assert "rms 0.0707 Pa" in case.fits["P"].sentence


def test_semicolons_additional_columns_and_repeated_endpoints_are_accepted(read, tmp_path):
    radians = np.linspace(-np.pi, np.pi, 13)
    lines = [f"{i};{x!r};{np.cos(x)}" for i, x in enumerate(radians.tolist())]
    (tmp_path / "other.csv").write_text("row;angle (rad);p (Pa)\n" + "\n\n".join(lines), encoding="utf-8")
    text = 'P = { table = "other.csv", columns = ["angle (rad)", "p (Pa)"], source = "bench" }'
    case = read(text, [])
    assert case.parameters["Pa1"] == pytest.approx(1)
    assert case.fits["P"].harmonics == 3


GOOD = [(x, 1.0) for x in range(0, 360, 30)]


@pytest.mark.parametrize(
    ("text", "table", "error", "message"),
    [
        (entry("P", "Pa"), GOOD[:6], CaseFileError, "has 6 rows; 3 harmonics require 7 or more"),
        (
            entry("P", "Pa"),
            [(x, 1.0) for x in range(0, 230, 10)],
            CaseFileError,
            "does not cover the revolution: no row between 220 deg and 360 deg; this gap is not shorter than "
            "half a period of harmonic 3",
        ),
        (
            entry("P", "Pa"),
            [(x, 1.0) for x in range(0, 190, 10)],
            CaseFileError,
            "does not cover the revolution",
        ),
        (
            entry("P", "Pa"),
            [*GOOD, (90, 2)],
            CaseFileError,
            "has the angle 90 deg twice; give each angle once",
        ),
        (entry("P", "Pa"), [*GOOD, (390, 2)], CaseFileError, "covers 390 deg; give one revolution, 360 deg"),
        (
            entry("P", "Pa"),
            [*GOOD, (345, "nan")],
            CaseFileError,
            "has 'nan' in the row '345, nan'; give finite",
        ),
        (entry("P", "Pa"), [*GOOD, (345, "x")], CaseFileError, "has 'x' in the row"),
        (entry("P", "Pa"), [*GOOD, (345,)], CaseFileError, "has '' in the row '345'"),
        (
            entry("P", "Pa"),
            [*GOOD, (345, 2, 5)],
            CaseFileError,
            "more values than columns in the row '345, 2, 5'",
        ),
        (entry("P", "Pa"), [], CaseFileError, "has 0 rows; 3 harmonics require 7 or more"),
        (
            entry("P", "Pa").replace("value", "valve"),
            GOOD,
            CaseFileError,
            r"no column 'valve \(Pa\)'; one is required, and its header has: angle \(deg\), value \(Pa\)",
        ),
        (entry("P", "bar"), GOOD, CaseFileError, r"no column 'value \(bar\)'"),
        (entry("P", "Pa").replace(" (Pa)", ""), GOOD, CaseFileError, "column 'value' has no unit"),
        (entry("P", "kg"), GOOD, UnitError, r"P: column 'value \(kg\)': unit 'kg' does not convert to 'Pa'"),
        (entry("P", "Pa", angle="m"), GOOD, UnitError, "unit 'm' does not convert to 'rad'"),
        (entry("P", "Pa", 4), GOOD, CaseFileError, "harmonics = 4; allowed: 1 … 3, as declared"),
        (entry("P", "Pa", "1.5"), GOOD, CaseFileError, "harmonics = 1.5; allowed"),
        (entry("P", "Pa", "true"), GOOD, CaseFileError, "harmonics = True; allowed"),
        (
            entry("P'", "Pa"),
            GOOD,
            CaseFileError,
            "P' cannot be fitted, because its coefficients follow from P; give a table of P",
        ),
        (entry("PP", "Pa"), GOOD, UnknownNameError, "unknown series in mine.toml 'PP'; did you mean 'P'"),
        (entry("P", "Pa").replace("harm", "ham"), GOOD, UnknownNameError, "'hamonics'; did you mean 'harm"),
        (entry("P", "Pa").replace("mine", "none"), GOOD, CaseFileError, "cannot be read .no such file"),
        (entry("P", "Pa").replace("mine.csv", "."), GOOD, CaseFileError, "is not a file; give a CSV file"),
        (
            'P = { table = "mine.csv" }',
            GOOD,
            CaseFileError,
            "P in mine.toml requires a table and two columns",
        ),
        ('P = { table = 3, columns = ["a", "b"] }', GOOD, CaseFileError, "requires a table and two columns"),
        (
            entry("P", "Pa") + '\nPa2 = { value = 1, unit = "Pa", source = "x" }',
            GOOD,
            CaseFileError,
            "Pa2 in mine.toml is given twice, the second time by Pa2",
        ),
    ],
)
def test_invalid_tables_are_refused_in_one_line(read, text, table, error, message):
    with pytest.raises(error, match=message) as refused:
        read(text, table)
    assert isinstance(refused.value, SolveError)
    assert "\n" not in str(refused.value)


def test_case_values_replace_common_fitted_series(read, tmp_path):
    read("", GOOD)
    numbers = 'P = { value = 7, unit = "Pa", source = "x" }'
    common = entry("P", "Pa")
    (tmp_path / "two.toml").write_text(
        f"[common.parameters]\n{common}\n[case.fitted]\n[case.own.parameters]\n{numbers}\n", encoding="utf-8"
    )
    cases = read_cases(tmp_path / "two.toml", UNITS, SERIES)
    assert (list(cases["fitted"].fits), list(cases["own"].fits)) == (["P"], [])
    assert cases["own"].parameters["P"] == 7


def follower():
    mine = Mechanism("follower", "Spring follower of a cam")
    q = mine.coordinate("q", "m", "deflection")
    m, k = mine.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"))
    U = mine.transmission("U", harmonics=4, unit="mm")
    mine.kinetic = m * rate(U(mine.phase) + q) ** 2 / 2
    mine.potential = k * q**2 / 2
    return mine


def test_declared_series_are_in_the_generated_module():
    model = solve.load(follower, m=1, k=1e5, **{f"{x}{i}": 0.0 for x in "ab" for i in range(1, 5)})
    assert model.module.SERIES == (("U", "cosine-sine", True, "", "a", "b", 4),)
    assert model.fits == {}
