"""Curves evaluated together at the stages of their own steps, compared with evaluation at single
positions."""

import numpy as np
import pytest

from solve.period.curve import Curve, FourierCurve
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


@pytest.mark.parametrize("kind", [Curve, FourierCurve])
def test_antiderivative_is_periodic_with_mean_zero(kind):
    rng, grid = np.random.default_rng(7), Grid.uniform(9, 2.5, ())
    values = rng.standard_normal((9, 3))
    curve = FourierCurve.through(grid.nodes, values)[np.newaxis]
    if kind is Curve:
        curve = Curve(grid.nodes, rng.standard_normal((1, 3, 9, 4)))
    integral = curve.antiderivative()
    phase = rng.uniform(0, 2.5, 20)
    np.testing.assert_allclose(integral(phase, 1), curve(phase) - curve.mean[..., None], atol=1e-12)
    np.testing.assert_allclose(integral.mean, 0.0, atol=1e-14)
    np.testing.assert_allclose(integral(np.array([2.5 - 1e-12])), integral(np.zeros(1)), atol=1e-10)
