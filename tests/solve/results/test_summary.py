"""Summaries of results contain the numbers of the result and verdicts in plain words."""

import math
import re

import numpy as np
import pytest

import solve
from solve.results.bands import Band, Bands


def oscillator(damping, stiffness=4.0, load=1.0):
    """Return q″ + damping q′ + stiffness q = load cos φ."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, damping * one, stiffness * one, load * np.cos(phase)[:, None]

    return solve.PeriodicSystem(matrices, ["q"])


@pytest.mark.parametrize(
    ("damping", "words"),
    [
        # |ρ| = exp(−π · damping / Ω): both multipliers are a pair.
        (0.2, "asymptotically stable: perturbations decay by a factor "
              f"{math.exp(-0.2 * math.pi):.3g} per period"),
        (-0.2, f"unstable: perturbations grow by a factor {math.exp(0.2 * math.pi):.4g} per period"),
    ],
)  # fmt: skip
def test_summary_gives_the_verdict_in_plain_words(damping, words):
    assert words in solve.floquet(oscillator(damping), 1.0).summary


def test_orbit_summary_states_the_maximum():
    # 1/√((4 − 1)² + 0.2²)
    assert solve.periodic(oscillator(0.2), 1.0).summary.endswith(f"max|q| = {1 / math.sqrt(9.04):.3g}.")


def test_linearised_orbit_summary_states_the_linearisation_error():
    orbit = solve.periodic(solve.load("manipulator"), "50 rpm")
    (shown,) = re.findall(r"Estimated linearisation error: ([\d.]+) %", orbit.summary)
    assert float(shown) == pytest.approx(100 * max(orbit.linearisation_error.values()), rel=0.05)
    assert "linearisation" not in solve.nonlinear(solve.load("manipulator"), "50 rpm").summary


@pytest.mark.parametrize(("name", "speed"), [("gear_pair", 300.0), ("mathieu", 1.0), ("coupler", 90.0)])
def test_linear_models_have_no_linearisation_error_above_roundoff(name, speed):
    model = solve.load(name)
    orbit = solve.periodic(model, speed)
    assert orbit.summary.endswith("Estimated linearisation error: none above round-off.")
    assert "nonlinear orbit is the same up to round-off" in str(orbit)
    assert solve.validity(model, [speed]).summary.endswith(
        f"no error above round-off up to {model.labels.speed_unit.text(speed)}."
    )


def test_summary_lists_some_bands_and_counts_the_others():
    system = oscillator(0.2)
    one = [Band(speed, speed + 0.5, "+1", 1.1) for speed in range(1, 7)]
    message = Bands(one[:1], system, (1.0, 9.0), 0.1).summary
    assert message.endswith(f"from {30 / math.pi:.5g} to {45 / math.pi:.5g} rpm.")
    assert Bands(one, system, (1.0, 9.0), 0.1).summary.endswith("rpm and 2 more.")
    assert Bands([], system, (1.0, 9.0), 0.1).summary.startswith("No unstable band found")


def test_summary_states_the_largest_elasticity():
    sensitivities = solve.sensitivities(solve.load("cam"), "600 rpm", "q3.max_abs", ["k1", "F", "speed"])
    sizes = sensitivities.elasticities("q3.max_abs")
    most = max(sizes, key=lambda name: abs(sizes[name]))
    assert f"q3.max_abs by {most} ({sizes[most]:.3g} % per 1 %)" in sensitivities.summary


def test_summary_states_the_highest_maximum():
    """The response of the oscillator is largest at Ω = √(4 − 0.2²/2)."""
    critical = solve.critical_speeds(oscillator(0.2), "1:3:5 rad/s", rtol=1e-6)
    (speed,) = re.findall(r"at ([\d.]+) rad/s", critical.summary)
    assert float(speed) == pytest.approx(math.sqrt(4 - 0.02), rel=1e-4)


@pytest.mark.parametrize(
    "calculate", [solve.frequencies, lambda system: solve.critical_speeds(system, [1, 2])]
)
def test_singular_mass_matrix_is_refused(calculate):
    def massless(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return 0.0 * one, one, one, one[..., 0]

    with pytest.raises(solve.SolveError, match="M is singular"):
        calculate(solve.PeriodicSystem(massless, ["q"]))
