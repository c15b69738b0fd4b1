"""Regulators and filters: known solutions, integrated references, closed forms, and machines."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, solve_continuous_are, solve_discrete_are

import solve
from solve.errors import ControlError, MissingValueError, UnknownNameError, ValueOutOfBoundsError
from solve.methods.gauss import Gauss
from solve.studies.control import maps

MACHINES = (Path(__file__).parents[3] / "docs" / "machines.md").read_text(encoding="utf-8")
PHASES = np.array([0.1, 1.3, 2.9, 4.4, 6.0])


def constant(A, B, C=None):
    """System of first order with constant matrices."""
    N, r = B.shape
    C = np.eye(N)[:1] if C is None else C

    def matrices(phase, speed):
        arrays = A, np.zeros(N), B, C, np.zeros((len(C), r))
        return [np.broadcast_to(each, (len(phase), *each.shape)) for each in arrays]

    names = [f"x{k}" for k in range(N)]
    outputs = [f"y{k}" for k in range(len(C))]
    return solve.FirstOrderSystem(matrices, names, inputs=[f"u{k}" for k in range(r)], outputs=outputs)


def varying(A, B, period=2 * np.pi, breaks=()):
    """System of first order with functions of phases A (k, N, N) and B (k, N, r)."""
    N, r = B(np.zeros(1)).shape[1:]

    def matrices(phase, speed):
        m = len(phase)
        return A(phase), np.zeros((m, N)), B(phase), np.zeros((m, 0, N)), np.zeros((m, 0, r))

    inputs = [f"u{k}" for k in range(r)]
    return solve.FirstOrderSystem(matrices, [f"x{k}" for k in range(N)], period, breaks, inputs)


@pytest.mark.parametrize("N", [1, 2, 5, 8])
def test_solutions_of_constant_systems_are_those_of_scipy(N):
    rng = np.random.default_rng(N)
    A, B, C = (rng.normal(size=shape) for shape in ((N, N), (N, 2), (2, N)))
    Q, R = np.diag(rng.uniform(0.5, 2.0, N)), np.diag([2.0, 0.5])
    X = solve_continuous_are(A, B, Q, R)
    found = solve.lqr(constant(A, B, C), 1.0, Q, R)
    assert np.abs(found.riccati(PHASES) - X).max() <= 1e-12 * np.abs(X).max() * np.linalg.cond(X)
    assert np.allclose(found.gain(PHASES), np.linalg.solve(R, B.T @ X), rtol=1e-9)
    P = solve_continuous_are(A.T, C.T, Q, R)
    filtered = solve.kalman(constant(A, B, C), 1.0, Q, R)
    assert np.abs(filtered.riccati(PHASES) - P).max() <= 1e-12 * np.abs(P).max() * np.linalg.cond(P)
    rates = np.linalg.eigvals(A - P @ C.T @ np.linalg.solve(R, C)).real
    moduli = np.sort(np.exp(2 * np.pi * rates))[::-1]
    assert np.abs(np.abs(filtered.multipliers) - moduli).max() < 1e-8 * moduli[0]


A0, B0 = np.array([[1.0, 0.5], [3.0, 5.0]]), np.array([[3.0], [1.0]])


def rotation(phase):
    c, s = np.cos(2 * phase), np.sin(2 * phase)
    return np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0)


def in_rotating_frame(breaks=()):
    """A constant system in coordinates x = P(t) z that rotate: X = P X₀ Pᵀ (Johansson et al. 2007)."""

    def A(phase):
        P = rotation(phase)
        return P @ A0 @ np.swapaxes(P, 1, 2) + 2 * np.array([[0.0, 1.0], [-1.0, 0.0]])

    return varying(A, lambda phase: rotation(phase) @ B0, np.pi, breaks)


@pytest.mark.parametrize("breaks", [(), (0.0, 0.3, 0.31, 2.0)])
def test_solution_is_the_known_one_of_johansson(breaks):
    found = solve.lqr(in_rotating_frame(breaks), 1.0, np.eye(2), np.eye(1), rtol=1e-10)
    P, X = rotation(PHASES), solve_continuous_are(A0, B0, np.eye(2), np.eye(1))
    exact = P @ X @ np.swapaxes(P, 1, 2)
    assert np.abs(found.riccati(PHASES) - exact).max() <= found.error_estimate * np.abs(X).max()
    assert found.error_estimate < 1e-10
    assert found.residual < 1e-9
    # Multipliers of the closed loop are those of the constant one: half a revolution of the frame is -1.
    rates = np.linalg.eigvals(A0 - B0 @ B0.T @ X)
    moduli = np.sort(np.abs(np.exp(rates * np.pi)))[::-1]
    assert np.allclose(np.abs(found.multipliers), moduli, rtol=1e-6)


@pytest.mark.parametrize("breaks", [(), (0.0, 0.3, 0.31, 2.0)])
def test_filter_in_the_rotating_frame_is_the_known_one(breaks):
    C, A = np.array([[3.0, 1.0]]), in_rotating_frame().equations_at

    def matrices(phase, speed):
        rows, k = C @ np.swapaxes(rotation(phase), 1, 2), len(phase)
        return A(phase, speed)[0], np.zeros((k, 2)), np.zeros((k, 2, 1)), rows, np.zeros((k, 1, 1))

    system = solve.FirstOrderSystem(matrices, ["x0", "x1"], np.pi, breaks, ["u0"], ["y0"])
    found = solve.kalman(system, 1.0, np.eye(2), np.eye(1), rtol=1e-10)
    P = solve_continuous_are(A0.T, C.T, np.eye(2), np.eye(1))
    exact = rotation(PHASES) @ P @ np.swapaxes(rotation(PHASES), 1, 2)
    assert np.abs(found.riccati(PHASES) - exact).max() <= found.error_estimate * np.abs(P).max()
    assert found.error_estimate < 1e-10


def riccati_integrated(A, B, Q, R, period, X):
    """X one period earlier, by SciPy, with constant A, Q and R and an input matrix B of the time."""
    N = len(X)

    def slope(t, x):
        X, b = x.reshape(N, N), B(t)
        return (A(t).T @ X + X @ A(t) - X @ b @ np.linalg.solve(R, b.T) @ X + Q).ravel()

    run = solve_ivp(
        lambda tau, x: slope(period - tau, x), (0, period), X.ravel(), method="DOP853", rtol=1e-11, atol=1e-9
    )
    return run.y[:, -1].reshape(N, N)


RATE = 0.00103448
SATELLITE = np.array(
    [
        [0, 0, 5.318064566757217e-02, 0],
        [0, 0, 0, 5.318064566757217e-02],
        [-1.352134256362805e-03, 0, 0, -7.099273035392090e-02],
        [0, -7.557182037479544e-04, 3.781555288420663e-02, 0],
    ]
)


def test_solution_of_pittelkaus_satellite_repeats_after_an_orbit():
    def B(phase):
        columns = [0 * phase, 0 * phase, 0.1389735e-6 * np.sin(phase), -0.3701336e-7 * np.cos(phase)]
        return np.stack(columns, axis=-1)[..., None]

    satellite = varying(lambda phase: np.broadcast_to(SATELLITE, (len(phase), 4, 4)), B)
    Q, R = np.diag([2.0, 1.0, 0.0, 0.0]), np.array([[1e-11]])
    found = solve.lqr(satellite, RATE, Q, R, rtol=1e-9)
    assert found.residual < 1e-8
    assert found.stable
    X, period = found.riccati(0.0)[0], 2 * np.pi / RATE
    earlier = riccati_integrated(lambda t: SATELLITE, lambda t: B(RATE * t), Q, R, period, X)
    assert np.abs(earlier - X).max() < 1e-7 * np.abs(X).max()


def test_periodic_difference_equation_of_hench_and_laub_is_that_of_a_cyclic_system():
    """Example 2 of J. J. Hench, A. J. Laub, IEEE Trans. Automat. Contr. 39 (1994) 1197-1210, with R = 1."""
    A = np.array(
        [
            [[-3, 2, 9], [0, 0, -4], [3, -2, 3]],
            [[6, -3, 0], [4, -2, 2], [2, -1, 4]],
            [[2, -3, -3], [4, -15, -3], [-2, 9, 1]],
        ],
        dtype=float,
    )
    B = np.array([[1, 1, 0], [0, 1, 0], [0, 1, 1]], dtype=float)
    G, H = B[:, :, None] * B[:, None], np.eye(3)[:, :, None] * np.eye(3)[:, None]
    X = maps.periodic_solution(maps.Maps(A, G, H))
    cyclic, inputs = np.zeros((9, 9)), np.zeros((9, 3))
    for k in range(3):
        after = slice(3 * ((k + 1) % 3), 3 * ((k + 1) % 3) + 3)
        cyclic[after, 3 * k : 3 * k + 3], inputs[after, k] = A[k], B[k]
    exact = solve_discrete_are(cyclic, inputs, block_diag(*H), np.eye(3))
    for k in range(3):
        block = exact[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        assert np.abs(X[k] - block).max() < 1e-9 * np.abs(exact).max()


def test_solution_with_jumps_repeats_after_a_period():
    A = np.array([[[0.0, 1.0], [-1.0, 0.1]], [[0.0, 1.0], [2.0, 0.0]]])
    b = np.array([[0.0], [1.0]])

    def at(phase):
        return A[(np.mod(phase, 2 * np.pi) > 2.0).astype(int)]

    found = solve.lqr(
        varying(at, lambda p: np.broadcast_to(b, (len(p), 2, 1)), breaks=(0, 2.0)),
        1.0,
        {"x0": 1.0},
        {"u0": 2.0},
    )
    X, Q, R = found.riccati(0.0)[0], np.diag([1.0, 0.0]), np.array([[2.0]])
    middle = riccati_integrated(lambda t: A[1], lambda t: b, Q, R, 2 * np.pi - 2.0, X)
    assert np.abs(middle - found.riccati(2.0)[0]).max() < 1e-9
    assert np.abs(riccati_integrated(lambda t: A[0], lambda t: b, Q, R, 2.0, middle) - X).max() < 1e-9


def random_system(seed, most=20):
    """Periodic system with N states to `most`, two inputs, and entries of three harmonics."""
    rng = np.random.default_rng(seed)
    N = int(rng.integers(1, most + 1))
    a, b = rng.normal(size=(7, N, N)) / np.sqrt(N), rng.normal(size=(7, N, 2))

    def series(coefficients):
        def at(phase):
            waves = [np.ones(len(phase))]
            waves += [wave(k * phase) / (1 + k) for k in (1, 2, 3) for wave in (np.cos, np.sin)]
            return np.einsum("wk,w...->k...", waves, coefficients)

        return at

    return varying(series(a), series(b)), N


def slope_of(found, phase):
    """dX/dφ by central differences of order 8."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    steps = 1e-3 * np.arange(-4, 5)
    return sum(w * found.riccati(phase + h) for w, h in zip(weights, steps, strict=True)) / 1e-3


def residual_of(system, found, N):
    """Largest residual of the Riccati equation by differences of X, relative to X."""
    phase = np.linspace(0.05, 6.2, 23)
    A, _, B, *_ = system.equations_at(phase, 1.0)
    X = found.riccati(phase)
    left = (
        slope_of(found, phase)
        + np.swapaxes(A, 1, 2) @ X
        + X @ A
        - X @ B @ np.swapaxes(B, 1, 2) @ X
        + np.eye(N)
    )
    return np.abs(left).max() / np.abs(X).max()


@pytest.mark.parametrize("seed", range(4))
def test_residual_of_random_systems_is_small(seed):
    system, N = random_system(seed, most=6)
    found = solve.lqr(system, 1.0, np.eye(N), np.eye(2))
    assert residual_of(system, found, N) < 1e-6
    assert found.error_estimate < 1e-8
    assert found.stable
    accurate = solve.lqr(system, 1.0, np.eye(N), np.eye(2), rtol=1e-12)
    phase = np.linspace(0.0, 2 * np.pi, 97)
    X = accurate.riccati(phase)
    size = np.sqrt(np.einsum("kii->ki", X).max(axis=0))
    error = np.abs((found.riccati(phase) - X) / size / size[:, None]).max()
    assert found.error_estimate / 10 < error < found.error_estimate
    assert np.linalg.eigvalsh(found.riccati(PHASES)).min() > 0


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 100, 20))
def test_residuals_of_a_hundred_random_systems_are_small(first):
    for seed in range(first, first + 20):
        system, N = random_system(1000 + seed)
        found = solve.lqr(system, 1.0, np.eye(N), np.eye(2))
        assert residual_of(system, found, N) < 1e-6, seed
        assert found.error_estimate < 1e-8, seed
        assert found.stable, seed


def oscillator(load=1.0):
    """q̈ + 0.1 q̇ + 4 q = load cos φ + 2 u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4 * one, load * np.cos(phase)[:, None], 2 * one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


@pytest.mark.parametrize("system", [lambda: jumping_system(), lambda: varying_with_output()])
def test_filter_is_the_steady_covariance_of_its_differential_equation(system):
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
    """Spring whose stiffness jumps at phase 2, with its position as the output."""
    A = np.array([[[0.0, 1.0], [-1.0, 0.1]], [[0.0, 1.0], [2.0, 0.0]]])
    return with_output(lambda phase: A[(np.mod(phase, 2 * np.pi) > 2.0).astype(int)], (0.0, 2.0))


def varying_with_output():
    """Spring whose stiffness is neither even nor odd in phase, with its position as the output."""

    def A(phase):
        matrices = np.zeros((len(phase), 2, 2))
        matrices[:, 0, 1], matrices[:, 1, 0] = 1.0, -1 - np.cos(phase) - 0.5 * np.sin(2 * phase + 0.3)
        return matrices

    return with_output(A, ())


def with_output(A, breaks):
    """System of first order with two states, of which the first one is the output."""

    def matrices(phase, speed):
        k, one = len(phase), np.ones((len(phase), 1, 1))
        return A(phase), np.zeros((k, 2)), one * [[0.0], [1.0]], one * [[1.0, 0.0]], 0 * one

    return solve.FirstOrderSystem(matrices, ["x0", "x1"], breaks=breaks, inputs=["u0"], outputs=["y0"])


def test_second_order_and_first_order_have_the_same_solution():
    A, B = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0], [2.0]])
    first = solve.lqr(constant(A, B), 1.0, np.diag([3.0, 1.0]), [[0.5]])
    second = solve.lqr(oscillator(), 1.0, {"q": 3.0, "q_dot": 1.0}, {"u": 0.5})
    assert second.states == ("q", "q_dot")
    assert np.allclose(first.riccati(1.0), second.riccati(1.0), rtol=1e-11)
    assert np.allclose(first.gain(1.0), second.gain(1.0), rtol=1e-11)
    damping, stiffness = second.closed.at(np.zeros(1), 1.0)[1:3]
    K = second.gain(0.0)[0, 0]
    assert np.allclose([stiffness[0, 0, 0], damping[0, 0, 0]], [4 + 2 * K[0], 0.1 + 2 * K[1]])


def test_feedforward_is_the_optimum_at_the_frequency_of_the_load():
    weight, cost = 3.0, 0.5
    found = solve.lqr(oscillator(), 1.0, {"q": weight}, {"u": cost}, feedforward=True)
    orbit = solve.periodic(found.closed, 1.0)
    # Least weight |q|² + cost |u|² for q = (1 + 2u)/(4 - 1 + 0.1j), by u.
    response = 1 / (3 + 0.1j)
    u = -2 * weight * abs(response) ** 2 / (4 * weight * abs(response) ** 2 + cost)
    q = (1 + 2 * u) * response
    assert orbit.statistics("q").max_abs == pytest.approx(abs(q), rel=1e-8)
    assert orbit.statistics("u").max_abs == pytest.approx(abs(u), rel=1e-8)


def test_multipliers_with_an_observer_are_those_of_regulator_and_filter():
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
    """Hammond's rotor with a failed damper of docs/machines.md, with forces on the hub."""
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


def test_ground_resonance_with_a_failed_damper_is_stabilised():
    system = helicopter()
    assert solve.floquet(system, "255 rpm").verdict == "unstable"
    weights, forces = {"x": 1e6, "y": 1e6}, {"Fx": 1e-6, "Fy": 1e-6}
    found = solve.lqr(system, "255 rpm", weights, forces)
    assert found.verdict == "asymptotically stable"
    assert found.stability.exponents.real.max() < -0.3


@pytest.mark.slow
def test_vibration_of_the_hammer_is_halved_in_the_nonlinear_equations_too():
    press, speed = solve.load("manipulator"), "70 rpm"
    noise = {"u": 1.0}, {"q1": 1e-9}
    found = solve.lqg(press, speed, {"q2": 1e8}, {"u": 1e-3}, *noise, feedforward=True)
    before, after = (solve.nonlinear(each, speed, rtol=1e-6) for each in (press, found.closed))
    assert after.verdict == "asymptotically stable"
    assert after.statistics("q2").max_abs < before.statistics("q2").max_abs / 2
    assert after.statistics("u").max_abs < 280.0
    assert before.statistics("load_torque").max_abs > 840.0


def test_systems_and_weights_that_do_not_fit_are_refused():
    system = oscillator()
    for error, arguments, words in (
        (UnknownNameError, ({"x": 1.0}, {"u": 1.0}), "allowed: q, q_dot|q"),
        (UnknownNameError, ({"q": 1.0}, {"v": 1.0}), "v"),
        (ValueOutOfBoundsError, ({"q": -1.0}, {"u": 1.0}), "q is -1.0"),
        (ValueOutOfBoundsError, ({"q": 1.0}, {"u": 0.0}), "positive"),
        (ValueOutOfBoundsError, (np.eye(3), {"u": 1.0}), "shape"),
        (ValueOutOfBoundsError, ([[1.0, 2.0], [0.0, 1.0]], {"u": 1.0}), "symmetric"),
        (ValueOutOfBoundsError, (-np.eye(2), {"u": 1.0}), "eigenvalue"),
        (ValueOutOfBoundsError, ("q", {"u": 1.0}), "positive semidefinite matrix of shape"),
        (MissingValueError, ({"q": 1.0}, {}), "u"),
        (ValueOutOfBoundsError, (1j * np.eye(2), {"u": 1.0}), "not real"),
        (ValueOutOfBoundsError, ({"q": 1.0}, 2.0), r"R has shape \(\);"),
    ):
        with pytest.raises(error, match=words):
            solve.lqr(system, 1.0, *arguments)
    with pytest.raises(ControlError, match="no inputs"):
        solve.lqr(solve.load("mathieu"), "1 rad/s", {"q": 1.0}, {"u": 1.0})
    with pytest.raises(MissingValueError, match="no input"):
        solve.control(system, 1.0, lqr={"q": 1.0})
    with pytest.raises(MissingValueError, match="requires weights"):
        solve.control(system, 1.0)
    with pytest.raises(MissingValueError, match="V names no measured quantity"):
        solve.kalman(system, 1.0, {"u": 1.0}, {})
    with pytest.raises(ControlError, match=r"^the Kalman filter holds no feedback"):
        solve.closed_loop(system, solve.kalman(system, 1.0, {"u": 1.0}, {"q": 1.0}))


@pytest.mark.parametrize("harmonic", [60, 192])
@pytest.mark.parametrize("weight", [1e4, 1e8])
def test_gains_have_the_harmonics_of_inputs_that_hardly_act_on_the_solution(harmonic, weight):
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


def test_observer_of_a_system_without_parameters_keeps_the_equations_of_the_design():
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


def test_stable_system_without_process_noise_has_a_filter_without_gain(recwarn):
    found = solve.kalman(oscillator(), 1.0, {"u": 0.0}, {"q": 1.0})
    assert not found.gain(PHASES).any()
    assert not recwarn.list


def test_modes_that_no_input_reaches_are_reported():
    A, B = np.diag([1.0, -1.0]), np.array([[0.0], [1.0]])
    with pytest.raises(ControlError, match="cannot be controlled"):
        solve.lqr(constant(A, B), 1.0, np.eye(2), np.eye(1))
    with pytest.raises(ControlError, match="not observable"):
        solve.kalman(constant(A, B, np.array([[0.0, 1.0]])), 1.0, np.eye(2), np.eye(1))


def test_feedback_that_is_far_too_fast_is_refused_before_it_is_solved():
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


def random_steps():
    """A, E and Q of 3 steps of 5 stages for 3 positions and velocities with 2 inputs."""
    rng, p = np.random.default_rng(1), 3
    A, Q = 0.2 * rng.normal(size=(2, 3, 8, 2 * p, 2 * p))
    E = 0.2 * rng.normal(size=(3, 8, 2 * p, 2))
    A[..., :p, :], E[..., :p, :] = 0, 0
    A[..., range(p), range(p, 2 * p)] = rng.uniform(0.1, 0.3, p)
    return A, E, Q + np.swapaxes(Q, 2, 3)


def test_mechanical_steps_equal_those_of_any_system(monkeypatch):
    A, E, _ = random_steps()
    method = Gauss(16).collocation
    general = maps._response(A, E, method)
    assert np.abs(maps._mechanical_response(A, E, method) - general).max() < 1e-14
    monkeypatch.setattr(maps, "factorised", lambda *_: None)
    assert np.abs(maps._mechanical_response(A, E, method) - general).max() < 1e-14
    assert maps._is_mechanical(A.reshape(-1, 6, 6), E.reshape(-1, 6, 2))
    assert not maps._is_mechanical(A.reshape(-1, 6, 6), np.ones((24, 6, 2)))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steps_relate_states_and_costates_as_collocation_of_both_does(sign):
    A, E, Q = random_steps()
    weights, (m, s, N, _) = Gauss(16).collocation, E.shape
    of_start, gramian, cost, _ = maps._condensed(maps._response(A, E, weights), Q, weights.b, sign)
    for step in range(m):
        # Unknowns are states and costates at the stages and the costate at the start.
        x0, last, end = np.eye(N, 2 * N), np.eye(N, 2 * N, N), s * N
        left, right = np.zeros(((2 * s + 1) * N,) * 2), np.zeros(((2 * s + 1) * N, 2 * N))
        G = sign * E[step] @ np.swapaxes(E[step], 1, 2)
        at = [slice(k * N, k * N + N) for k in range(2 * s + 1)]
        for i in range(s):
            left[at[i], at[i]], right[at[i]] = np.eye(N), x0
            left[at[s + i], at[s + i]], left[at[s + i], at[-1]] = np.eye(N), -np.eye(N)
            for j in range(s):
                a = weights.A[i, j]
                left[at[i], at[j]] -= a * A[step, j]
                left[at[i], at[s + j]] += a * G[j]
                left[at[s + i], at[s + j]] += a * A[step, j].T
                left[at[s + i], at[j]] += a * Q[step, j]
        left[at[-1], at[-1]], right[at[-1]] = np.eye(N), last
        for j in range(s):
            left[at[-1], at[s + j]] = -weights.b[j] * A[step, j].T
            left[at[-1], at[j]] = -weights.b[j] * Q[step, j]
        solved = np.linalg.solve(left, right)
        stages, costates = solved[:end].reshape(s, N, -1), solved[end:-N].reshape(s, N, -1)
        rates = A[step] @ stages - G @ costates
        state = x0 + np.einsum("s,sij->ij", weights.b, rates)
        assert np.allclose(state, np.hstack((of_start[step], -gramian[step])), atol=1e-13)
        assert np.allclose(solved[-N:], np.hstack((cost[step], of_start[step].T)), atol=1e-13)


@pytest.mark.parametrize("at", [0.01, 2.5, 6.2])
def test_weights_may_jump_only_where_the_system_does(at):
    def integrator(phase, speed):
        zero = np.zeros((len(phase), 1, 1))
        return zero, zero[:, 0]

    def noise(phase):
        return np.where(phase < at, 4.0, 9.0)[:, None, None]

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
