"""The search for edges, with a judge that solves nothing."""

import numpy as np
import pytest

from solve.results.points import KINDS
from solve.studies.boundaries import Judged, Search

OUT_ABOVE, BACK, OUT_BELOW = 0.3, 0.6, 0.7


@pytest.mark.parametrize("far", [0.9, 1.0, 1.3])
@pytest.mark.parametrize("turned", [False, True])
def test_an_edge_of_another_kind_in_between_costs_no_more_than_bisection(far, turned):
    """Beyond +1 between 0.3 and 0.6, beyond -1 from 0.7 on: whichever edge is found, within 1e-9."""
    judged = 0

    def judge(points):
        nonlocal judged
        judged += len(points)
        x = points[:, 0]
        above = 1.0 + 2.0 * (x - OUT_ABOVE) * (BACK - x)
        below = -1.0 - 0.5 * (x - OUT_BELOW)
        rho = np.column_stack((above, below)) * (-1.0 if turned else 1.0)
        stable = (np.abs(rho) < 1.0).all(axis=1)
        return Judged(points, stable, ~stable, rho.astype(complex))

    search = Search(judge, np.array([1.0]), 1e-9)
    places, kinds = search.edges(judge(np.array([[0.0]])), judge(np.array([[far]])))
    edges = {OUT_ABOVE: "-1" if turned else "+1", OUT_BELOW: "+1" if turned else "-1"}
    edge = min(edges, key=lambda each: abs(each - places[0, 0]))
    assert places[0, 0] == pytest.approx(edge, abs=1e-9)
    assert KINDS[kinds[0]] == edges[edge]
    assert judged < 80
