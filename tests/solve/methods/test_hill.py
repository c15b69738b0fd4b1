"""Hill's determinant: stability boundaries in any parameter, multipliers, orbits."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from solve import floquet, periodic
from solve.errors import ValueOutOfBoundsError
from solve.methods.gauss import Gauss
from solve.methods.hill import boundaries, determinant
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import constant, random_system, system

EPSILONS = [-10.0, -3.0, 0.5, 3.0, 10.0]
ORDERS = range(7)


def mathieu(delta, epsilon, damping=0.0):
    """System q″ + damping q′ + (delta + epsilon cos 2t) q = 0."""

    def matrices(phase, speed):
        one, zero = np.ones((len(phase), 1, 1)), np.zeros((len(phase), 1))
        return one, damping * one, (delta + epsilon * np.cos(2 * phase))[:, None, None], zero

    return system(matrices, 1, period=np.pi)


def characteristic(epsilon, multiplier):
    """Values a_k and b_k from SciPy with solutions of period π (k even) or 2π (k odd). The sign of ε only
    interchanges those of odd k."""
    first = 0 if multiplier == 1 else 1
    q = abs(epsilon) / 2
    values = [mathieu_a(k, q) for k in ORDERS[first::2]] + [mathieu_b(k, q) for k in ORDERS[first::2] if k]
    return np.sort(values)


@pytest.mark.parametrize("multiplier", [1, -1])
@pytest.mark.parametrize("epsilon", EPSILONS)
def test_boundaries_of_mathieus_equation(epsilon, multiplier):
    truth = characteristic(epsilon, multiplier)
    truth = truth[truth < 28.0]
    computed = boundaries(
        lambda delta: (mathieu(delta, epsilon), 1.0), np.linspace(-9.0, 28.0, 75), multiplier
    )
    narrow = epsilon == 0.5  # b_k and a_k of k ≥ 4 are closer than 1e-7: a pair in one, or none
    if narrow:
        near = np.abs(truth[:, None] - [each.value for each in computed]).min(axis=0)
        assert len(computed) >= 3
        assert near.max() < 1e-8
        return
    assert len(computed) == len(truth)
    for each, true in zip(computed, truth, strict=True):
        assert abs(each.value - true) < 1e-8
        assert abs(each.value - true) <= 10 * each.error
        assert each.multiplier == multiplier


@pytest.mark.parametrize("multiplier", [1, -1])
@pytest.mark.parametrize("epsilon", EPSILONS)
def test_determinant_and_multipliers_agree_with_mathieus_values(epsilon, multiplier):
    """Two further conditions for the same boundaries: the determinant is zero, and ρ1 + ρ2 = ±2."""

    def trace(delta):
        values = floquet(mathieu(delta, epsilon), 1.0, Gauss(16), rtol=1e-12).multipliers
        return float(np.sum(values).real) - 2 * multiplier

    truth = characteristic(epsilon, multiplier)[:5]
    gaps = np.diff([-20.0, *truth])
    for value, near in zip(truth[:4], np.minimum(gaps[:-1], gaps[1:]), strict=True):
        if near < 1e-4:
            continue
        low, high = value - 0.3 * min(near, 1.0), value + 0.3 * min(near, 1.0)
        for function in (lambda delta: determinant(mathieu(delta, epsilon), 1.0, 24, multiplier), trace):
            assert abs(brentq(function, low, high, xtol=1e-12) - value) < 1e-8


def test_close_pair_of_boundaries_between_two_values_is_found():
    """b_2 and a_2 differ by 5e-3; the distance of the values is 0.7."""
    computed = boundaries(lambda delta: (mathieu(delta, 0.2), 1.0), np.arange(2.0, 8.0, 0.7))
    assert [each.value for each in computed] == pytest.approx(
        [mathieu_b(2, 0.1), mathieu_a(2, 0.1)], abs=1e-8
    )


@pytest.mark.parametrize("multiplier", [1, -1])
def test_boundaries_in_speed_have_a_multiplier_on_the_circle(multiplier):
    """The system is damped, so that Mathieu's closed form does not apply to the boundaries."""
    damped = mathieu(1.0, 0.6, damping=0.05)
    computed = boundaries(lambda speed: (damped, speed), np.linspace(0.4, 1.6, 61), multiplier)
    assert computed
    for each in computed:
        values = floquet(damped, each.value, rtol=1e-12).multipliers
        assert np.abs(values - multiplier).min() < 1e-8
        low, high = (floquet(damped, each.value * (1 + s), rtol=1e-10).verdict for s in (-1e-5, 1e-5))
        assert {low, high} == {"unstable", "asymptotically stable"}


def test_boundaries_of_coupled_coordinates_in_a_parameter():
    def coupled(epsilon):
        def matrices(phase, speed):
            K = np.array([[1.0, 0.2], [0.2, 3.0]]) + np.cos(phase)[:, None, None] * [
                [epsilon, 0],
                [0, -epsilon],
            ]
            eye = np.broadcast_to(np.eye(2), K.shape)
            return eye, 0.02 * eye, K, np.zeros((len(phase), 2))

        return system(matrices, 2), 2.0

    computed = boundaries(coupled, np.linspace(0.0, 1.5, 31), multiplier=-1)
    assert computed
    for each in computed:
        assert np.abs(floquet(*coupled(each.value), rtol=1e-12).multipliers + 1).min() < 1e-7


def test_stable_constant_system_has_no_boundary():
    plain = constant(np.eye(1), np.array([[0.1]]), np.array([[2.0]]), lambda phase: np.ones((len(phase), 1)))
    assert boundaries(lambda speed: (plain, speed), np.linspace(0.5, 3.0, 11), multiplier=1) == []


def test_invalid_multipliers_and_values_are_refused():
    with pytest.raises(ValueOutOfBoundsError, match=r"multiplier is 0; allowed: 1 .* or -1"):
        determinant(mathieu(1.0, 0.1), 1.0, 8, multiplier=0)
    for values in ([1.0], [1.0, 0.5], [1.0, 1.0]):
        with pytest.raises(ValueOutOfBoundsError, match="give at least two ascending values"):
            boundaries(lambda delta: (mathieu(delta, 0.1), 1.0), values)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_orbit_and_multipliers_equal_dop853(seed):
    given = random_system(seed, 2)
    truth, phases = Shooting(given, 1.0), np.linspace(0.0, 2 * np.pi, 101)
    orbit = periodic(given, 1.0, "hill", rtol=1e-9)
    assert relative_error(orbit.at(phases), truth.states(phases)[:2]) < 1e-9
    assert multiplier_error(orbit.multipliers, truth.multipliers) < 1e-9
