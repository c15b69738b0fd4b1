"""Steps of one period, and the sides of jumps on which stages lie."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solve.period.grid import Grid

PERIOD = 3.0


def test_without_breaks_the_steps_are_equal():
    grid = Grid.uniform(12, PERIOD)
    np.testing.assert_allclose(grid.h, 0.25, rtol=1e-15)
    assert (grid.steps, grid.period, grid.smooth) == (12, PERIOD, True)
    np.testing.assert_allclose(grid.stages(np.array([0.5, 1.0]))[3], [0.875, 1.0])


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=5), st.integers(5, 60))
def test_every_break_is_a_node_for_any_origin(breaks, steps):
    grid = Grid.uniform(steps, PERIOD, tuple(breaks))
    for phase in breaks:
        distance = np.abs(grid.nodes - phase % PERIOD).min()
        assert min(distance, abs(PERIOD - phase % PERIOD)) <= 1e-13 * PERIOD
    assert (grid.h > 0).all()
    assert (grid.nodes[0], grid.nodes[-1]) == (0.0, PERIOD)
    assert not grid.smooth
    assert grid.steps == pytest.approx(steps, abs=len(breaks) + 1)


def test_only_nodes_at_breaks_are_marked():
    inner = Grid.uniform(10, PERIOD, (0.6, 1.5))
    np.testing.assert_allclose(inner.nodes[:-1][inner.at_break], [0.6, 1.5])
    wrapped = Grid.uniform(10, PERIOD, (PERIOD, -1.5))
    np.testing.assert_allclose(wrapped.nodes[:-1][wrapped.at_break], [0.0, 1.5])


def test_stages_do_not_cross_a_jump():
    jump = 1.1
    stages = Grid.uniform(9, PERIOD, (0.0, jump)).stages(np.array([0.0, 0.5, 1.0]))
    nodes = Grid.uniform(9, PERIOD, (0.0, jump)).nodes
    into = np.flatnonzero(nodes == jump)[0]
    assert stages[into - 1, 2] < jump < stages[into, 0]
    assert stages[0, 0] > 0.0
    assert stages[-1, 2] < PERIOD
    np.testing.assert_allclose(stages[:, [0, 2]], np.column_stack((nodes[:-1], nodes[1:])), atol=1e-12)


@pytest.mark.parametrize(
    "breaks", [(1.0, 1.0 + 1e-15), (1.0 - 1e-15, 1.0), (1.0, 0.0, PERIOD - 1e-15), (-1e-20, 1.0)]
)
def test_breaks_that_differ_by_rounding_are_one_break(breaks):
    grid = Grid.uniform(10, PERIOD, (0.0, *breaks))
    assert grid.h.min() > 0.2
    np.testing.assert_allclose(grid.nodes[:-1][grid.at_break], [0.0, 1.0], atol=1e-14)


@given(st.sets(st.integers(1, 9999), min_size=1, max_size=5), st.integers(6, 2000))
def test_finer_grids_have_more_steps_in_every_interval(places, steps):
    """Otherwise, two grids would agree inside an interval that neither resolves."""
    breaks = tuple(place * PERIOD / 10_000 for place in sorted(places))
    edges = np.array([0.0, *breaks, PERIOD]) - 1e-6

    def counts(steps):
        return np.histogram(Grid.uniform(steps, PERIOD, breaks).nodes[:-1], edges)[0]

    assert (counts(2 * steps) > counts(steps)).all()
    if steps >= 6 * len(edges):
        assert (counts(math.ceil(4 * steps / 3)) > counts(steps)).all()
