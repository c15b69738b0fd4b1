"""Curves of folds and period doublings in two parameters, compared with closed forms."""

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.errors import ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, model_of


def test_doublings_at_rest_are_mathieu_characteristic_values():
    """For q̈ + (δ + ε cos 2t) q = 0, a multiplier is -1 at δ = a1(ε/2) and at δ = b1(ε/2)."""
    model = solve.load("mathieu", zeta=0.0)
    ranges = ["delta=0.85:1.15", "epsilon=0.2:0.15"]
    found = solve.special_curves(model, "doubling", ranges, 1.0, points=12, rtol=1e-9)
    assert set(found.numbers) == {0, 1}
    for number, characteristic in enumerate((mathieu_b, mathieu_a)):
        delta, epsilon = found.values[found.numbers == number].T
        np.testing.assert_allclose(delta, characteristic(1, epsilon / 2), rtol=1e-10)


def one_harmonic(zeta):
    """Cusp of q̈ + 2ζ q̇ + q + q³ = f cos Ωt in the approximation by one harmonic: σ = 1 - Ω² = -2√3 ζ Ω and
    f² = 8|σ|³/(27·¾), where the cubic equation for the squared amplitude has a triple root."""
    speed = np.sqrt(3) * zeta + np.sqrt(3 * zeta**2 + 1)
    sigma = 2 * np.sqrt(3) * zeta * speed
    return speed, np.sqrt(8 * sigma**3 / (27 * 0.75))


@pytest.mark.slow
def test_duffing_cusp_approaches_single_harmonic_cusp():
    """The squared amplitude is of the order of ζ. The third harmonic changes the speed at a given amplitude
    by the fourth power of the amplitude, ζ², and the load by a relative amount of the order of ζ."""
    differences = []
    for zeta in (0.02, 0.01):
        speed, load = one_harmonic(zeta)
        model = model_of(duffing(), zeta=zeta, k=1.0, alpha=1.0, f=load)
        ranges = [f"speed={1 + 0.5 * zeta}:{1 + 4 * zeta} rad/s", f"f={1.2 * load}:{0.9 * load}"]
        found = solve.special_curves(model, "fold", ranges, points=60, rtol=1e-7)
        (cusp,) = found.at_cusps
        differences.append((abs(cusp["speed"] - speed), abs(cusp["f"] / load - 1)))
        # The curve returns to the second fold.
        assert set(found.numbers) == {0}
        assert found.values[-1, 1] == pytest.approx(1.2 * load, rel=1e-6)
    orders = np.log2(np.array(differences)[:-1] / np.array(differences)[1:])
    np.testing.assert_allclose(orders, [[2, 1]], atol=0.1)


@pytest.mark.parametrize(
    ("kind", "over", "words"),
    [
        ("torus", ["delta=0.8:1.2", "epsilon=0.2:0.1"], "kind is 'torus'; allowed: fold, doubling"),
        ("fold", ["delta=0.8:1.2"], "give two parameters"),
        ("fold", "delta=0.8:1.2", "give two parameters"),
        ("fold", ["delta=0.8:1.2", "delta=0.2:0.1"], "gives delta twice"),
        ("fold", ["delta=0.8:1.2:3", "epsilon=0.2:0.1"], "write NAME=A:B"),
        ("fold", ["delta=0.8:0.8", "epsilon=0.2:0.1"], "two different values"),
    ],
)
def test_invalid_input_is_refused(kind, over, words):
    with pytest.raises(ValueOutOfBoundsError, match=words):
        solve.special_curves(solve.load("mathieu"), kind, over, 1.0)
