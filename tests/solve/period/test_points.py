"""A system solved alone and among hundreds of others: the same bytes, steps, verdicts and warnings."""

import numpy as np
import pytest

from solve import Gauss, Newmark, Radau, RungeKutta4
from solve.certify.certified import Certified
from solve.certify.refinement import certified
from solve.equations import entries_of
from solve.kernel.engines import COMPILED, NUMPY
from solve.kernel.library import trouble
from solve.methods.hsu import Hsu
from solve.methods.march import March
from solve.methods.modal import Modal
from solve.period.frozen import frozen
from solve.period.grid import Grid
from solve.period.points import Points, Tables, matrices
from solve.single import request
from solve.system import in_phase
from tests.solve import systems

ONE_STEP = [Radau(), Radau(3), Gauss(), Gauss(16), Newmark(), Newmark(0.6, 0.3), RungeKutta4(), Hsu()]
ENGINES = [
    NUMPY,
    pytest.param(COMPILED, marks=pytest.mark.skipif(bool(trouble()), reason=trouble() or "compiles")),
]
SEEDS, PLACE = range(8), 217


class Several(Points):
    """Batch of systems at speed 1, each evaluated by itself. `which` (P,) are the numbers of the systems."""

    def __init__(self, each, which):
        super().__init__(each[0].n, 2 * np.pi)
        self.each, self.which = each, which

    def __len__(self):
        return len(self.which)

    def __getitem__(self, positions):
        return Several(self.each, self.which[positions])

    def tables(self, phase):
        numbers, places = np.unique(self.which, return_inverse=True)
        entries = np.array([entries_of(self.each[number], phase, 1.0) for number in numbers])
        return Tables.from_entries(entries[places], self.n)


@pytest.fixture(scope="module", params=[(1, 1000), (2, 250), (3, 250)], ids=["1", "2", "3"])
def points(request):
    """Batch of points that cycle through eight systems, one of which occurs only once, at PLACE."""
    n, count = request.param
    each = tuple(systems.random_system(seed, n) for seed in (*SEEDS, 77))
    which = np.arange(count) % len(SEEDS)
    which[PLACE] = len(SEEDS)
    return Several(each, which)


def alone_and_among(points, solved):
    place = np.array([PLACE])
    return solved(points[place]), solved(points)[place]


@pytest.mark.parametrize("method", [*ONE_STEP, March(), Modal()], ids=repr)
def test_one_grid_gives_the_same_bytes(method, points):
    grid = Grid.uniform(20, points.period)
    if isinstance(method, March):
        points = points[np.arange(PLACE - 20, PLACE + 1)]
        place = np.array([20])
    else:
        place = np.array([PLACE])
    one, other = method.solutions(points[place], grid, True), method.solutions(points, grid, True)
    assert not one.failures
    np.testing.assert_array_equal(one.Phi[0], other.Phi[place[0]])
    np.testing.assert_array_equal(one.curve.coefficients[0], other.curve.coefficients[place[0]])
    assert one.condition[0] == other.condition[place[0]] or np.isnan(one.condition[0])


@pytest.mark.skipif(bool(trouble()), reason=trouble() or "compiles")
@pytest.mark.parametrize("method", ONE_STEP[:4], ids=repr)
@pytest.mark.parametrize("steps", [48, 50])
def test_one_grid_compiled_differs_by_rounding(method, steps, points):
    one, other = alone_and_among(
        points, lambda some: method.solutions(some, Grid.uniform(steps, points.period), True, COMPILED)
    )
    allowed = 1e-13 * one.condition[0]
    assert np.abs(one.Phi - other.Phi).max() <= allowed * np.abs(one.Phi).max()
    q, truth = one.curve.sampled(2), other.curve.sampled(2)
    assert np.abs(q - truth).max() <= allowed * np.abs(truth).max()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("steps", [None, 30])
@pytest.mark.parametrize("method", ONE_STEP, ids=repr)
def test_steps_verdicts_and_warnings_are_the_same(method, steps, engine, points):
    points = points[np.arange(PLACE - 16, PLACE + 1)]
    rtol = {1: 1e-1, 2: 1e-2}.get(method.order, 1e-5)
    requested = request(steps, rtol, engine, orbit=True)

    def computed(some, position):
        for result in certified(some, method, requested):
            if isinstance(result, Certified):
                for at in np.flatnonzero(result.positions == position):
                    return result.steps, result.verdicts[at], result.warnings(int(at)), result.errors[at]
            elif result.position == position:
                return str(result.reason)
        raise AssertionError("a point without a result")

    alone, among = computed(points[np.array([16])], 0), computed(points, 16)
    if isinstance(alone, str):
        assert alone == among
        return
    assert alone[:2] == among[:2]
    assert [text.split(" to ")[0] for text in alone[2]] == [text.split(" to ")[0] for text in among[2]]
    if engine == NUMPY:
        assert alone[2] == among[2]
        np.testing.assert_array_equal(alone[3], among[3])


def test_batched_matrices_match_each_point(points):
    phase = np.linspace(0.0, 6.0, 5)
    for part, own in zip(matrices(points, phase), in_phase(points.each[-1], phase, 1.0), strict=True):
        np.testing.assert_array_equal(part[PLACE], own)


def test_equation_factors_match_each_single_point():
    """The points have equations in their own units and in other units."""
    far = 2.0 ** np.array([0, 30, -30])

    def in_units(seed, units):
        given = systems.random_system(seed, 3)

        def matrices(phase, speed):
            M, C, K, d = given.at(phase, speed)
            return (*(units[:, None] * part for part in (M, C, K)), units * d)

        return systems.system(matrices, 3)

    each = tuple(in_units(seed, units) for seed in SEEDS for units in (np.ones(3), far))
    points = Several(each, np.arange(len(each)))
    factors = frozen(points).equation_factors()
    assert factors is not None
    assert (factors[::2] == 1).all()
    for at, own in enumerate(factors):
        alone = frozen(points[np.array([at])]).equation_factors()
        np.testing.assert_array_equal(own, np.ones(3) if alone is None else alone[0])
        assert np.ptp(np.log2(own * (far if at % 2 else 1.0))) <= 2
