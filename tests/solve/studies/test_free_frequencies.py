"""Natural frequencies of systems with rigid-body or growing modes: values, studies and fits."""

import numpy as np
import pytest

import solve
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.results.frequencies import Findings
from tests.solve.studies.free_trains import (
    HERTZ,
    bearing,
    masses,
    squares_of_masses,
    train,
)


def test_rigid_body_mode_of_a_free_train_is_labelled():
    frequencies = solve.frequencies(train(), count=5)
    np.testing.assert_allclose(frequencies.values[0] / (2 * np.pi), HERTZ, rtol=1e-9, atol=0)
    (mode,) = frequencies.rigid_body_modes
    assert (mode.vector, mode.damped) == ((1.0,) * 5, False)
    record = Findings(frequencies).record()
    assert record["frequencies"][0] == 0.0
    assert record["growth_rates"] == [None] * 5
    assert record["rigid_body_modes"][0]["vector"] == [1.0] * 5
    assert "mode 1 is a rigid-body mode, a1 : a2 : a3 : a4 : a5 = 1 : 1 : 1 : 1 : 1" in repr(
        Findings(frequencies)
    )
    assert "0, 81.21, 141.2, 379, 536.4 Hz" in Findings(frequencies).summary


@pytest.mark.parametrize(
    ("discs", "count", "title"),
    [(5, None, ": the lowest 4 of 5"), (8, 7, ": the lowest 6 of 8"), (3, None, "")],
)
def test_frequency_table_reports_the_number_of_omitted_modes(discs, count, title):
    frequencies = solve.frequencies(train([0.1] * discs, [50.0] * (discs - 1)), count=count)
    assert f"Frequencies over a revolution, rad/s{title}\n" in repr(frequencies).replace(" \n", "\n")


def test_first_frequency_of_three_discs_is_always_zero():
    """The other frequencies follow from the closed form for three equal inertias J: J λ = k1 + k2 ± √(k1² +
    k2² − k1 k2)."""
    k1, k2, J = np.linspace(40, 60, 21), 50.0, 0.1
    discs = train([J] * 3, [50.0, k2])
    variation = solve.frequencies_over(discs, "k1", k1, np.zeros(1))
    root = np.sqrt(k1**2 + k2**2 - k1 * k2)
    assert (variation.mean[:, 0] == 0).all()
    np.testing.assert_allclose(variation.mean[:, 1], np.sqrt((k1 + k2 - root) / J), rtol=1e-12)
    np.testing.assert_allclose(variation.mean[:, 2], np.sqrt((k1 + k2 + root) / J), rtol=1e-12)
    assert variation.shown_modes == [0, 1]


def test_negative_spring_stiffness_does_not_renumber_the_modes():
    k1 = np.linspace(-3, 3, 13)
    low, high = squares_of_masses(k1)
    variation = solve.frequencies_over(masses(), "k1", k1, np.zeros(1))
    np.testing.assert_allclose(
        variation.mean[:, 0], np.where(low > 0, np.sqrt(np.abs(low)), np.nan), rtol=1e-12
    )
    np.testing.assert_allclose(variation.mean[:, 1], np.sqrt(high), rtol=1e-12)
    rates = variation.largest_growth_rates
    np.testing.assert_allclose(rates[:, 0], np.where(low < 0, np.sqrt(np.abs(low)), np.nan), rtol=1e-12)
    assert np.isnan(rates[:, 1]).all()
    assert variation.summary_values["growth_rates"] is not None
    assert "1.41764i" in repr(variation)
    (warning,) = Findings(solve.frequencies(masses()), variation=variation).warnings
    assert warning == (
        "the static stiffness is not positive at 5 of 13 values of k1: mode 1 grows instead of vibrating, "
        f"at up to {np.sqrt(-low[0]):.4g} 1/s"
    )
    low_edge, _ = variation.plot().axes[0].get_ylim()
    assert low_edge < -np.sqrt(-low[0])


def test_negative_frozen_stiffness_gives_a_growth_rate():
    """At a frozen phase φ, ẍ + (1/2 + cos φ) x = 0 has a growth rate if the bracket is negative, otherwise a
    frequency."""
    mathieu = solve.load("mathieu", delta=0.5, epsilon=1.0)
    positions = np.linspace(0, np.pi, 5, endpoint=False)
    square = 0.5 + np.cos(2 * positions)
    frequencies = solve.frequencies(mathieu, positions)
    np.testing.assert_allclose(
        frequencies.values[:, 0], np.where(square > 0, np.sqrt(np.abs(square)), np.nan)
    )
    np.testing.assert_allclose(
        frequencies.growth_rates[:, 0], np.where(square < 0, np.sqrt(np.abs(square)), np.nan), rtol=1e-12
    )
    table = repr(frequencies)
    assert f"{np.sqrt(-square.min()):.5f}i" in table
    assert next(line for line in table.splitlines() if line.split()[:1] == ["mean"]).split()[1] == "–"
    assert set(frequencies.to_pandas()) == {"position", "frequency1", "growth_rate1"}


def test_error_reports_speed_0_if_a_matrix_is_infinite():
    with pytest.raises(MatricesError, match=r"no finite M, C, K at speed 0.*divides by the speed.*critical"):
        solve.frequencies(bearing())

    def never(phase, speed):
        one = np.full((len(phase), 1, 1), 1.0)
        return one, one, one * np.nan, one[:, 0]

    with pytest.raises(MatricesError, match=r"^K has NaN or infinite entries"):
        solve.frequencies(solve.PeriodicSystem(never, ["x"]))

    def by_python(phase, speed):
        one = np.full((len(phase), 1, 1), 1.0)
        return one, one, one * (1 / speed), one[:, 0]

    with pytest.raises(MatricesError, match="at speed 0"):
        solve.frequencies(solve.PeriodicSystem(by_python, ["x"]))


def frequency_file(path, rows):
    path.write_text("\n".join(["mode (1),frequency (Hz)", *(f"{m},{f:.17g}" for m, f in rows)]) + "\n")
    return path


def test_fit_finds_the_stiffness_of_a_free_train(tmp_path):
    file = frequency_file(tmp_path / "f.csv", [*enumerate(HERTZ, 1)][1:])
    fitted = solve.fit(train(k1=9000.0), file, ["k1"])
    assert fitted.parameters["k1"].value == pytest.approx(12e3, rel=1e-8)


def test_fit_finds_the_stiffness_between_two_free_discs(tmp_path):
    """The natural frequency is ω² = k (1/J1 + 1/J2)."""
    hertz = np.sqrt(2500.0 * (1 / 0.1 + 1 / 0.3)) / (2 * np.pi)
    file = frequency_file(tmp_path / "f.csv", [(2, hertz), (2, hertz * (1 + 1e-9))])
    fitted = solve.fit(train([0.1, 0.3], [900.0]), file, ["k1"])
    assert fitted.parameters["k1"].value == pytest.approx(2500.0, rel=1e-7)


def test_fit_refuses_the_frequency_of_a_rigid_body_mode(tmp_path):
    file = frequency_file(tmp_path / "f.csv", [(at, hertz) for at, hertz in enumerate(HERTZ[1:], 1)])
    with pytest.raises(ValueOutOfBoundsError) as refused:
        solve.fit(train(k1=9000.0), file, ["k1"])
    assert "mode 1 was measured at 81.2076 Hz, but is a rigid-body mode of frequency 0" in str(refused.value)
    assert "counted first; number the elastic modes in the file from 2 on" in str(refused.value)


def test_fit_converges_from_a_start_with_a_growing_mode(tmp_path):
    low, high = squares_of_masses(3.0)
    file = frequency_file(tmp_path / "f.csv", [(1, np.sqrt(low) / 2 / np.pi), (2, np.sqrt(high) / 2 / np.pi)])
    fitted = solve.fit(masses(k1=-3.0), file, ["k1"])
    assert fitted.parameters["k1"].value == pytest.approx(3.0, rel=1e-6)


def test_summary_states_growth_rates_per_second():
    mathieu = solve.load("mathieu", delta=0.5, epsilon=1.0)
    (growing,) = solve.frequencies(mathieu, np.pi / 2).growth_rates[0]
    summary = Findings(solve.frequencies(mathieu, np.pi / 2)).summary
    assert summary.endswith(f"at standstill: none. Growth rates: {growing:.4g} 1/s.")
    assert Findings(solve.frequencies(mathieu)).summary.endswith("at standstill: 0.1949 Hz.")
