"""Batches of points give the results of single points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import solve
from solve.batch import tables
from solve.batch.family import BuiltFamily, over_speed
from solve.batch.tables import Separated, Separation
from solve.errors import UnknownNameError
from solve.period.eigenvalues import multiplier_roundoff
from solve.period.frozen import FrozenModes
from solve.period.multipliers import VERDICTS, Multipliers, verdicts
from solve.period.points import Tables
from solve.system import in_phase
from solve.terminal import progress
from tests.solve import systems

FIGURES = ("max", "min", "max_abs", "mean", "rms")
RANGES = {
    "cam": (12.0, 90.0),
    "manipulator": (2.0, 50.0),
    "gear_pair": (100.0, 300.0),
    "mathieu": (0.4, 4.0),
    "coupler": (30.0, 700.0),
}
SAME = 1e-10
"""Relative difference that counts as none."""


def agrees(point, system, speed, **chosen):
    """Check that a point of a sweep equals the result of `periodic`, including its warnings."""
    orbit = solve.periodic(system, speed, **chosen)
    assert (point.method, point.steps, point.verdict) == (orbit.method, orbit.steps, orbit.verdict)
    assert point.spectral_radius == pytest.approx(orbit.spectral_radius, rel=SAME)
    error = orbit.error_estimate.multipliers * orbit.spectral_radius
    # An orbit computes multipliers without a digit in Φ from twice the steps.
    allowed = np.where(np.abs(orbit.multipliers) > 10 * error, SAME * orbit.spectral_radius, error)
    assert (np.abs(point.multipliers - orbit.multipliers) <= allowed).all()
    for name in (*system.coordinates, *system.outputs):
        alone, ours = orbit.statistics(name), point.statistics[name]
        for figure in FIGURES:
            difference = abs(getattr(ours, figure) - getattr(alone, figure))
            assert difference <= SAME * alone.max_abs, f"{figure} of {name} at {speed} rad/s"
    assert list(point.warnings) == orbit.warnings
    for ours, alone in zip(point.error_estimate, orbit.error_estimate, strict=True):
        # Estimates at the level of rounding are as random as that.
        assert abs(ours - alone) <= max(0.2 * alone, 3e-12), f"error estimates at {speed} rad/s"


@pytest.mark.parametrize("engine", ["numpy", "auto"])
@pytest.mark.parametrize("name", RANGES)
def test_sweep_equals_single_solutions(name, engine):
    model = solve.load(name)
    speeds = np.random.default_rng(1).uniform(*RANGES[name], 5)
    sweep = solve.sweep(model, speeds, engine=engine)
    for point, speed in zip(sweep.points, speeds, strict=True):
        agrees(point, model, float(speed))


@pytest.mark.slow
@pytest.mark.parametrize("name", RANGES)
def test_hundred_points_of_every_model_match_single_points(name):
    model = solve.load(name)
    speeds = np.random.default_rng(2).uniform(*RANGES[name], 100)
    sweep = solve.sweep(model, speeds)
    for point, speed in zip(sweep.points, speeds, strict=True):
        agrees(point, model, float(speed))


@settings(max_examples=10, deadline=None)
@given(seed=systems.seeds, n=st.integers(1, 4))
def test_batches_of_user_functions_match_single_solutions(seed, n):
    system = systems.random_system(seed, n)
    speeds = [0.6, 1.0, 1.7]
    for point, speed in zip(solve.sweep(system, speeds).points, speeds, strict=True):
        agrees(point, system, speed)


@pytest.mark.parametrize(
    ("method", "steps"),
    [("radau", 50), ("gauss", 64), (solve.Gauss(16), None), ("newmark", 200), ("rk4", None)],
)
def test_batches_with_given_methods_and_steps_match_single_solutions(method, steps):
    system = systems.random_system(3, 2)
    speeds = [0.8, 1.3]
    for point, speed in zip(solve.sweep(system, speeds, method, steps).points, speeds, strict=True):
        agrees(point, system, speed, method=method, steps=steps)


def test_batches_with_jumping_matrices_match_single_solutions():
    system, speeds = systems.meissner(), [0.7, 1.1]
    for point, speed in zip(solve.sweep(system, speeds).points, speeds, strict=True):
        agrees(point, system, speed)


def test_inseparable_entries_are_sampled_point_by_point():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return (
            one,
            0.2 * one,
            (4 + np.cos(phase + speed * np.sin(phase)))[:, None, None],
            np.cos(phase)[:, None],
        )

    system, speeds = solve.PeriodicSystem(matrices, ["q"]), [0.5, 0.9, 1.4]
    assert not Separation(over_speed(system), np.linspace(0.1, 9, 40)[:, None]).separable
    for point, speed in zip(solve.sweep(system, speeds).points, speeds, strict=True):
        agrees(point, system, speed)


def test_points_outside_the_training_region_are_detected():
    ordinary = np.column_stack((np.zeros(50), np.linspace(1, 2, 50)))

    def build(kink, delta):
        return systems.system(kinked(kink, delta), 1)

    family = BuiltFamily(build, ["kink", "delta"], ordinary, 1.0)
    separation = Separation(family, ordinary)
    _, fits = separation.coefficients(np.array([[0.0, 1.5], [0.3, 1.5]]))
    assert fits.tolist() == [True, False]


def test_small_units_are_distinguished_from_roundoff():
    """The load is a sum that cancels, in a coordinate with a large unit."""
    unit = 1e-9

    def build(kink, size):
        def matrices(phase, _):
            one = np.ones((len(phase), 1, 1))
            M = one * np.diag([1.0, unit**2])
            rounding = (size * np.sin(phase)) ** 2 + (size * np.cos(phase)) ** 2 - size**2
            d = np.stack((np.cos(phase), unit * (rounding + kink * np.cos(3 * phase))), axis=1)
            return M, 0.1 * M, 4 * M, d

        return systems.system(matrices, 2)

    points = np.column_stack((np.zeros(50), np.linspace(1, 2, 50)))
    family = BuiltFamily(build, ["kink", "size"], points, 1.0)
    _, fits = Separation(family, points).coefficients(np.array([[0.0, 1.51], [1e-12, 1.51]]))
    assert fits.tolist() == [True, False]


def kinked(kink, delta):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = delta + np.cos(phase) + kink * np.cos(3 * phase)
        return one, 0.1 * one, stiffness[:, None, None], np.ones((len(phase), 1))

    return matrices


def test_tables_are_cached_up_to_a_memory_limit(monkeypatch):
    separation = Separation(over_speed(systems.system(kinked(0.3, 2.0), 1)), np.ones((4, 1)))
    coarse, fine, finest = (np.linspace(0, end, 1000) for end in (4, 5, 6))
    requested, made = [], separation.table(coarse)
    monkeypatch.setattr(tables, "_CACHE_BYTES", 2 * made.nbytes)
    monkeypatch.setattr(Separation, "_terms", lambda self, phase: requested.append(phase[-1]) or made)
    for phase in (coarse, fine, coarse, fine, finest, fine, coarse):
        assert separation.table(phase) is made
    assert requested == [5, 6, 4]
    monkeypatch.setattr(tables, "_CACHE_BYTES", 0)
    assert separation.table(np.linspace(0, 7, 1000)) is made


@pytest.mark.parametrize("small", [1e-3, 1e-8, 1e-11])
def test_small_terms_do_not_reduce_accuracy(small):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = 3 + speed * small * np.sin(phase) + speed**2 * np.cos(2 * phase)
        return one, one, stiffness[:, None, None], one[:, 0]

    family, points = over_speed(solve.PeriodicSystem(matrices, ["q"])), np.linspace(0.1, 2.0, 60)[:, None]
    separation = Separation(family, points)
    coefficients, fits = separation.coefficients(points)
    assert fits.all()
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, 200)
    computed = Tables(separation.table(phase), coefficients, separation.entry, 1).entries()
    truth = family.entries(phase, points)
    np.testing.assert_allclose(computed, truth, rtol=0, atol=1e-14 * np.abs(truth).max())


@pytest.mark.parametrize("name", ["cam", "four_bar"])
def test_empty_batch_has_no_entries(name):
    family = over_speed(solve.load(name))
    n = family.example.n
    assert family.entries(np.array([0.1, 0.2]), np.empty((0, 1))).shape == (0, 2, 3 * n**2 + n)


def test_all_parameters_and_the_speed_may_vary_together():
    model = solve.load("cam")
    chart = solve.chart(
        model, {"speed": [40.0, 50.0, 60.0]}, {"k3": [1e8, 2e8, 3e8]}, boundaries=False, engine="numpy"
    )
    for row, k3 in enumerate(chart.y):
        varied = solve.load("cam", k3=k3)
        for column, speed in enumerate(chart.x):
            alone = solve.floquet(varied, speed)
            assert chart.spectral_radius[row, column] == pytest.approx(alone.spectral_radius, rel=SAME)


class NothingDrifts:
    """System without rigid-body drift, whose coordinates have equal units."""

    def __init__(self, n):
        self.n = n

    def rigid_body_drift(self, points, Phi, errors):
        return np.zeros(len(points), dtype=bool)

    def units(self, points):
        return np.ones((len(points), 2 * self.n))


@settings(max_examples=40, deadline=None)
@given(seed=systems.seeds, N=st.sampled_from([2, 4, 6]), decades=st.floats(0, 14))
def test_batched_multipliers_match_single_matrices(seed, N, decades):
    rng = np.random.default_rng(seed)
    Phi = rng.standard_normal((12, N, N)) @ np.diag(10.0 ** -np.linspace(0, decades, N))
    ours, finer = (
        Multipliers.from_matrices(Phi),
        Multipliers.from_matrices(Phi * (1 + 1e-6 * rng.standard_normal(Phi.shape))),
    )
    judged, errors = verdicts(Phi, ours, np.full(12, 1e-9), NothingDrifts(N // 2)), multiplier_roundoff(Phi)
    differences = ours.difference(finer)
    for k, matrix in enumerate(Phi):
        alone = Multipliers.from_matrices(matrix)
        np.testing.assert_array_equal(ours.values[k], alone.values)
        assert ours.resolved[k] == alone.resolved
        assert not ours.values[k, ours.resolved[k] :].any()
        truth = np.linalg.eigvals(matrix)
        truth = truth[np.argsort(-np.abs(truth))][: alone.resolved]
        size = np.abs(truth[0]) if len(truth) else 1.0
        for value in ours.values[k, : ours.resolved[k]]:
            assert np.abs(truth - value).min() <= 1e-7 * abs(value) + 1e-13 * size
        one = np.array([k])
        assert judged[k] == verdicts(Phi[one], ours[one], np.full(1, 1e-9), NothingDrifts(N // 2))[0]
        assert VERDICTS[judged[k]] in VERDICTS
        assert differences[k] == alone.difference(finer[k])
        assert errors[k] == multiplier_roundoff(matrix)


def eigenvalue_condition(matrix):
    """Return the error of the eigenvalues that a perturbation of 8 eps‖Φ‖ causes, from LAPACK's eigenvectors.
    Within a Jordan block of size k, which has one of these, it is the k-th root of the perturbation."""
    values, right = np.linalg.eig(matrix)
    perturbation = 8 * np.finfo(float).eps * np.linalg.norm(matrix, 2) / np.abs(values).max()
    with np.errstate(all="ignore"):
        condition = np.linalg.norm(np.linalg.pinv(right), axis=1).max()
    block = len(matrix) - np.linalg.matrix_rank(right, tol=1e-7) + 1
    return perturbation ** (1 / block) if block > 1 else min(perturbation * condition, np.sqrt(perturbation))


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(2),
        np.triu(np.ones((2, 2))),
        np.triu(np.ones((3, 3))),
        np.triu(np.ones((4, 4))),
        np.diag([1, 1, 0.5, 0.2]) + np.diag([1, 0, 0], 1),
        np.eye(4),
    ],
)
def test_bounds_cover_roundoff_of_defective_and_semisimple_multipliers(matrix):
    alone = eigenvalue_condition(matrix)
    assert 0.3 * alone <= multiplier_roundoff(matrix) <= 3 * alone


@settings(max_examples=25, deadline=None)
@given(seed=systems.seeds, n=st.integers(1, 4), scale=st.floats(0.2, 5.0))
def test_frozen_modes_lie_within_their_bounds(seed, n, scale):
    system, speeds = systems.random_system(seed, n), np.array([0.5, 1.0, 2.0])
    phase = (np.arange(32) + 0.5) * (system.period / 32)
    family = over_speed(system)
    separation = Separation(family, speeds[:, None])
    coefficients, fits = separation.coefficients(speeds[:, None])
    assert fits.all()
    fastest = np.array([fastest_of(system, phase, speed) for speed in speeds])
    rate = scale * np.median(fastest)
    alone = np.array(
        [np.abs(systems.frozen_modes(system, speed, 32).eigenvalues()).max() for speed in speeds]
    )
    shared = Separated(separation, coefficients).tables(phase)
    computed = []
    for made in (Tables.from_entries(family.entries(phase, speeds[:, None]), n), shared):
        modes = FrozenModes(made, system.period)
        exceeds = modes.exceeds_rate(rate)
        # At scale 1 the rate is the median itself: equal up to round-off is decided either way.
        assert exceeds[fastest > rate * (1 + 1e-12)].all()
        assert not exceeds[fastest < rate * (1 - 1e-12)].any()
        computed.append(modes.is_within(rate))
        assert not (computed[-1] & (alone > rate * (1 + 1e-12))).any()
        np.testing.assert_allclose(modes.phase_advance, alone * system.period, rtol=1e-9)
    assert (computed[0] == computed[1]).all(), "ranges of shared terms differ from those of the phases"


def fastest_of(system, phase, speed):
    """Return the largest frozen angular frequency or decay rate at each phase."""
    M, C, K, _ = in_phase(system, phase, speed)
    stiffness, damping = (np.abs(np.linalg.eigvals(np.linalg.solve(M, A))).max() for A in (K, C))
    return max(np.sqrt(stiffness), damping)


def test_solved_points_are_reported_as_progress():
    seen = []
    with progress.listen(lambda tracker: seen.append(tracker.tasks[0].done)):
        solve.sweep(solve.load("mathieu"), np.linspace(0.5, 3, 30))
    assert seen == sorted(seen)
    assert seen[-1] == 30


def test_unknown_engine_is_refused():
    with pytest.raises(UnknownNameError, match="did you mean 'numpy'"):
        solve.sweep(solve.load("mathieu"), [1.0], engine="numpie")


def meissner(delta=1.0, amplitude=0.5, duty=0.5):
    """Return q″ + 0.05 q′ + (delta ± amplitude) q = 1, with + over the fraction `duty` of the period. If the
    fraction is zero, the system has no jump."""

    def matrices(phase, speed):
        sign = np.where(phase % (2 * np.pi) < 2 * np.pi * duty, 1.0, -1.0)
        one = np.ones((len(phase), 1, 1))
        return one, 0.05 * one, (delta + amplitude * sign)[:, None, None] * one, one[:, 0]

    return solve.PeriodicSystem(matrices, ["q"], breaks=(0.0, 2 * np.pi * duty) if duty else ())


def meissner_turn(delta, amplitude, duty, speed):
    """Return the spectral radius of `meissner` from matrix exponentials."""
    Phi = np.eye(2)
    for sign, share in ((1.0, duty), (-1.0, 1.0 - duty)):
        rate = np.array([[0.0, 1.0], [-(delta + amplitude * sign), -0.05]])
        Phi = expm(rate * (2 * np.pi / speed * share)) @ Phi
    return np.abs(np.linalg.eigvals(Phi)).max()


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_points_with_moving_jumps_match_single_solutions(engine):
    """The batch has groups of points with common jumps, points with unique jumps, and points without
    jumps."""
    duties, deltas = np.array([0.0, 0.004, 0.3, 0.7]), np.linspace(0.6, 2.0, 5)
    chart = solve.chart(meissner, x={"duty": duties}, y={"delta": deltas}, speed=0.9, engine=engine)
    for row, delta in enumerate(deltas):
        for column, duty in enumerate(duties):
            truth = meissner_turn(delta, 0.5, duty, 0.9)
            assert chart.spectral_radius[row, column] == pytest.approx(truth, rel=1e-8)
            alone = solve.floquet(meissner(delta, 0.5, duty), 0.9, engine=engine)
            assert chart.spectral_radius[row, column] == pytest.approx(alone.spectral_radius, rel=SAME)


def test_load_between_two_close_jumps_is_included():
    """The two jumps are so close that uniform samples of the period miss the interval between them. One
    parameter acts only within it."""
    amplitudes = np.linspace(0.0, 400.0, 5)

    def pulse(height, delta):
        def matrices(phase, speed):
            inside = (phase % (2 * np.pi) > 1.0) & (phase % (2 * np.pi) < 1.001)
            one = np.ones((len(phase), 1, 1))
            return one, 0.05 * one, (delta + height * inside)[:, None, None] * one, one[:, 0]

        return solve.PeriodicSystem(matrices, ["q"], breaks=(1.0, 1.001))

    chart = solve.chart(pulse, x={"height": amplitudes}, y={"delta": np.array([1.0, 2.0])}, speed=1.0)
    for row, delta in enumerate((1.0, 2.0)):
        for column, height in enumerate(amplitudes):
            rates = [np.array([[0.0, 1.0], [-k, -0.05]]) for k in (delta, delta + height)]
            Phi = expm(rates[0] * (2 * np.pi - 0.001)) @ expm(rates[1] * 0.001)
            radius = np.abs(np.linalg.eigvals(Phi)).max()
            assert chart.spectral_radius[row, column] == pytest.approx(radius, rel=1e-8)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_sweep_of_jumping_matrices_equals_single_solutions(engine):
    system = meissner(duty=0.3)
    speeds = np.linspace(0.4, 2.0, 9)
    for point, speed in zip(
        solve.sweep(system, speeds, rtol=1e-8, engine=engine).points, speeds, strict=True
    ):
        agrees(point, system, float(speed), engine=engine)
