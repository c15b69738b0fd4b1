"""Sweeps of several systems at the same speeds: oscillators whose responses are known in closed form."""

import numpy as np
import pytest

import solve
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.studies.sweep import sweeps, variants
from solve.system import PeriodicSystem
from solve.terminal import progress

SPEEDS = np.linspace(0.5, 3.5, 61)


def oscillator(zeta):
    """Return the system q″ + 2ζω q′ + ω² q = cos Ωt with ω = 2 rad/s."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 4 * zeta * one, 4 * one, np.cos(phase)[:, None]

    return PeriodicSystem(matrices, ["q"])


def amplitude(zeta, speed):
    return 1 / np.hypot(4 - speed**2, 4 * zeta * speed)


@pytest.fixture(scope="module")
def oscillator_sweeps():
    return sweeps({str(z): oscillator(z) for z in (0.05, 0.2)}, SPEEDS, ["q"], "zeta")


def test_responses_match_the_closed_form(oscillator_sweeps):
    expected = np.array([amplitude(zeta, SPEEDS) for zeta in (0.05, 0.2)])
    assert oscillator_sweeps.figures("q") == pytest.approx(expected, rel=1e-6)
    assert oscillator_sweeps.figures("q", "rms") == pytest.approx(expected / np.sqrt(2), rel=1e-6)


def test_extremes_of_the_first_curve_list_all_responses(oscillator_sweeps):
    (peak,) = oscillator_sweeps.extremes("q")
    assert (peak.speed, peak.kind) == (pytest.approx(2.0), "peak")
    assert peak.responses == pytest.approx([amplitude(zeta, 2.0) for zeta in (0.05, 0.2)], rel=1e-6)


def test_speed_without_a_result_is_no_maximum_or_minimum():
    """Without damping, there is no solution at the resonance, 2 rad/s."""
    oscillator_sweeps = sweeps({"0": oscillator(0.0)}, [1.2, 1.5, 2.0, 2.5, 3.0], ["q"])
    assert np.isnan(oscillator_sweeps.figures("q")[0]).tolist() == [False, False, True, False, False]
    assert [(extreme.speed, extreme.kind) for extreme in oscillator_sweeps.extremes("q")] == [(1.5, "peak")]


def test_figure_has_one_curve_per_system(oscillator_sweeps):
    figure = oscillator_sweeps.plot(["q"])
    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["0.05", "0.2"]
    assert figure.legends[0].get_title().get_text() == "zeta"


def test_one_quantity_may_be_given_as_text():
    oscillator_sweeps = sweeps({"as it is": solve.load("manipulator")}, [3.0, 4.0], "q1")
    assert oscillator_sweeps.quantities == ("q1",)
    assert len(oscillator_sweeps.plot("q1").axes) == len(oscillator_sweeps.plot().axes) == 1


def test_progress_covers_the_points_of_all_curves():
    reported = []
    with progress.listen(lambda tracker: reported.append(tracker.status(0.0).fraction)):
        sweeps({"a": oscillator(0.1), "b": oscillator(0.2)}, [1.0, 1.5], ["q"])
    known = [each for each in reported if each is not None]
    assert known == sorted(known)
    assert {0.5, 1.0} <= set(known)


def test_parameters_and_options_may_vary_together():
    coupler = solve.load("coupler")
    lengths = variants(coupler, "l3", [0.7, "0.8"])
    assert {label: each.parameters["l3"] for label, each in lengths.items()} == {"0.7": 0.7, "0.8": 0.8}
    assert [variant.n for variant in variants(coupler, "modes", ["1", "4"]).values()] == [1, 4]


def test_variants_that_differ_in_the_seventh_digit_are_distinguished():
    values = [0.7, 0.7000001, 0.7000002]
    oscillator_sweeps = variants(solve.load("coupler"), "l3", values)
    assert [each.parameters["l3"] for each in oscillator_sweeps.values()] == values
    assert [float(label) for label in oscillator_sweeps] == values


@pytest.mark.parametrize(
    ("name", "values", "error", "message"),
    [
        ("l33", [1.0], UnknownNameError, "did you mean 'l3'"),
        ("l3", ["long"], ValueOutOfBoundsError, "l3 is 'long'; give a number, such as 1.5, in m"),
        ("l3", [0.7, 0.7], ValueOutOfBoundsError, "twice"),
        ("l3", [0.7, "0.70"], ValueOutOfBoundsError, "twice"),
        ("modes", [2, "2"], ValueOutOfBoundsError, "twice"),
        ("modes", ["40"], ValueOutOfBoundsError, "allowed"),
    ],
)
def test_invalid_variants_are_refused(name, values, error, message):
    with pytest.raises(error, match=message):
        variants(solve.load("coupler"), name, values)


def test_empty_variants_are_refused():
    with pytest.raises(ValueOutOfBoundsError, match="at least one"):
        sweeps({}, [1.0], ["q"])
