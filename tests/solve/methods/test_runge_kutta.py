"""Maps of the classical Runge–Kutta method compared with the chapter's closed forms, corrected and as
printed."""

from functools import reduce

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import RungeKutta4, periodic
from solve.errors import StepsError
from solve.period.grid import Grid
from tests.solve.references import Shooting, multiplier_error, rate_matrices, slope
from tests.solve.systems import cam, chain_of, constant, frozen_modes, random_system, seeds

CORRECTED, PRINTED = 1.0, 0.5
"""The coefficient of P₁P_m and P₁f_m in h², and of P₁P_m² in h³/2."""


def chain(system, speed, steps, coefficient):
    """Maps A (m, N, N) and b (m, N) of all steps, chapter Eqs. (18) and (19), with the given coefficient."""
    h, k = system.period / steps, coefficient
    P, f = rate_matrices(system, np.arange(2 * steps + 1) * h / 2, speed)
    P0, Pm, P1 = P[:-1:2], P[1::2], P[2::2]
    f0, fm, f1 = (part[..., None] for part in (f[:-1:2], f[1::2], f[2::2]))
    A = (
        np.eye(P.shape[1])
        + (
            h * (P0 + 4 * Pm + P1)
            + h**2 * (Pm @ P0 + Pm @ Pm + k * P1 @ Pm)
            + h**3 / 2 * (Pm @ Pm @ P0 + k * P1 @ Pm @ Pm)
            + h**4 / 4 * P1 @ Pm @ Pm @ P0
        )
        / 6
    )
    b = (
        h * (f0 + 4 * fm + f1)
        + h**2 * (Pm @ f0 + Pm @ fm + k * P1 @ fm)
        + h**3 / 2 * (Pm @ Pm @ f0 + P1 @ Pm @ fm)
        + h**4 / 4 * P1 @ Pm @ Pm @ f0
    ) / 6
    return A, b[..., 0]


def monodromy(A):
    return reduce(lambda product, step: step @ product, A)


@given(seeds, st.integers(1, 3), st.floats(0.3, 3.0), st.integers(4, 40))
@settings(max_examples=30, deadline=None)
def test_maps_equal_the_corrected_closed_forms(seed, n, speed, steps):
    system = random_system(seed, n)
    maps = chain_of(RungeKutta4(), system, speed, Grid.uniform(steps, system.period))
    A, b = chain(system, speed, steps, CORRECTED)
    np.testing.assert_allclose(maps.A, A, rtol=0, atol=1e-12 * np.abs(A).max())
    np.testing.assert_allclose(maps.b, b, rtol=0, atol=1e-12 * np.abs(b).max())


@pytest.mark.parametrize(("coefficient", "order"), [(CORRECTED, 4), (PRINTED, 1)])
def test_printed_coefficients_have_a_lower_order(coefficient, order):
    system = random_system(4, 2)
    truth = Shooting(system, 1.0)
    steps = (128, 192, 256)
    periods = [chain(system, 1.0, m, coefficient) for m in steps]
    multipliers = [np.linalg.eigvals(monodromy(A)) for A, _ in periods]
    errors = [multiplier_error(values, truth.multipliers) for values in multipliers]
    assert slope(steps, errors) == pytest.approx(order, abs=0.15)


def test_printed_load_vector_lowers_the_order_of_the_orbit():
    """Only b is as printed; A is corrected. Eq. (19) alone reduces the order to one."""
    system = random_system(4, 2)
    truth = Shooting(system, 1.0)
    steps = (128, 192, 256)
    errors = []
    for m in steps:
        A, b = chain(system, 1.0, m, CORRECTED)[0], chain(system, 1.0, m, PRINTED)[1]
        end = reduce(lambda x, step: step[0] @ x + step[1], zip(A, b, strict=True), np.zeros(4))
        start = np.linalg.solve(np.eye(4) - monodromy(A), end)
        errors.append(np.linalg.norm(start - truth.start))
    assert slope(steps, errors) == pytest.approx(1.0, abs=0.15)


def test_printed_form_is_unstable_and_corrected_form_is_stable():
    system, speed, steps = cam("1"), 100 * np.pi / 30, 20_000
    spectral_radius = {
        k: np.abs(np.linalg.eigvals(monodromy(chain(system, speed, steps, k)[0]))).max()
        for k in (PRINTED, CORRECTED)
    }
    assert spectral_radius[PRINTED] > 1.0
    assert spectral_radius[CORRECTED] == pytest.approx(1.466125e-7, rel=1e-3)


def oscillator(omega, decay):
    return constant(
        np.eye(1), np.array([[decay]]), np.array([[omega**2]]), lambda phase: np.cos(phase)[:, None]
    )


@pytest.mark.parametrize(
    ("omega", "decay", "limit"),
    [(40.0, 0.0, 2 * np.sqrt(2.0)), (1.0, 40.0, 2.785293563405282)],
    ids=["undamped oscillator", "overdamped"],
)
def test_stability_limit(omega, decay, limit):
    """|R(z)| = 1 at z = 2√2 i and at z = -2.785… on the real axis."""
    system, rule = oscillator(omega, decay), RungeKutta4()
    fastest = np.abs(np.roots([1.0, decay, omega**2])).max()
    least = rule.least_steps(frozen_modes(system, 1.0))[0]
    assert least == np.ceil(fastest * 2 * np.pi / limit)

    def spectral_radius(steps):
        maps = chain_of(rule, system, 1.0, Grid.uniform(steps, system.period))
        return np.abs(np.linalg.eigvals(maps.A[0])).max()

    assert spectral_radius(least) <= 1.0 < spectral_radius(least - 1)


def test_too_few_steps_are_refused_with_the_remedy():
    with pytest.raises(StepsError, match=r"rk4 with 50 steps .* at least 89 steps, or .* \(radau\)"):
        periodic(oscillator(40.0, 0.0), 1.0, "rk4", steps=50)


def test_slow_cam_requires_more_than_5000_steps_for_stability():
    modes = frozen_modes(cam("2"), 100 * np.pi / 30)
    assert RungeKutta4().least_steps(modes) > 5000
