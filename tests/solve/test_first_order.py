"""First-order and mixed systems, compared with closed forms and with other forms of the same equations."""

import json

import numpy as np
import pytest

import solve
from solve import FirstOrderSystem, MixedSystem, PeriodicSystem, SolveError
from tests.solve.first_order_systems import (
    error,
    first_order,
    names,
    orbit_difference,
    restated,
    rotated,
)

METHODS = "radau", "gauss", "rk4", "hsu", "fourier", "hill"
REFUSED = "newmark", "modal", "march", "bahgat-willmert"


def relaxation(phase, speed):
    """System ẋ = -2 x + cos t."""
    return np.full((len(phase), 1, 1), -2.0), np.cos(phase)[:, None]


def varga(phase, speed):
    """System by A. Varga, PeriodicSystems.jl, test_pslifting.jl, with exponents 0 and -24."""
    A = np.zeros((len(phase), 2, 2))
    A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -10 * np.cos(phase), -24 - 10 * np.sin(phase)
    return A, np.zeros((len(phase), 2))


def pushed_mass(phase, speed):
    """System q̈ + 4 q = x + cos t with a delayed force: ẋ/2 + x + q/5 = 0."""
    M, C, K = np.zeros((3, len(phase), 2, 2))
    M[:, 0, 0], K[:, 0, 0], K[:, 0, 1] = 1.0, 4.0, -1.0
    C[:, 1, 1], K[:, 1, 1], K[:, 1, 0] = 0.5, 1.0, 0.2
    return M, C, K, np.stack((np.cos(phase), 0 * phase), axis=1)


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_system_with_one_state_matches_the_closed_form(engine):
    orbit = solve.periodic(FirstOrderSystem(relaxation, ["x"]), 1.0, engine=engine)
    expected = (2 * np.cos(orbit.phase) + np.sin(orbit.phase)) / 5
    assert np.abs(orbit.x[0] - expected).max() < 1e-9
    assert np.abs(orbit.xd[0] - (np.cos(orbit.phase) - 2 * expected)).max() < 1e-7
    assert orbit.multipliers == pytest.approx([np.exp(-4 * np.pi)], rel=1e-10)
    assert orbit.states == orbit.coordinates == ("x",)
    assert orbit.stable


@pytest.mark.parametrize("N", [1, 2, 3, 5])
def test_estimates_cover_errors_of_rotated_constant_systems(N):
    rng = np.random.default_rng(N)
    for _ in range(8):
        speed = float(np.exp(rng.uniform(-1, 1.5)))
        A, exact = rotated(rng, N, speed)
        found = solve.floquet(first_order(A, N), speed)
        assert error(found, exact) <= 10 * found.error_estimate.multipliers
        assert found.error_estimate.multipliers < 1e-8
        largest = np.abs(exact).max()
        assert found.verdict == ("unstable" if largest > 1 else "asymptotically stable")


@pytest.mark.slow
def test_estimates_cover_errors_of_200_rotated_systems():
    rng, ratios = np.random.default_rng(200), []
    for _ in range(200):
        N, speed = int(rng.integers(1, 9)), float(np.exp(rng.uniform(-0.7, 1.6)))
        A, exact = rotated(rng, N, speed)
        found = solve.floquet(first_order(A, N), speed)
        ratios.append(error(found, exact) / found.error_estimate.multipliers)
    assert max(ratios) <= 10


@pytest.mark.parametrize("method", METHODS)
def test_every_first_order_method_gives_the_multipliers(method):
    A, exact = rotated(np.random.default_rng(5), 3)
    steps = 61 if method in ("fourier", "hill") else None
    found = solve.floquet(first_order(A, 3), 1.0, method=method, steps=steps, rtol=1e-6)
    assert error(found, exact) <= 10 * found.error_estimate.multipliers + 1e-12


def test_exponents_of_varga_are_zero_and_minus_24():
    found = solve.floquet(FirstOrderSystem(varga, ["x1", "x2"]), 1.0, all_multipliers=True, rtol=1e-12)
    assert np.abs(found.exponents - [0, -24]).max() < 1e-12


@pytest.mark.parametrize(
    ("n", "method"), [(2, "radau"), (3, "gauss"), (2, "rk4"), (2, "fourier"), (2, "hill")]
)
def test_other_forms_of_a_system_give_the_same_results(n, method):
    second, states, mixed = restated(7 + n, n)
    reference = solve.periodic(second, 1.3, rtol=1e-11)
    steps = {"rk4": 800, "fourier": 41, "hill": 41}.get(method)
    for system in (states, mixed):
        orbit = solve.periodic(system, 1.3, method=method, steps=steps, rtol=1e-7)
        limit = 10 * orbit.error_estimate.orbit + 1e-10
        assert orbit_difference(orbit, reference, n) <= limit
        assert error(orbit, reference.multipliers) <= 10 * orbit.error_estimate.multipliers + 1e-11


@pytest.mark.parametrize("order", [1, 2])
def test_compiled_code_agrees_with_numpy(order):
    system = restated(3, 2)[order]
    compiled, numpy = (solve.periodic(system, 1.3, engine=engine) for engine in ("compiled", "numpy"))
    assert np.abs(compiled.q - numpy.q).max() <= 1e-12 * np.abs(numpy.q).max()
    assert np.abs(compiled.qd - numpy.qd).max() <= 1e-11 * np.abs(numpy.qd).max()
    assert np.abs(compiled.multipliers - numpy.multipliers).max() < 1e-12


@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_jumps_are_integrated_exactly(engine):
    def switched(phase, speed):
        rate = np.where(np.mod(phase, 2 * np.pi) < np.pi, -1.0, -0.5)
        return rate[:, None, None], 1.0 - rate[:, None]

    orbit = solve.periodic(FirstOrderSystem(switched, ["x"], breaks=(0.0, np.pi)), 1.0, engine=engine)
    # x tends to 2 and then to 3.
    a, b = np.exp(-np.pi), np.exp(-np.pi / 2)
    start = (3 * (1 - b) + 2 * b * (1 - a)) / (1 - a * b)
    assert orbit.multipliers == pytest.approx([a * b], rel=1e-10)
    assert orbit.x[0, 0] == pytest.approx(start, rel=1e-10)


def test_sweep_bands_and_chart_points_equal_single_solutions():
    _, states, mixed = restated(11, 2)
    speeds = [0.9, 1.3, 2.1]
    for system in (states, mixed):
        swept = solve.sweep(system, speeds)
        alone = [solve.periodic(system, speed) for speed in speeds]
        assert swept.spectral_radius == pytest.approx([one.spectral_radius for one in alone], rel=1e-9)
        maxima = [one.statistics("q1").max_abs for one in alone]
        assert swept.figures("q1") == pytest.approx(maxima, rel=1e-7)


def test_bands_of_both_forms_are_the_same():
    def mathieu(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.01 * one, (1 + 0.3 * np.cos(phase))[:, None, None], 0 * one[:, 0]

    def states(phase, speed):
        A = np.zeros((len(phase), 2, 2))
        A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -(1 + 0.3 * np.cos(phase)), -0.01
        return A, np.zeros((len(phase), 2))

    second = solve.bands(PeriodicSystem(mathieu, ["q"]), (1.5, 2.5))
    first = solve.bands(FirstOrderSystem(states, ["q", "v"]), (1.5, 2.5))
    assert len(first) == len(second) == 1
    assert first[0].low == pytest.approx(second[0].low, rel=1e-6)
    assert first[0].high == pytest.approx(second[0].high, rel=1e-6)


def mathieu_states(delta, epsilon):
    def matrices(phase, speed):
        A = np.zeros((len(phase), 2, 2))
        A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -(delta + epsilon * np.cos(2 * phase)), -0.1
        return A, np.cos(2 * phase)[:, None] * [0, 1]

    return FirstOrderSystem(matrices, ["q", "v"], period=np.pi)


def mathieu(delta, epsilon):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (delta + epsilon * np.cos(2 * phase))[:, None, None]
        return one, 0.1 * one, stiffness, np.cos(2 * phase)[:, None]

    return PeriodicSystem(matrices, ["q"], period=np.pi)


def test_charts_of_both_forms_are_the_same():
    charts = [
        solve.chart(build, "delta=0.5:1.5:5", "epsilon=0:1:4", speed=1.0)
        for build in (mathieu, mathieu_states)
    ]
    assert (charts[0].verdicts == charts[1].verdicts).all()
    assert charts[1].spectral_radius == pytest.approx(charts[0].spectral_radius, rel=1e-8)
    assert len(charts[0].boundaries) == len(charts[1].boundaries) == 1


def test_critical_speeds_of_both_forms_are_the_same():
    second, first = (
        solve.critical_speeds(build(1.3, 0.4), (0.5, 3.0)) for build in (mathieu, mathieu_states)
    )
    for one, other in zip(second.rows, first.rows, strict=True):
        for kind in ("response", "multiplier", "radius"):
            maxima = getattr(one, kind), getattr(other, kind)
            if maxima[0] is None:
                assert maxima[1] is None
            else:
                assert maxima[1].speed == pytest.approx(maxima[0].speed, rel=1e-5)


@pytest.mark.parametrize("method", REFUSED)
def test_second_order_methods_are_refused_in_one_line(method):
    with pytest.raises(SolveError, match=r"second order only.*use auto, radau, gauss") as refused:
        solve.periodic(FirstOrderSystem(relaxation, ["x"]), 1.0, method=method, steps=50)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("study", [solve.frequencies, solve.prove, solve.sensitivities, solve.nonlinear])
def test_second_order_studies_refuse_first_order_states(study):
    arguments = () if study is solve.frequencies else (1.0,)
    with pytest.raises(SolveError) as refused:
        study(FirstOrderSystem(relaxation, ["x"]), *arguments)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (lambda phase, speed: (np.ones((len(phase), 2, 2)), np.ones((len(phase), 1))), "A at 4 phases"),
        (lambda phase, speed: (np.ones((len(phase), 1, 1)), np.ones((len(phase), 2))), "b at 4 phases"),
        (lambda phase, speed: np.ones((len(phase), 1, 1)), "not two real arrays"),
        (lambda phase, speed: (phase[:, None, None], phase[:, None]), "A is not periodic"),
        (lambda phase, speed: (np.full((len(phase), 1, 1), np.nan), phase[:, None]), "A has NaN"),
    ],
)
def test_invalid_matrices_are_refused(matrices, message):
    with pytest.raises(SolveError, match=message):
        solve.floquet(FirstOrderSystem(matrices, ["x"]), 1.0)


def test_invalid_names_are_refused():
    for settings in (
        {"states": ["x", "x"]},
        {"states": ["x"], "inputs": "u"},
        {"states": ["x"], "outputs": ["x"]},
    ):
        with pytest.raises(SolveError):
            FirstOrderSystem(relaxation, **settings)
    with pytest.raises(SolveError, match="give a sequence"):
        MixedSystem(pushed_mass, "q", ["x"])


def test_inertia_of_a_state_is_refused():
    with pytest.raises(SolveError, match="M has entries in the columns of the states q"):
        solve.floquet(MixedSystem(pushed_mass, [], ["q", "x"]), 1.0)


def test_state_without_equation_is_refused():
    def without(phase, speed):
        M, C, K, d = pushed_mass(phase, speed)
        return M, 0 * C, K, d

    with pytest.raises(SolveError, match="linearly dependent"):
        solve.floquet(MixedSystem(without, ["q"], ["x"]), 1.0)


def test_constant_mixed_system_matches_the_closed_form():
    orbit = solve.periodic(MixedSystem(pushed_mass, ["q"], ["x"]), 1.0)
    A = np.array([[0, 0, 1], [-0.4, -2, 0], [-4, 1, 0.0]])  # of q, x, q̇
    assert error(orbit, np.exp(2 * np.pi * np.linalg.eigvals(A))) <= 10 * orbit.error_estimate.multipliers
    response = np.linalg.solve(1j * np.eye(3) - A, [0, 0, 1])
    assert orbit.harmonics("q", 1)[0][1] == pytest.approx(abs(response[0]), rel=1e-8)
    assert orbit.harmonics("x", 1)[0][1] == pytest.approx(abs(response[1]), rel=1e-8)
    assert orbit.states == ("x",)
    assert orbit.x.shape == (1, orbit.steps + 1)


def test_results_are_stored_and_recorded_with_their_states(tmp_path):
    orbit = solve.periodic(MixedSystem(pushed_mass, ["q"], ["x"]), 1.0)
    record = json.loads(json.dumps(orbit.record(2)))
    assert list(record["coordinates"]) == ["q", "x"]
    assert len(record["multipliers"]) == len(record["exponents"]) == 3
    for ending in ("nc", "npz"):
        orbit.save(tmp_path / f"orbit.{ending}")
        stored = solve.open(tmp_path / f"orbit.{ending}")
        assert np.array_equal(stored.x, orbit.x)
        assert np.array_equal(stored.multipliers, orbit.multipliers)
        assert stored.states == ("x",)
    assert {"q", "x", "xd"} <= set(orbit.to_xarray().data_vars)


def test_modes_have_the_frequencies_of_the_other_form():
    second, states, mixed = restated(4, 2)
    expected = sorted(mode.unfolded for mode in solve.floquet(second, 1.3).modes)
    for system in (states, mixed):
        found = sorted(mode.unfolded for mode in solve.floquet(system, 1.3).modes)
        assert found == pytest.approx(expected, rel=1e-9)


def test_comparison_omits_second_order_methods():
    rows = solve.compare(FirstOrderSystem(relaxation, ["x"]), 1.0, steps=[32], targets=[1e-4]).rows
    refused = {row.method for row in rows if row.reason and "second order only" in row.reason}
    assert refused == set(REFUSED)


def conduction(phase, speed):
    """Three bodies with heat conduction between them, which conserves the sum of the temperatures."""
    exchange = np.array([[-1, 1, 0], [1, -2, 1], [0, 1, -1.0]])
    sources = np.stack((np.cos(phase) + 0.3, np.sin(2 * phase), 0.5 * np.cos(phase)), axis=1)
    return (1 + 0.5 * np.cos(phase))[:, None, None] * exchange, sources


def test_constant_vector_without_rate_is_a_rigid_body_mode():
    orbit = solve.periodic(FirstOrderSystem(conduction, names("x", 3)), 1.0)
    (mode,) = orbit.rigid_body_modes
    assert mode.vector == (1, 1, 1)
    # The mean source 0.3 heats all three.
    assert mode.drift == pytest.approx(0.1, rel=1e-9)
    assert orbit.multipliers == pytest.approx(np.exp(-2 * np.pi * np.array([0, 1, 3])), abs=1e-10)
    assert orbit.verdict == "asymptotically stable"
    assert orbit.spectral_radius == pytest.approx(np.exp(-2 * np.pi), rel=1e-8)
    mean = [orbit.statistics(name).mean for name in orbit.states]
    assert sum(mean) == pytest.approx(0.0, abs=1e-9)


def test_orbit_along_a_free_direction_satisfies_the_equations():
    from scipy.integrate import solve_ivp

    orbit = solve.periodic(FirstOrderSystem(conduction, names("x", 3)), 1.0)

    def rate(t, x):
        A, b = conduction(np.array([t]), 1.0)
        return A[0] @ x + b[0]

    times = np.linspace(0, 2 * np.pi, 9)
    motion = solve_ivp(rate, (0, 2 * np.pi), orbit.x[:, 0], rtol=1e-10, atol=1e-12, t_eval=times).y
    assert motion - 0.1 * times == pytest.approx(orbit.at(times), abs=1e-7)


@pytest.mark.parametrize("drag", [0.0, 0.2])
@pytest.mark.parametrize("engine", ["compiled", "numpy"])
def test_free_mixed_system_equals_its_second_order_form(drag, engine):
    def second(phase, speed):
        M, C, K = np.zeros((3, len(phase), 2, 2))
        stiffness = 1 + 0.2 * np.cos(phase)
        M[:] = np.eye(2)
        K[:] = stiffness[:, None, None] * np.array([[1, -1], [-1, 1.0]])
        C[:] = np.array([[0.1 + drag, -0.1], [-0.1, 0.1]])
        return M, C, K, np.stack((np.cos(phase) + drag / 2, -np.cos(phase)), axis=1)

    def with_sensor(phase, speed):
        """System with an additional state x that follows the twist."""
        matrices = np.zeros((3, len(phase), 3, 3))
        *parts, load = second(phase, speed)
        for large, part in zip(matrices, parts, strict=True):
            large[:, :2, :2] = part
        matrices[1][:, 2, 2], matrices[2][:, 2] = 1.0, [-0.1, 0.1, 2.0]
        return (*matrices, np.concatenate((load, 0 * load[:, :1]), axis=1))

    q = names("q", 2)
    reference = solve.periodic(PeriodicSystem(second, q), 1.0, engine=engine)
    orbit = solve.periodic(MixedSystem(with_sensor, q, ["x"]), 1.0, engine=engine)
    assert orbit_difference(orbit, reference, 2) < 1e-10
    assert orbit.multipliers[:4] == pytest.approx(reference.multipliers, abs=1e-10)
    assert orbit.multipliers[4] == pytest.approx(np.exp(-4 * np.pi), abs=1e-10)
    assert orbit.verdict == reference.verdict
    (mode,), (expected,) = orbit.rigid_body_modes, reference.rigid_body_modes
    assert mode.vector == (*expected.vector, 0)
    assert mode.damped == expected.damped == bool(drag)
    assert (mode.drift or 0) == pytest.approx(expected.drift or 0, rel=1e-9)


@pytest.mark.parametrize(
    ("A", "verdict"),
    [
        ([[0, 1], [-1, 0]], "stable"),
        ([[0, 1], [0, 0]], "stable"),
        ([[0, 1], [0, -1]], "asymptotically stable"),
        ([[0, 1], [0, 1]], "unstable"),
        ([[-1, 1], [0, 1e-3]], "unstable"),
        ([[0]], "stable"),
        ([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], "asymptotically stable"),
        ([[0, 1, 0, 0], [-1, 0, 1, 0], [0, 0, 0, 1], [0, 0, -1, 0]], "undetermined"),
    ],
)
def test_verdicts_of_constant_systems(A, verdict):
    """The last system has a double pair on the unit circle with one eigenvector."""
    A = np.array(A, dtype=float)

    def matrices(phase, speed):
        return np.broadcast_to(A, (len(phase), *A.shape)), np.zeros((len(phase), len(A)))

    assert solve.floquet(FirstOrderSystem(matrices, names("x", len(A))), 2.3).verdict == verdict
