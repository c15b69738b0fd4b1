"""Search for edges, with functions in place of solutions."""

import numpy as np
import pytest

from solve.results.points import KINDS
from solve.studies.boundaries import BoundarySearch, Lines
from solve.studies.stability_samples import StabilitySamples

OUT_ABOVE, BACK, OUT_BELOW = 0.3, 0.6, 0.7


@pytest.mark.parametrize("far", [0.9, 1.0, 1.3])
@pytest.mark.parametrize("turned", [False, True])
def test_intermediate_edge_of_another_kind_costs_at_most_bisection(far, turned):
    """A multiplier is beyond +1 between 0.3 and 0.6, and another one beyond -1 from 0.7 on. Either edge is
    located to within 1e-9."""
    evaluated = 0

    def evaluate(points):
        nonlocal evaluated
        evaluated += len(points)
        x = points[:, 0]
        above = 1.0 + 2.0 * (x - OUT_ABOVE) * (BACK - x)
        below = -1.0 - 0.5 * (x - OUT_BELOW)
        rho = np.column_stack((above, below)) * (-1.0 if turned else 1.0)
        stable = (np.abs(rho) < 1.0).all(axis=1)
        return StabilitySamples.from_multipliers(points, stable, ~stable, rho.astype(complex))

    search = BoundarySearch(evaluate, np.array([1.0]), 1e-9)
    places, kinds = search.edges(evaluate(np.array([[0.0]])), evaluate(np.array([[far]])))
    edges = {OUT_ABOVE: "-1" if turned else "+1", OUT_BELOW: "+1" if turned else "-1"}
    edge = min(edges, key=lambda each: abs(each - places[0, 0]))
    assert places[0, 0] == pytest.approx(edge, abs=1e-9)
    assert KINDS[kinds[0]] == edges[edge]
    assert evaluated < 80


@pytest.mark.parametrize("edges", [1, 40, 2000])
def test_smooth_edges_are_found_in_few_calls(edges):
    """ρ = 1 + f(x), where slope and curvature of f have similar effects: a chord over the bracket misses the
    zero by a tenth."""
    zeros, calls = np.linspace(0.2, 0.8, edges), []

    def evaluate(points):
        calls.append(len(points))
        x = points[:, 0] - zeros[points[:, 1].astype(int)]
        rho = np.column_stack((1.0 + x + x**2 / 2 + x**3 / 20, np.full(len(x), 0.1)))
        stable = rho[:, 0] < 1.0
        return StabilitySamples.from_multipliers(points, stable, ~stable, rho.astype(complex))

    def at(x):
        return evaluate(np.column_stack((np.full(edges, x), np.arange(edges))))

    ends, calls = (at(0.0), at(1.0), at(-0.4)), []
    places, kinds = BoundarySearch(evaluate, np.array([1.0, 1.0]), 1e-9).edges(*ends)
    np.testing.assert_allclose(places[:, 0], zeros, atol=1e-9)
    assert (kinds == KINDS.index("+1")).all()
    assert len(calls) <= 6
    assert sum(calls) <= max(64, 10 * edges)


@pytest.mark.parametrize("damped", [True, False])
def test_edges_of_complex_pairs_are_found_in_few_calls(damped):
    """With damping, a pair crosses the circle; without damping, two pairs meet there and leave it."""
    edges, evaluated = 200, 0
    zeros = np.linspace(0.2, 0.8, edges)

    def evaluate(points):
        nonlocal evaluated
        evaluated += len(points)
        x = points[:, 0] - zeros[points[:, 1].astype(int)]
        root = np.sqrt(-(x + x**2 / 2).astype(complex))
        first, second = (1.0 + x + x**2 / 2, 0.5) if damped else (np.exp(1j * root), np.exp(-1j * root))
        pair = np.exp(1j) * np.column_stack((first, np.broadcast_to(second, first.shape)))
        rho = np.column_stack((pair, pair.conj()))
        rho = np.take_along_axis(rho, np.argsort(-np.abs(rho), axis=1, kind="stable"), axis=1)
        stable = np.abs(rho[:, 0]) < 1.0 + 1e-12
        return StabilitySamples.from_multipliers(points, stable, ~stable, rho)

    stable, unstable = (evaluate(np.column_stack((np.full(edges, x), np.arange(edges)))) for x in (0.0, 1.0))
    evaluated = 0
    places, kinds = BoundarySearch(evaluate, np.array([1.0, 1.0]), 1e-9).edges(stable, unstable)
    np.testing.assert_allclose(places[:, 0], zeros, atol=1e-9)
    assert (kinds == KINDS.index("complex")).all()
    assert evaluated <= 16 * edges


@pytest.mark.parametrize("back", [0.35, 0.4, 0.5])
def test_stable_interval_ends_where_a_third_multiplier_leaves(back):
    """One multiplier is beyond -1 up to 0.3, and another one beyond +1 from 0.7 on. A third one beyond +1 up
    to `back` shortens the stable interval."""

    def evaluate(points):
        x = points[:, 0]
        third = 1.0 + 2.0 * (back - x) * (x - 0.1)
        rho = np.column_stack((1.0 + x - 0.7, third, -1.0 + (x - 0.3)))
        rho = np.take_along_axis(rho, np.argsort(-np.abs(rho), axis=1), axis=1)
        stable = (np.abs(rho) < 1.0).all(axis=1)
        return StabilitySamples.from_multipliers(points, stable, ~stable, rho.astype(complex))

    known = evaluate(np.array([[0.0], [1.0]]))
    (computed,) = BoundarySearch(evaluate, np.array([1.0]), 1e-9).crossings(Lines(known, np.zeros(2), 0))
    np.testing.assert_allclose(np.sort(computed.place), [back, 0.7], atol=1e-9)
    assert [KINDS[kind] for kind in computed.kind] == ["+1", "+1"]
