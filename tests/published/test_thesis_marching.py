"""Thesis 6.8: marching to the periodic solution at 62 rad/s, one element a link, ζ = 2 %."""

import numpy as np

import solve


def test_marching_from_rest_takes_24_cycles_to_1e_4_and_not_31():
    """For every coordinate; for each alone 23 or 24, by the largest modulus 0.6743 of the multipliers."""
    found = solve.transient(solve.load("four_bar"), "62 rad/s", turns=32, rtol=1e-4)
    assert found.reached == 24
    last = np.array([np.flatnonzero(column > 1e-4).max() + 1 for column in found.distances.T])
    assert (last.min(), last.max()) == (23, 24)
