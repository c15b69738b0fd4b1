"""Comparison of methods: errors compared with closed forms, smallest numbers of steps, and reasons for
missing results."""

import math

import numpy as np
import pytest

import solve
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.methods.choice import METHODS
from solve.studies.compare import compare, usual_steps
from solve.terminal import progress

SPEED = 3.0


def oscillator(stiffness=4.0):
    """System q″ + 0.4 q′ + 4 q = cos φ + cos 5φ."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, stiffness * one, (np.cos(phase) + np.cos(5 * phase))[:, None]

    return solve.PeriodicSystem(matrices, ["q"])


def exact(phase):
    amplitudes = {k: 1.0 / (4.0 - (k * SPEED) ** 2 + 0.4j * k * SPEED) for k in (1, 5)}
    return sum(np.real(a * np.exp(1j * k * phase)) for k, a in amplitudes.items())


def true_errors(method, steps):
    """Errors of orbit and multipliers, compared with closed forms."""
    orbit = solve.periodic(oscillator(), SPEED, method, steps=steps)
    phase = np.linspace(0.0, 2 * math.pi, 4001)
    truth = exact(phase)
    roots = np.roots([1.0, 0.4, 4.0])
    rho = np.exp(roots * 2 * math.pi / SPEED)
    distance = min(np.abs(orbit.multipliers - order).max() for order in (rho, rho[::-1]))
    return np.abs(orbit.at(phase)[0] - truth).max() / np.abs(truth).max(), distance / np.abs(rho[0])


@pytest.fixture(scope="module")
def comparison():
    return compare(oscillator(), SPEED, ["radau", "newmark", "rk4"], steps=[50, 200], targets=[1e-4, 1e-6])


def rows(comparison, at, method=None):
    return [row for row in comparison.rows if row.at == at and method in (None, row.method)]


def test_stated_errors_at_equal_steps_are_the_true_ones(comparison):
    computed = rows(comparison, "equal steps")
    assert [(row.method, row.steps) for row in computed] == [
        (method, steps) for method in ("radau", "newmark", "rk4") for steps in (50, 200)
    ]
    for row in computed:
        if row.method == "radau" and row.steps == 200:
            assert max(row.orbit_error, row.multiplier_error) < 1e-10
            continue
        orbit_error, multiplier_error = true_errors(row.method, row.steps)
        assert row.orbit_error == pytest.approx(orbit_error, rel=0.05), row
        assert row.multiplier_error == pytest.approx(multiplier_error, rel=0.05, abs=1e-12), row
        assert row.time > 0
        assert row.verdict == "asymptotically stable"


def test_target_is_reached_with_the_smallest_number_of_steps(comparison):
    for row in rows(comparison, "equal accuracy"):
        assert row.orbit_error <= row.target
        fewer = math.floor(row.steps / 1.04)
        assert true_errors(row.method, fewer)[0] > row.target, row


def test_required_steps_grow_with_the_order_of_the_method(comparison):
    for method, order in (("newmark", 2), ("rk4", 4)):
        coarse, fine = rows(comparison, "equal accuracy", method)
        assert math.log(coarse.target / fine.target) / math.log(fine.steps / coarse.steps) == pytest.approx(
            order, abs=0.15
        )


def test_reference_states_its_own_error(comparison):
    assert max(comparison.reference.error_estimate) < 1e-11
    assert comparison.warnings == []
    close = compare(oscillator(), SPEED, ["radau"], steps=[50], targets=[1e-13])
    assert "1e-13" in close.warnings[0]


def test_every_registered_method_is_compared(monkeypatch):
    class Renamed(solve.Newmark):
        name = "newcomer"

    monkeypatch.setitem(METHODS, "newcomer", Renamed)
    reported = []
    with progress.listen(lambda tracker: reported.extend(task.what for task in tracker.tasks)):
        comparison = compare(oscillator(), SPEED, steps=[40], targets=[0.05])
    names = [name for name in METHODS if name != "auto"]
    assert "newcomer" in names
    assert [fromkey for fromkey in dict.fromkeys(reported) if fromkey in ("reference", *names)] == [
        "reference",
        *names,
    ]
    assert [row.method for row in rows(comparison, "equal steps")] == names
    assert [row.method for row in rows(comparison, "equal accuracy")] == names
    for row in comparison.rows:
        assert (row.reason is None) == math.isfinite(row.orbit_error), row


def test_unusual_settings_are_stated():
    comparison = compare(oscillator(), SPEED, [solve.Newmark(), solve.Newmark(beta=1 / 6)], [40], [0.1])
    assert [row.method for row in rows(comparison, "equal steps")] == ["newmark", f"newmark beta {1 / 6}"]


def test_steps_beyond_the_stability_limit_give_a_required_minimum():
    stiff = oscillator(stiffness=1e6)
    row = rows(compare(stiff, SPEED, ["rk4"], steps=[100], targets=[0.5]), "equal steps")[0]
    assert math.isnan(row.orbit_error)
    assert row.verdict is None
    assert "with 100 steps" in row.reason
    assert "at least" in row.reason


def test_unattainable_accuracy_is_reported():
    comparison = compare(oscillator(), SPEED, [METHODS["march"](tolerance=0.05)], steps=[100], targets=[1e-6])
    row = rows(comparison, "equal accuracy")[0]
    assert row.steps is None
    assert math.isnan(row.time)
    assert "out of reach" in row.reason


def test_unstable_method_has_an_unstable_verdict():
    row = rows(compare(oscillator(), SPEED, [solve.Newmark(0.0, 0.0)], [6], [0.9]), "equal steps")[0]
    assert row.verdict == "unstable"
    assert any("gamma = 0 < 1/2" in text for text in row.warnings)


def test_steps_too_long_for_the_fastest_mode_are_marked():
    """ω_max h = 2π 100 / (3 · 50) = 4.2. Newmark's method neither resolves nor damps this mode; Radau damps
    it."""
    comparison = compare(
        oscillator(stiffness=1e4), SPEED, ["newmark", "radau"], steps=[50, 400], targets=[0.5]
    )
    followed = {(row.method, row.steps): row.followed for row in rows(comparison, "equal steps")}
    assert followed == {
        ("newmark", 50): False,
        ("newmark", 400): True,
        ("radau", 50): True,
        ("radau", 400): True,
    }


def test_spectral_methods_report_their_step_limit():
    comparison = compare(oscillator(), SPEED, ["fourier", "hill"], steps=[5000], targets=[0.5])
    for row in rows(comparison, "equal steps"):
        assert row.reason == "takes at most 1000 steps per period for n = 1"


def test_without_load_the_multipliers_reach_the_targets():
    def free(phase, speed):
        M, C, K, d = oscillator()._matrices(phase, speed)
        return M, C, K, 0 * d

    comparison = compare(
        solve.PeriodicSystem(free, ["q"]), SPEED, ["newmark", "rk4"], steps=[50], targets=[1e-4]
    )
    assert comparison.judged_by == "multipliers"
    for row in comparison.rows:
        assert math.isnan(row.orbit_error)
        assert row.multiplier_error == pytest.approx(true_errors(row.method, row.steps)[1], rel=0.05)
        assert row.at == "equal steps" or row.multiplier_error <= 1e-4


def test_usual_steps_bracket_the_resolution_of_the_fastest_mode():
    assert usual_steps(oscillator(stiffness=1e4), SPEED) == [100, 200, 500, 1000]
    assert usual_steps(oscillator(stiffness=1e8), 1.0) == [50_000, 100_000, 200_000, 500_000]


def test_invalid_input_is_refused():
    with pytest.raises(UnknownNameError, match="newmark"):
        compare(oscillator(), SPEED, ["newmrak"])
    with pytest.raises(ValueOutOfBoundsError, match="steps is 0"):
        compare(oscillator(), SPEED, ["rk4"], steps=[0])
    with pytest.raises(ValueOutOfBoundsError, match="rtol is 0"):
        compare(oscillator(), SPEED, ["rk4"], targets=[0.0])
