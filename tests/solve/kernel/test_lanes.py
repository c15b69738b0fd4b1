"""Batches of points in compiled code compared with NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import solve
from solve.batch.family import BuiltFamily, over_speed
from solve.batch.tables import Sampled, Separated, Separation
from solve.kernel.engines import COMPILED, NUMPY
from solve.kernel.library import Size, trouble
from solve.period.grid import Grid
from tests.solve import systems

SAME = 1e-12
SMALL = Size(1, 1, 2, True, False)


needs_compiler = pytest.mark.skipif(bool(trouble()), reason=trouble() or "compiles")


def grids(family, points, n, method, steps, orbit=True, own=False, period=2 * np.pi, breaks=()):
    """Solution of the same grid by both engines: compiled, NumPy."""
    if own:
        chunk = Sampled(family, points, breaks=breaks)
    else:
        separation = Separation(family, points, breaks=breaks)
        coefficients, fits = separation.coefficients(points)
        assert fits.all()
        chunk = Separated(separation, coefficients)
    grid = Grid.uniform(steps, period, breaks)
    return [method.solutions(chunk, grid, orbit, engine) for engine in (COMPILED, NUMPY)]


def same(ours, theirs):
    size = np.maximum(np.abs(theirs.Phi).max(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    assert (np.abs(ours.Phi - theirs.Phi) <= SAME * size).all()
    assert {at: str(why) for at, why in ours.failures.items()} == {
        at: str(why) for at, why in theirs.failures.items()
    }
    if theirs.curve is not None:
        sound = np.setdiff1d(np.arange(len(theirs)), list(theirs.failures))
        q, truth = (each.curve.sampled(4)[sound] for each in (ours, theirs))
        size = np.abs(truth).max(axis=2, keepdims=True)
        assert (np.abs(q - truth) <= SAME * size).all()
        np.testing.assert_allclose(ours.condition[sound], theirs.condition[sound], rtol=0.5)


@needs_compiler
@settings(max_examples=20, deadline=None)
@given(
    seed=systems.seeds,
    n=st.sampled_from([1, 2, 3]),
    method=st.sampled_from([solve.Radau(5), solve.Radau(), solve.Gauss(4), solve.Gauss(), solve.Gauss(16)]),
    steps=st.sampled_from([7, 16, 50, 64]),
    points=st.sampled_from([1, 8, 11]),
    orbit=st.booleans(),
)
def test_grids_agree_between_engines(seed, n, method, steps, points, orbit):
    family = over_speed(systems.random_system(seed, n))
    same(*grids(family, np.linspace(0.7, 1.4, points)[:, None], n, method, steps, orbit))


@needs_compiler
@pytest.mark.parametrize(("steps", "own", "orbit"), [(16, False, True), (16, True, False), (7, True, True)])
def test_points_with_many_coordinates_agree_between_engines(steps, own, orbit):
    family = over_speed(systems.random_system(4, 17))
    same(*grids(family, np.array([[0.9], [1.0], [1.3]]), 17, solve.Radau(), steps, orbit, own))


@needs_compiler
@pytest.mark.parametrize("seed", range(3))
def test_accelerations_are_accurate_in_any_units(seed):
    """Terms that act on one coordinate are not mixed with terms that act on another."""
    bare, unit = systems.random_matrices(seed, 3), np.array([1e-4, 1.0, 1e5])

    def matrices(phase, speed):
        *both, d = bare(phase, speed)
        return *(A * unit[:, None] * unit for A in both), d * unit

    family = over_speed(systems.system(matrices, 3))
    computed = grids(family, np.array([[0.9], [1.1]]), 3, solve.Gauss(), 64)
    ours, theirs = (each.curve.coefficients for each in computed)
    size = np.abs(theirs[..., 0]).max(axis=-1)
    assert (np.abs(ours - theirs).max(axis=(2, 3)) <= 1e-8 * size).all()


@needs_compiler
@settings(max_examples=20, deadline=None)
@given(
    seed=systems.seeds,
    n=st.sampled_from([1, 2, 3]),
    method=st.sampled_from([solve.Radau(5), solve.Radau(), solve.Gauss(4), solve.Gauss()]),
    ends=st.sampled_from([(0.0, 1.0), (0.7, 0.75), (2.0, 6.0)]),
    points=st.sampled_from([1, 8, 11]),
    own=st.booleans(),
    orbit=st.booleans(),
)
def test_grids_with_jumps_agree_between_engines(seed, n, method, ends, points, own, orbit):
    smooth = systems.random_system(seed, n)

    def matrices(phase, speed):
        M, C, K, d = smooth.at(phase, speed)
        inside = (ends[0] < phase % (2 * np.pi)) & (phase % (2 * np.pi) < ends[1])
        share = np.where(inside, 1.3, 1.0)
        return M, C, share[:, None, None] * K, share[:, None] * d

    family = over_speed(solve.PeriodicSystem(matrices, smooth.coordinates, breaks=ends))
    speeds = np.linspace(0.7, 1.4, points)[:, None]
    same(*grids(family, speeds, n, method, 48, orbit, own, breaks=ends))


@needs_compiler
@pytest.mark.parametrize("method", [solve.Radau(), solve.Gauss()], ids=["radau", "gauss"])
@pytest.mark.parametrize("own", [False, True], ids=["separated", "sampled"])
def test_stiff_cam_agrees_between_engines(method, own):
    family, speeds = over_speed(systems.cam()), np.linspace(30.0, 80.0, 10)[:, None]
    same(*grids(family, speeds, 3, method, 256, own=own))


@needs_compiler
@pytest.mark.parametrize("method", [solve.Radau(), solve.Gauss()], ids=["radau", "gauss"])
def test_rows_are_exchanged_if_pivots_vanish(method):
    def swapped(stiffness):
        def matrices(phase, speed):
            M = np.tile([[0.0, 1.0], [1.0, 0.0]], (len(phase), 1, 1))
            K = np.zeros((len(phase), 2, 2))
            K[:, 0, 1] = K[:, 1, 0] = stiffness + np.cos(phase)
            return M, 0.1 * M, K, np.ones((len(phase), 2))

        return systems.system(matrices, 2)

    points = np.linspace(2, 3, 9)[:, None]
    same(*grids(BuiltFamily(swapped, ["stiffness"], points, 1.0), points, 2, method, 32))


@needs_compiler
def test_overflow_and_resonance_are_reported_as_failures():
    def matrices(delta):
        def of(phase, speed):
            one = np.ones((len(phase), 1, 1))
            return one, 0 * one, delta * one, np.cos(phase)[:, None]

        return systems.system(of, 1)

    points = np.array([[-1e5], [0.5], [1.0], [2.0]])
    family = BuiltFamily(lambda delta: matrices(delta), ["delta"], points, 1.0)
    for grid in grids(family, points, 1, solve.Gauss(), 256):
        failures = {at: type(why).__name__ for at, why in grid.failures.items()}
        assert failures.pop(0) == "StepsError"
        if not failures:
            assert grid.condition[2] > 1e12
        else:
            assert failures == {2: "ResonanceError"}


@needs_compiler
@pytest.mark.parametrize("name", ["cam", "manipulator", "gear_pair", "mathieu", "coupler"])
def test_sweeps_agree_between_engines(name):
    model = solve.load(name)
    speeds = np.linspace(1.0, 1.2, 9) * {"mathieu": 1.0, "gear_pair": 180.0}.get(name, 50.0)
    ours, theirs = (solve.sweep(model, speeds, engine=engine) for engine in ("compiled", "numpy"))
    np.testing.assert_allclose(ours.spectral_radius, theirs.spectral_radius, rtol=SAME)
    for quantity in (*model.coordinates, *model.outputs):
        high = np.abs(theirs.figures(quantity))
        for figure in ("max", "min", "rms"):
            difference = np.abs(ours.figures(quantity, figure) - theirs.figures(quantity, figure))
            assert (difference <= SAME * high).all(), f"{figure} of {quantity}"
