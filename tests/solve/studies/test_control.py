"""Regulators and filters, compared with known solutions, integrated references and closed forms."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import ControlError, MissingValueError, UnknownNameError, ValueOutOfBoundsError
from tests.solve.studies.control_systems import (
    PHASES,
    constant,
    slope_of,
)

MACHINES = (Path(__file__).parents[3] / "docs" / "machines.md").read_text(encoding="utf-8")


def oscillator(load=1.0):
    """q̈ + 0.1 q̇ + 4 q = load cos φ + 2 u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4 * one, load * np.cos(phase)[:, None], 2 * one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


@pytest.mark.parametrize("system", [lambda: jumping_system(), lambda: varying_with_output()])
def test_filter_covariance_is_the_steady_solution_of_its_differential_equation(system):
    made = system()
    found = solve.kalman(made, 1.0, np.eye(2), np.array([[0.5]]))

    def slope(t, p):
        P = p.reshape(2, 2)
        A, _, _, C, _ = (each[0] for each in made.equations_at(np.array([t]), 1.0))
        return (A @ P + P @ A.T + np.eye(2) - P @ C.T @ C @ P / 0.5).ravel()

    P, ends = found.riccati(0.0)[0], [1e-12, *(each for each in made.breaks if each), 2 * np.pi]
    for start, end in itertools.pairwise(ends):
        inside = start * (1 + 1e-12), end * (1 - 1e-12)
        P = solve_ivp(slope, inside, P.ravel(), "DOP853", rtol=1e-10, atol=1e-12).y[:, -1].reshape(2, 2)
        assert np.abs(P - found.riccati(end)[0]).max() < 1e-8
    assert found.error_estimate < 1e-8


def jumping_system():
    """Return an oscillator whose stiffness jumps at phase 2, with its position as the output."""
    A = np.array([[[0.0, 1.0], [-1.0, 0.1]], [[0.0, 1.0], [2.0, 0.0]]])
    return with_output(lambda phase: A[(np.mod(phase, 2 * np.pi) > 2.0).astype(int)], (0.0, 2.0))


def varying_with_output():
    """Return an oscillator whose stiffness is neither even nor odd in phase, with its position as the
    output."""

    def A(phase):
        matrices = np.zeros((len(phase), 2, 2))
        matrices[:, 0, 1], matrices[:, 1, 0] = 1.0, -1 - np.cos(phase) - 0.5 * np.sin(2 * phase + 0.3)
        return matrices

    return with_output(A, ())


def with_output(A, breaks):
    """Return a first-order system with two states. Its output is the first state."""

    def matrices(phase, speed):
        k, one = len(phase), np.ones((len(phase), 1, 1))
        return A(phase), np.zeros((k, 2)), one * [[0.0], [1.0]], one * [[1.0, 0.0]], 0 * one

    return solve.FirstOrderSystem(matrices, ["x0", "x1"], breaks=breaks, inputs=["u0"], outputs=["y0"])


def test_second_and_first_order_equations_have_the_same_solution():
    A, B = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0], [2.0]])
    first = solve.lqr(constant(A, B), 1.0, np.diag([3.0, 1.0]), [[0.5]])
    second = solve.lqr(oscillator(), 1.0, {"q": 3.0, "q_dot": 1.0}, {"u": 0.5})
    assert second.states == ("q", "q_dot")
    assert np.allclose(first.riccati(1.0), second.riccati(1.0), rtol=1e-11)
    assert np.allclose(first.gain(1.0), second.gain(1.0), rtol=1e-11)
    damping, stiffness = second.closed.at(np.zeros(1), 1.0)[1:3]
    K = second.gain(0.0)[0, 0]
    assert np.allclose([stiffness[0, 0, 0], damping[0, 0, 0]], [4 + 2 * K[0], 0.1 + 2 * K[1]])


def test_feedforward_minimises_the_vibration_at_the_load_frequency():
    weight, cost = 3.0, 0.5
    found = solve.lqr(oscillator(), 1.0, {"q": weight}, {"u": cost}, feedforward=True)
    orbit = solve.periodic(found.closed, 1.0)
    # Least weight |q|² + cost |u|² for q = (1 + 2u)/(4 - 1 + 0.1j), by u.
    response = 1 / (3 + 0.1j)
    u = -2 * weight * abs(response) ** 2 / (4 * weight * abs(response) ** 2 + cost)
    q = (1 + 2 * u) * response
    assert orbit.statistics("q").max_abs == pytest.approx(abs(q), rel=1e-8)
    assert orbit.statistics("u").max_abs == pytest.approx(abs(u), rel=1e-8)


def test_observer_leaves_regulator_and_filter_multipliers_unchanged():
    system = oscillator()
    weights, noise = ({"q": 3.0}, {"u": 0.5}), ({"u": 1.0}, {"q": 0.1})
    both = solve.lqg(system, 1.0, *weights, *noise)
    parts = solve.lqr(system, 1.0, *weights).multipliers, solve.kalman(system, 1.0, *noise).multipliers
    expected = np.sort(np.abs(np.concatenate(parts)))[::-1]
    assert np.allclose(np.abs(both.multipliers), expected, rtol=1e-7)
    assert both.closed.states == ("q_hat", "q_dot_hat")
    # The observer knows the load: the periodic motion is that with the states themselves.
    regulated, observed = (
        solve.periodic(each.closed, 1.0) for each in (solve.lqr(system, 1.0, *weights), both)
    )
    assert observed.statistics("q").max_abs == pytest.approx(regulated.statistics("q").max_abs, rel=1e-8)
    assert np.allclose(observed.at(PHASES)[1], observed.at(PHASES)[0], rtol=1e-6, atol=1e-9)


def helicopter():
    """Return Hammond's rotor with a failed damper of docs/machines.md, with forces on the hub as inputs."""
    section = MACHINES[MACHINES.index("## Ground resonance with a failed damper") :].partition("\n## ")[0]
    names = {}
    code = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)[0].partition("def growth")[0]
    exec(code, names)
    open_loop = names["helicopter"]([0.0, *[names["LAG"]] * 3])

    def matrices(phase, speed):
        B = np.zeros((len(phase), 6, 2))
        B[:, 0, 0] = B[:, 1, 1] = 1.0
        return *open_loop.at(phase, speed), B

    return solve.PeriodicSystem(matrices, open_loop.coordinates, inputs=["Fx", "Fy"])


def test_regulator_stabilises_ground_resonance_with_a_failed_damper():
    system = helicopter()
    assert solve.floquet(system, "255 rpm").verdict == "unstable"
    weights, forces = {"x": 1e6, "y": 1e6}, {"Fx": 1e-6, "Fy": 1e-6}
    found = solve.lqr(system, "255 rpm", weights, forces)
    assert found.verdict == "asymptotically stable"
    assert found.stability.exponents.real.max() < -0.3


@pytest.mark.slow
def test_regulator_halves_the_hammer_vibration_in_the_nonlinear_equations():
    press, speed = solve.load("manipulator"), "70 rpm"
    noise = {"u": 1.0}, {"q1": 1e-9}
    found = solve.lqg(press, speed, {"q2": 1e8}, {"u": 1e-3}, *noise, feedforward=True)
    before, after = (solve.nonlinear(each, speed, rtol=1e-6) for each in (press, found.closed))
    assert after.verdict == "asymptotically stable"
    assert after.statistics("q2").max_abs < before.statistics("q2").max_abs / 2
    assert after.statistics("u").max_abs < 280.0
    assert before.statistics("load_torque").max_abs > 840.0


def test_incompatible_systems_and_weights_are_refused():
    system = oscillator()
    for error, arguments, words in (
        (UnknownNameError, ({"x": 1.0}, {"u": 1.0}), "allowed: q, q_dot|q"),
        (UnknownNameError, ({"q": 1.0}, {"v": 1.0}), "v"),
        (ValueOutOfBoundsError, ({"q": -1.0}, {"u": 1.0}), "q is -1.0"),
        (ValueOutOfBoundsError, ({"q": 1.0}, {"u": 0.0}), "real numbers > 0"),
        (ValueOutOfBoundsError, (np.eye(3), {"u": 1.0}), "shape"),
        (ValueOutOfBoundsError, ([[1.0, 2.0], [0.0, 1.0]], {"u": 1.0}), "symmetric"),
        (ValueOutOfBoundsError, (-np.eye(2), {"u": 1.0}), "eigenvalue"),
        (ValueOutOfBoundsError, ("q", {"u": 1.0}), r"Q is 'q'; allowed: \(N, N\) array, mapping or callable"),
        (MissingValueError, ({"q": 1.0}, {}), "u"),
        (ValueOutOfBoundsError, (1j * np.eye(2), {"u": 1.0}), "Q is array"),
        (ValueOutOfBoundsError, ({"q": 1.0}, 2.0), r"R is 2\.0; allowed: \(r, r\) array"),
    ):
        with pytest.raises(error, match=words):
            solve.lqr(system, 1.0, *arguments)
    with pytest.raises(ControlError, match="no inputs"):
        solve.lqr(solve.load("mathieu"), "1 rad/s", {"q": 1.0}, {"u": 1.0})
    with pytest.raises(MissingValueError, match="no input"):
        solve.control(system, 1.0, lqr={"q": 1.0})
    with pytest.raises(MissingValueError, match="requires weights"):
        solve.control(system, 1.0)
    with pytest.raises(MissingValueError, match="V contains no measured quantity"):
        solve.kalman(system, 1.0, {"u": 1.0}, {})
    with pytest.raises(ControlError, match=r"^the Kalman filter holds no feedback"):
        solve.closed_loop(system, solve.kalman(system, 1.0, {"u": 1.0}, {"q": 1.0}))


@pytest.mark.parametrize("harmonic", [60, 192])
@pytest.mark.parametrize("weight", [1e4, 1e8])
def test_gains_follow_inputs_with_little_effect_on_the_solution(harmonic, weight):
    def matrices(phase, speed):
        B, C = np.zeros((len(phase), 2, 1)), np.zeros((len(phase), 1, 2))
        B[:, 1, 0], C[:, 0, 0] = 1 + 0.5 * np.cos(harmonic * phase), 1 + 0.5 * np.sin(harmonic * phase)
        A = np.broadcast_to([[0.0, 1.0], [-1.0, -0.2]], (len(phase), 2, 2))
        return A, np.zeros((len(phase), 2)), B, C, np.zeros((len(phase), 1, 1))

    system = solve.FirstOrderSystem(matrices, ["x", "v"], inputs=["u"], outputs=["y"])
    phase = np.linspace(0.0, 6.2, 500)
    B, C = system.equations_at(phase, 1.0)[2:4]
    regulator = solve.lqr(system, 1.0, np.eye(2), {"u": weight})
    observer = solve.kalman(system, 1.0, np.eye(2), {"y": weight})
    for found, exact in (
        (regulator, np.swapaxes(B, 1, 2) @ regulator.riccati(phase) / weight),
        (observer, observer.riccati(phase) @ np.swapaxes(C, 1, 2) / weight),
    ):
        assert found.error_estimate < 1e-8
        assert found.warnings == []
        assert np.abs(found.gain(phase) - exact).max() < 1e-8 * np.abs(exact).max()


def test_observer_keeps_the_design_equations_without_parameters():
    def spring(stiffness):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            varying = stiffness + 0.3 * np.cos(phase)
            return one, 0.1 * one, varying[:, None, None], 0 * phase[:, None], one

        return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])

    found = solve.lqg(spring(2.0), 1.0, {"q": 10.0}, {"u": 1.0}, {"u": 1.0}, {"q": 0.01})

    def slope(phase, z):
        A = [np.array([[0.0, 1.0], [-k - 0.3 * np.cos(phase), -0.1]]) for k in (3.0, 2.0)]
        force = np.array([0.0, -(found.gain(phase)[0] @ z[2:])[0]])
        change = found.observer.gain(phase)[0, :, 0] * (z[0] - z[2])
        return np.concatenate((A[0] @ z[:2] + force, A[1] @ z[2:] + force + change))

    runs = [solve_ivp(slope, (0, 2 * np.pi), e, rtol=1e-9, atol=1e-12).y[:, -1] for e in np.eye(4)]
    exact = np.abs(np.linalg.eigvals(np.transpose(runs))).max()
    loop = solve.closed_loop(spring(3.0), found)
    assert solve.floquet(loop, 1.0).spectral_radius == pytest.approx(exact, rel=1e-6)


def test_filter_gain_of_a_stable_system_without_noise_is_zero(recwarn):
    found = solve.kalman(oscillator(), 1.0, {"u": 0.0}, {"q": 1.0})
    assert not found.gain(PHASES).any()
    assert not recwarn.list


def test_uncontrollable_modes_are_reported():
    A, B = np.diag([1.0, -1.0]), np.array([[0.0], [1.0]])
    with pytest.raises(ControlError, match="cannot be controlled"):
        solve.lqr(constant(A, B), 1.0, np.eye(2), np.eye(1))
    with pytest.raises(ControlError, match="not observable"):
        solve.kalman(constant(A, B, np.array([[0.0, 1.0]])), 1.0, np.eye(2), np.eye(1))


def test_excessively_fast_feedback_is_refused_before_solving():
    with pytest.raises(ControlError, match="larger weights of the inputs"):
        solve.lqr(oscillator(), 1.0, {"q": 1.0}, {"u": 1e-30})
    with pytest.raises(ControlError, match="larger noise"):
        solve.kalman(oscillator(), 1.0, {"u": 1.0}, {"q": 1e-30})


def test_weights_are_functions_of_the_phase():
    def Q(phase):
        return (2 + np.cos(phase))[:, None, None] * np.eye(2)

    found = solve.lqr(oscillator(), 1.0, Q, lambda phase: np.ones((len(phase), 1, 1)))
    A, B = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0], [2.0]])
    X = found.riccati(PHASES)
    left = slope_of(found, PHASES) + A.T @ X + X @ A - X @ B @ B.T @ X + Q(PHASES)
    assert np.abs(left).max() < 1e-7


def test_weights_that_differ_at_the_period_ends_jump_there():
    def Q(phase):
        return (1 + phase % (2 * np.pi))[:, None, None] * np.eye(2)

    with pytest.raises(ValueOutOfBoundsError, match="Q jumps at the phase 0 rad, where the system does not"):
        solve.lqr(oscillator(), 1.0, Q, [[1.0]])


@pytest.mark.parametrize("modulo", [np.inf, 2 * np.pi])
@pytest.mark.parametrize("at", [0.01, 2.5, 6.2])
def test_weights_may_jump_only_where_the_system_does(at, modulo):
    def integrator(phase, speed):
        zero = np.zeros((len(phase), 1, 1))
        return zero, zero[:, 0]

    def noise(phase):
        return np.where(phase % modulo < at, 4.0, 9.0)[:, None, None]

    smooth = solve.FirstOrderSystem(integrator, ["x"])
    with pytest.raises(
        ValueOutOfBoundsError, match=f"W jumps at the phase {at} rad, where the system does not"
    ):
        solve.kalman(smooth, 1.0, noise, {"x": 1.0})
    with pytest.raises(ValueOutOfBoundsError, match="V jumps"):
        solve.kalman(smooth, 1.0, [[4.0]], noise)
    stepped = solve.FirstOrderSystem(integrator, ["x"], breaks=[at])
    found = solve.kalman(stepped, 1.0, noise, {"x": 1.0}, rtol=1e-8)
    # Ṗ = W − P² with constant W on either side of the jump, over three periods from P = 1.
    P = 1.0
    for _ in range(3):
        for W, span in ((4.0, at), (9.0, 2 * np.pi - at)):
            P = solve_ivp(lambda _, P, W=W: W - P**2, (0.0, span), [P], rtol=1e-11, atol=1e-12).y[0, -1]
    assert not found.warnings
    assert found.gain(0.0)[0, 0, 0] == pytest.approx(P, rel=1e-7)
