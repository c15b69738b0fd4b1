"""Radau IIA and Gauss: tableaux, order conditions, stability functions, and the Nyström form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import Radau, floquet
from solve.errors import ValueOutOfBoundsError
from solve.methods.gauss import Gauss
from solve.period.grid import Grid
from tests.solve.references import rate_matrices
from tests.solve.systems import chain_of, constant, random_system, seeds

RADAU = [Radau(order) for order in (3, 5, 7, 9, 11, 13)]
GAUSS = [Gauss(order) for order in (4, 6, 8, 10, 12, 14, 16)]
both = pytest.mark.parametrize("rule", [*RADAU, *GAUSS], ids=repr)
r6, r3, r15 = np.sqrt([6.0, 3.0, 15.0])
TABLEAUX = [  # E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Tables IV.5.1-5.6
    (Radau(3), [1 / 3, 1], [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], [3 / 4, 1 / 4]),
    (
        Radau(5),
        [(4 - r6) / 10, (4 + r6) / 10, 1],
        [
            [(88 - 7 * r6) / 360, (296 - 169 * r6) / 1800, (-2 + 3 * r6) / 225],
            [(296 + 169 * r6) / 1800, (88 + 7 * r6) / 360, (-2 - 3 * r6) / 225],
            [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
        ],
        [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
    ),
    (
        Gauss(4),
        [1 / 2 - r3 / 6, 1 / 2 + r3 / 6],
        [[1 / 4, 1 / 4 - r3 / 6], [1 / 4 + r3 / 6, 1 / 4]],
        [1 / 2, 1 / 2],
    ),
    (
        Gauss(6),
        [1 / 2 - r15 / 10, 1 / 2, 1 / 2 + r15 / 10],
        [
            [5 / 36, 2 / 9 - r15 / 15, 5 / 36 - r15 / 30],
            [5 / 36 + r15 / 24, 2 / 9, 5 / 36 - r15 / 24],
            [5 / 36 + r15 / 30, 2 / 9 + r15 / 15, 5 / 36],
        ],
        [5 / 18, 4 / 9, 5 / 18],
    ),
]


@pytest.mark.parametrize(("rule", "c", "A", "b"), TABLEAUX, ids=[repr(rule) for rule, *_ in TABLEAUX])
def test_tableaux_match_published_coefficients(rule, c, A, b):
    computed = rule.stages
    for ours, known in ((computed.c, c), (computed.A, A), (computed.b, b)):
        np.testing.assert_allclose(ours, known, rtol=0, atol=4e-16)


@both
def test_order_conditions(rule):
    """Butcher's conditions B(p), C(s) and D(p - s), which together imply order p."""
    computed, p = rule.stages, rule.order
    c, s = np.array(computed.c), len(computed.c)
    for k in range(1, p + 1):
        assert computed.b @ c ** (k - 1) == pytest.approx(1 / k, abs=1e-15), f"B({k})"
    for k in range(1, s + 1):
        np.testing.assert_allclose(computed.A @ c ** (k - 1), c**k / k, rtol=0, atol=1e-15, err_msg=f"C({k})")
    for k in range(1, p - s + 1):
        np.testing.assert_allclose(
            (computed.b * c ** (k - 1)) @ computed.A,
            computed.b * (1 - c**k) / k,
            rtol=0,
            atol=1e-15,
            err_msg=f"D({k})",
        )


@pytest.mark.parametrize("rule", RADAU, ids=repr)
def test_radau_is_stiffly_accurate(rule):
    computed = rule.stages
    assert computed.c[-1] == 1.0
    assert np.abs(computed.A[-1] - computed.b).max() <= 2e-16


def step_of(rule, system, h, speed=1.0):
    """Map of the first of two steps of length h."""
    grid = Grid(np.array([0.0, h, 2 * h]), np.zeros(2, dtype=bool))
    steps = chain_of(rule, system, speed, grid)
    return steps.A[0], steps.b[0]


def pade(z, numerator, denominator):
    """Padé approximant of exp(z) with the two degrees, by Horner's scheme."""
    from math import comb, factorial

    def polynomial(x, degree, other):
        total = numerator + denominator
        coefficients = [comb(degree, j) * factorial(total - j) / factorial(total) for j in range(degree + 1)]
        return sum(a * x**j for j, a in enumerate(coefficients))

    return polynomial(z, numerator, denominator) / polynomial(-z, denominator, numerator)


@both
@pytest.mark.parametrize("z", [-0.1, -1.0, -8.0, -60.0, 0.9])
def test_stability_function_is_the_pade_approximant(rule, z):
    """One step of length 1 for v′ = z v: degrees (s-1, s) for Radau IIA and (s, s) for Gauss."""
    free = constant(np.eye(1), np.array([[-z]]), np.zeros((1, 1)), lambda phase: np.zeros((len(phase), 1)))
    s = len(rule.stages.c)
    expected = pade(z, s - 1 if rule.l_stable else s, s)
    assert step_of(rule, free, 1.0)[0][1, 1] == pytest.approx(expected, rel=1e-11, abs=1e-15)


def oscillator(omega):
    return constant(
        np.eye(1), np.zeros((1, 1)), np.array([[omega**2]]), lambda phase: np.zeros((len(phase), 1))
    )


@pytest.mark.parametrize("rule", RADAU, ids=repr)
def test_radau_is_l_stable(rule):
    """The multiplier is inside the unit circle on the imaginary axis, and R → 0 at least as fast as 1/(ω
    h)."""
    radius = {
        w: np.abs(np.linalg.eigvals(step_of(rule, oscillator(w), 1.0)[0])).max() for w in (10.0, 1e3, 1e5)
    }
    assert max(radius.values()) < 1.0
    assert radius[1e3] < 0.05
    assert radius[1e5] < 0.05 * radius[1e3]


@pytest.mark.parametrize("rule", GAUSS, ids=repr)
@pytest.mark.parametrize("omega", [0.3, 3.0, 30.0, 1e3])
def test_gauss_conserves_energy_and_is_not_l_stable(rule, omega):
    radii = np.abs(np.linalg.eigvals(step_of(rule, oscillator(omega), 1.0)[0]))
    np.testing.assert_allclose(radii, 1.0, rtol=0, atol=1e-9)
    assert not rule.l_stable


@given(seeds, st.integers(1, 3), st.sampled_from([*RADAU, *GAUSS]), st.floats(0.5, 2.0))
@settings(max_examples=60, deadline=None)
def test_nystrom_form_equals_the_first_order_form(seed, n, rule, speed):
    """The reference solves the stages of x′ = P x + f as one system of order 2 n s."""
    system, h = random_system(seed, n), 0.3
    c, A, b = np.array(rule.stages.c), rule.stages.A, rule.stages.b
    P, f = rate_matrices(system, c * h, speed)
    s, N = len(c), 2 * n
    stages = np.eye(s * N) - h * np.einsum("ij,jab->iajb", A, P).reshape(s * N, s * N)
    start = np.tile(np.eye(N), (s, 1))
    load = h * np.einsum("ij,ja->ia", A, f).ravel()
    X = np.linalg.solve(stages, np.column_stack((start, load))).reshape(s, N, N + 1)
    maps = np.eye(N, N + 1) + h * np.einsum("i,iab,ibc->ac", b, P, X)
    maps[:, -1] += h * b @ f
    ours = np.column_stack(step_of(rule, system, h, speed))
    np.testing.assert_allclose(ours, maps, rtol=0, atol=1e-12 * np.abs(maps).max())


@pytest.mark.parametrize(("kind", "order"), [(Radau, 4), (Radau, 15), (Radau, 1), (Gauss, 5), (Gauss, 18)])
def test_invalid_orders_are_refused(kind, order):
    with pytest.raises(ValueOutOfBoundsError, match=rf"order of \w+ is {order}; allowed: .*; try order"):
        kind(order)


@pytest.mark.parametrize("order", [3, 5, 9, 13])
def test_radau_damps_a_stiff_mode_that_gauss_does_not(order):
    """One slow and one stiff mode, both damped. The exact spectral radius is exp(-2π·0.1)."""
    K = np.diag([1.0, 1e10])
    system = constant(np.eye(2), np.diag([0.2, 2e3]), K, lambda phase: np.ones((len(phase), 2)))
    truth = np.exp(-0.2 * np.pi)
    assert floquet(system, 1.0, Radau(order), steps=64, rtol=0.5).spectral_radius == pytest.approx(
        truth, rel=1e-2
    )
    false = floquet(system, 1.0, Gauss(order + 1), steps=64, rtol=0.5)
    assert false.spectral_radius > 0.9
    assert any("unresolved" in text and "radau" in text for text in false.warnings)


@pytest.mark.parametrize("loads", [1, 3])
@pytest.mark.parametrize("n", [1, 4, 21])
def test_stepwise_and_batched_collocation_agree(n, loads):
    rng = np.random.default_rng(n)
    C, K, d = (rng.standard_normal((2, 3, 5, n, columns)) for columns in (n, n, loads))
    M = np.eye(n) + 0.1 * rng.standard_normal((2, 3, 5, n, n)) / n
    h, method = np.array([0.1, 0.2, 0.05]), Radau(9).stages
    computed, truth = (np.empty((2, 3, 5 * n, 2 * n + loads)) for _ in range(2))
    method._solve_step_by_step(computed, h, M, C, K, d)
    method._solve_together(truth, h, M, C, K, d)
    np.testing.assert_allclose(computed, truth, rtol=0, atol=1e-13 * np.abs(truth).max())


def test_only_the_singular_step_gives_nan():
    n, h = 20, np.array([0.1, 0.1])
    M = np.tile(np.eye(n), (1, 2, 5, 1, 1))
    M[0, 1, :, 3, 3] = 0.0
    nothing, d = np.zeros_like(M), np.ones((1, 2, 5, n))
    a = Radau(9).stages.stage_accelerations(h, M, nothing, nothing, d)
    assert np.isfinite(a[0, 0]).all()
    assert np.isnan(a[0, 1]).all()
