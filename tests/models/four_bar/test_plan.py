"""Paths through a map of stresses: smallest cap, corridor, and plan."""

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order

from models.four_bar.plan import Plan, arrival, least_cap, plan_below

SPEEDS = np.linspace(10.0, 30.0, 81)
LENGTHS = np.linspace(0.5, 0.6, 41)
OWN = 10
"""L4 = 0.525 m."""


def valley(width=0.006):
    """Stress ratios with a ridge at 22 rad/s, at which only L4 near 0.57 m has ratios below 1."""
    speed, L4 = np.meshgrid(SPEEDS, LENGTHS, indexing="ij")
    ridge = np.exp(-(((speed - 22) / 1.0) ** 2)) * np.minimum(((L4 - 0.57) / width) ** 2, 30)
    return 0.5 + 0.01 * (speed - 10) + ridge


def test_arrival_is_the_minimax_ratio_of_all_paths():
    """Compared with breadth-first search for every cap, on small random maps."""
    for seed in range(5):
        ratio = np.random.default_rng(seed).random((5, 4))
        P, g = ratio.shape
        number = np.arange(P * g).reshape(P, g)
        pairs = np.concatenate(
            [
                np.column_stack((number[:-1].ravel(), number[1:].ravel())),
                np.column_stack((number[:, :-1].ravel(), number[:, 1:].ravel())),
                np.column_stack((number[:, 1:].ravel(), number[:, :-1].ravel())),
            ]
        )
        least = np.full(P * g, np.inf)
        for cap in np.sort(ratio.ravel())[::-1]:
            below = ratio.ravel() <= cap
            kept = pairs[below[pairs].all(axis=1)]
            graph = csr_array((np.ones(len(kept)), kept.T), shape=(P * g, P * g))
            for start in np.flatnonzero(below[:g]):
                least[breadth_first_order(graph, start, return_predecessors=False)] = cap
        np.testing.assert_array_equal(arrival(ratio).ravel(), least)


@pytest.mark.parametrize("returns", [False, True])
def test_plan_passes_through_valley_of_ratios(returns):
    ratio = valley()
    plan = plan_below(SPEEDS, LENGTHS, ratio, 0.9, OWN, 0.02, returns)
    assert plan is not None
    L4 = plan(SPEEDS)
    along = [np.interp(x, LENGTHS, row) for x, row in zip(L4, ratio, strict=True)]
    assert max(along) <= 0.9 + 1e-9
    assert L4[0] == pytest.approx(0.525)
    assert np.abs(np.diff(L4) / np.diff(SPEEDS)).max() <= 0.02 + 1e-9
    # Nothing moves that need not: far below the ridge L4 is its own.
    assert plan(np.array([12.0, 15.0])) == pytest.approx(0.525)


def test_slower_pivot_requires_a_higher_cap():
    ratio = valley()
    slow, fast = (least_cap(SPEEDS, LENGTHS, ratio, OWN, rate, False) for rate in (0.002, 0.05))
    assert fast == pytest.approx(arrival(ratio)[-1].min(), rel=2e-3)
    # 20 mm are left for the pivot to go from 10 rad/s on; at 22 rad/s it is at 0.549 m at most.
    assert slow > 5
    assert plan_below(SPEEDS, LENGTHS, ratio, slow, OWN, 0.002, False) is not None
    assert plan_below(SPEEDS, LENGTHS, ratio, 0.99 * slow, OWN, 0.002, False) is None


def test_closed_barrier_has_no_plan():
    ratio = valley()
    ratio[48] = 2.0
    assert plan_below(SPEEDS, LENGTHS, ratio, 1.0, OWN, 0.02, False) is None
    assert least_cap(SPEEDS, LENGTHS, ratio, OWN, 0.02, False) == pytest.approx(2.0, rel=2e-3)


def test_rounded_plan_is_the_mean_over_the_speeds_ahead():
    """The mean is computed as a sum. At the last speed, the pivot is at rest."""
    plan = Plan(np.array([10.0, 18.0, 22.0, 30.0]), np.array([0.52, 0.52, 0.57, 0.55]), lead=0.5)
    speed = np.array([9.0, 10.0, 17.8, 18.0, 20.0, 21.7, 25.0, 29.8, 30.0, 31.0])
    value, slope, bend = plan.rounded(speed)
    middles = (np.arange(20_000) + 0.5) / 20_000 * 0.5
    assert value == pytest.approx([plan(x + middles).mean() for x in speed], abs=1e-9)
    near = 1e-5
    ahead, behind = plan.rounded(speed + near), plan.rounded(speed - near)
    inner = np.array([0, 2, 4, 5, 6, 7, 9])
    assert slope[inner] == pytest.approx((ahead[0] - behind[0])[inner] / (2 * near), abs=1e-8)
    assert bend[inner] == pytest.approx((ahead[1] - behind[1])[inner] / (2 * near), abs=1e-8)
    assert slope[-2:] == pytest.approx(0.0)
