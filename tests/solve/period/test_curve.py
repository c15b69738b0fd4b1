"""Curves evaluated together at the stages of their own steps, compared with evaluation at single
positions."""

import numpy as np
import pytest

from solve.period.curve import Curve
from solve.period.grid import Grid


@pytest.mark.parametrize("breaks", [(), (1.0, 2.5)])
def test_states_at_stages_match_the_piecewise_polynomials(breaks):
    rng = np.random.default_rng(1)
    grid = Grid.uniform(12, 2 * np.pi, breaks)
    curve = Curve(grid.nodes, rng.standard_normal((2, grid.steps, 6)))
    c = np.array([0.0, 0.3, 0.8, 1.0])
    computed = curve.states(grid.stages(c).ravel())
    for order in range(3):
        for q, values in enumerate(computed[order]):
            for step, h in enumerate(grid.h):
                piece = np.polynomial.Polynomial(curve.coefficients[q, step]).deriv(order)
                expected = piece(c) / h**order
                np.testing.assert_allclose(
                    values.reshape(grid.steps, 4)[step], expected, rtol=1e-9, atol=1e-9
                )


def test_sequence_of_phases_does_not_matter():
    rng = np.random.default_rng(2)
    grid = Grid.uniform(8, 1.5)
    curve = Curve(grid.nodes, rng.standard_normal((3, 8, 5)))
    phase = grid.stages(np.array([0.2, 0.7])).ravel()
    mixed = rng.permutation(len(phase))
    for whole, apart in zip(curve.states(phase), curve.states(phase[mixed] + 3.0), strict=True):
        np.testing.assert_allclose(apart, whole[:, mixed], rtol=1e-9, atol=1e-9)
