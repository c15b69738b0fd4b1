"""Output feedback: gains as parameters, delay, resonators, optimal gains, and stability margins."""

import numpy as np
import pytest

import solve
from solve.errors import (
    ControlError,
    MissingValueError,
    NoDerivativeError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.labels import Labels
from solve.period.named import Named
from solve.system import relabelled

SPEED = 2.0


def varying_oscillator():
    """q̈ + 0.1 q̇ + (4 + cos φ) q = cos φ + 2 u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (4 + np.cos(phase))[:, None, None]
        return one, 0.1 * one, stiffness, np.cos(phase)[:, None], 2 * one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


def test_constant_gains_are_added_to_the_matrices():
    loop = solve.OutputFeedback(varying_oscillator(), ["q", "q_dot"]).varied(
        {"u_by_q": 3.0, "u_by_q_dot": 0.5}
    )
    _, C, K, _ = loop.at(np.array([0.0]), SPEED)
    assert K[0, 0, 0] == 4 + 1 + 2 * 3.0
    assert C[0, 0, 0] == 0.1 + 2 * 0.5
    orbit = solve.periodic(loop, SPEED)
    phase = np.linspace(0, 6, 7)
    u = orbit.signal("u")(phase)
    assert np.allclose(
        u, -3.0 * orbit.at(phase)[0] - 0.5 * SPEED * orbit.certified.solutions.curve[0](phase, 1)[0]
    )


@pytest.mark.parametrize(("delay", "sections"), [(0.05, 1), (0.2, 3)])
def test_delayed_outputs_equal_earlier_outputs(delay, sections):
    loop = solve.OutputFeedback(varying_oscillator(), ["q"], delay=delay, sections=sections)
    orbit = solve.periodic(loop.varied({"u_by_q": 0.7}), SPEED, rtol=1e-10)
    phase = np.linspace(0, 6, 13)
    late = -orbit.signal("u")(phase) / 0.7
    exact = orbit.signal("q")(phase - SPEED * delay)
    # Padé's error (ωτ)⁵/720 of each section, for the first four harmonics.
    assert np.abs(late - exact).max() < 8 * sections * (4 * SPEED * delay / sections) ** 5 / 720
    assert np.abs(orbit.signal("q")(phase) - exact).max() > 100 * np.abs(late - exact).max()


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_notch_filters_as_its_transfer_function(delay):
    loop = solve.OutputFeedback(varying_oscillator(), ["q"], delay=delay, notches=["2 rad/s"])
    orbit = solve.periodic(loop.varied({"u_by_q": 0.7}), SPEED, rtol=1e-10)
    angles = np.arange(64) * (2 * np.pi / 64)
    q, u = (np.fft.rfft(orbit.signal(name)(angles))[:4] for name in ("q", "u"))
    s = 1j * SPEED * np.arange(4)
    exact = -0.7 * q * (s**2 + 4) / (s**2 + 2 * s + 4) * np.exp(-s * delay)
    # The harmonic 1 has the frequency of the notch; Padé's error (ωτ)⁵/720 is 3e-6 at harmonic 3.
    assert np.abs(u - exact).max() < (1e-8 if not delay else 1e-5) * np.abs(q).max()
    assert np.abs(u[1]) < 1e-8 * np.abs(q[1])


def test_invalid_notch_frequencies_are_refused():
    for frequency in (0, -1.0, "18", "3 kg", float("nan")):
        with pytest.raises(ValueOutOfBoundsError, match="notch is"):
            solve.OutputFeedback(varying_oscillator(), ["q"], notches=[frequency])


def test_resonator_suppresses_its_harmonic():
    loop = solve.OutputFeedback(varying_oscillator(), ["q"], resonators=[1])
    without = solve.periodic(loop, SPEED).harmonics("q")[0][1]
    assert (
        np.abs(solve.periodic(loop.varied({"u_by_q_res1_dot": -0.3}), SPEED).harmonics("q")[0][1])
        < 0.2 * without
    )


OF = ("q1.rms", "u.max_abs", "spectral_radius", "u.harmonic2", "load_torque.rms")


def test_derivatives_of_gains_agree_with_differences():
    loop = solve.OutputFeedback(
        solve.load("manipulator"), ["q1_dot"], harmonics=1, delay="0.5 ms", resonators=[2]
    )
    loop = loop.varied({"u_by_q1_dot": 100.0, "u_by_q1_dot_cos1": 20.0, "u_by_q1_dot_res2": 30.0})
    by = ["u_by_q1_dot", "u_by_q1_dot_cos1", "u_by_q1_dot_res2", "u_by_q1_dot_res2_dot"]
    found = solve.sensitivities(loop, "50 rpm", of=OF, by=by)

    def values(name, step):
        orbit = solve.periodic(loop.varied({name: loop.gains[name] + step}), "50 rpm", rtol=1e-11)
        return np.array([float(Named.parse(loop, text).value(orbit)) for text in OF])

    for at, name in enumerate(by):
        differences = (values(name, 0.1) - values(name, -0.1)) / 0.2
        exact = np.array([found.found[text].derivatives[at] for text in OF])
        sizes = np.array([np.abs(found.found[text].derivatives).max() for text in OF])
        assert (np.abs(exact - differences) < 1e-5 * sizes).all()


@pytest.mark.slow
def test_optimal_damping_of_an_oscillator_is_critical():
    """The spectral radius of q̈ + c q̇ + 4 q is smallest at the critical damping c = 4."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, -0.1 * one, 4 * one, np.zeros((len(phase), 1)), one

    loop = solve.OutputFeedback(solve.PeriodicSystem(matrices, ["q"], inputs=["u"]), ["q_dot"])
    assert solve.floquet(loop, SPEED).verdict == "unstable"
    found = solve.optimise(loop, "spectral_radius", {"u_by_q_dot": (0.0, 10.0)}, SPEED, rtol=1e-8)
    assert found.parameters["u_by_q_dot"].value == pytest.approx(4.1, rel=1e-3)
    assert found.objective == pytest.approx(np.exp(-2 * np.pi), rel=1e-2)


@pytest.mark.slow
def test_constant_gains_halve_the_vibration_within_the_torque_limit():
    loop = solve.OutputFeedback(solve.load("manipulator"), ["q1", "q1_dot"])
    free = {"u_by_q1": (-2e4, 2e4), "u_by_q1_dot": (-2e3, 2e3)}
    found = solve.optimise(loop, "q2.max_abs", free, "70 rpm", subject=["u.max_abs < 280 N m"], rtol=1e-6)
    assert found.objective < found.before / 2
    assert found.confirmed["objective"] < found.before / 2
    assert found.confirmed["verdicts"] == ["asymptotically stable"]


def test_margin_of_a_constant_oscillator_is_set_by_its_damping():
    """q̈ + (0.3 c - 0.1 e) q̇ + 4 q is stable if 3c > e. The stability limit is at the distance √(0.4) from c
    = e = 1, where 3Δc - Δe = -2."""

    class Damped(solve.PeriodicSystem):
        labels = Labels(parameters={"c": 1.0, "e": 1.0})

        def varied(self, parameters=None, options=None):
            return relabelled(self, parameters={**self.labels.parameters, **(parameters or {})})

        def at(self, phase, speed):
            one = np.ones((len(phase), 1, 1))
            damping = 0.3 * self.labels.parameters["c"] - 0.1 * self.labels.parameters["e"]
            return one, damping * one, 4 * one, np.zeros((len(phase), 1))

    found = solve.stability_margin(Damped(np.cos, ["q"]), 1.0, ["c", "e"])
    assert found.distance == pytest.approx(np.sqrt(0.4), rel=1e-3)
    assert found.changes["c"] == pytest.approx(-0.6, rel=1e-2)
    assert found.verdicts == ("asymptotically stable", "unstable")


def test_incompatible_gains_and_systems_are_refused():
    system = varying_oscillator()
    for error, call, words in (
        (ControlError, lambda: solve.OutputFeedback(solve.load("mathieu"), ["q"]), "inputs"),
        (UnknownNameError, lambda: solve.OutputFeedback(system, ["x"]), "x"),
        (MissingValueError, lambda: solve.OutputFeedback(system, []), "measured"),
        (UnknownNameError, lambda: solve.OutputFeedback(system, ["q"]).varied({"k": 1.0}), "k"),
        (
            NoDerivativeError,
            lambda: solve.sensitivities(solve.OutputFeedback(system, ["q"]), 1.0, by=["speed"]),
            "speed",
        ),
        (
            ControlError,
            lambda: solve.stability_margin(solve.load("mathieu", zeta=0.0), 1.0, ["delta"]),
            "asymptotically",
        ),
    ):
        with pytest.raises(error, match=words):
            call()
