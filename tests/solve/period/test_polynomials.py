"""Polynomials of a curve, their derivatives, and phases outside the first period."""

import numpy as np
import pytest

from solve.period.curve import Curve, FourierCurve

NODES = np.array([0.0, 0.4, 1.0, 1.3, 2.0])
POLYNOMIALS = [
    np.polynomial.Polynomial(c) for c in ([1.0, -2.0, 0.5, 3.0, -1.0, 0.7], [0.3, 0.0, 1.0, 0, 0, -2.0])
]


@pytest.fixture(scope="module")
def quintic():
    q, v, a = (np.array([p.deriv(k)(NODES) if k else p(NODES) for p in POLYNOMIALS]).T for k in range(3))
    return Curve.quintic(NODES, q, v, a[:-1], a[1:])


@pytest.mark.parametrize("derivative", range(4))
def test_quintics_and_their_derivatives_are_reproduced(quintic, derivative):
    phase = np.linspace(0.0, 1.999, 97)
    expected = [p.deriv(derivative)(phase) if derivative else p(phase) for p in POLYNOMIALS]
    np.testing.assert_allclose(quintic(phase, derivative), expected, rtol=0, atol=1e-10)


def test_curve_accepts_unsorted_phases_of_any_period(quintic):
    phase = np.array([1.7, 0.2, 1.1])
    for turns in (-3, -1, 1, 7):
        np.testing.assert_allclose(quintic(phase + turns * 2.0), quintic(phase), rtol=0, atol=1e-12)
    assert quintic(np.array([])).shape == (2, 0)


def test_end_of_a_period_is_the_start_of_the_next(quintic):
    np.testing.assert_array_equal(quintic(np.array([2.0])), quintic(np.array([0.0])))
    before = quintic(np.array([-1e-18, np.nextafter(2.0, 0.0)]))
    np.testing.assert_allclose(before[:, 1], [p(2.0) for p in POLYNOMIALS], rtol=1e-12)


@pytest.mark.parametrize("derivative", range(4))
def test_trigonometric_interpolant_and_its_derivatives(derivative):
    period = 3.0
    nodes = np.linspace(0.0, period, 8)
    omega = 2 * np.pi / period

    def q(phase, k):
        return np.array([0.4 * (k == 0) + (2 * omega) ** k * np.cos(2 * omega * phase + 0.3 + k * np.pi / 2)])

    curve = FourierCurve.through(nodes, q(nodes[:-1], 0).T)
    phase = np.linspace(-4.0, 4.0, 57)
    np.testing.assert_allclose(curve(phase, derivative), q(phase, derivative), rtol=0, atol=1e-12)
