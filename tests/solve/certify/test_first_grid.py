"""First grid, predicted from the frozen modes and the harmonics of the coefficients."""

from functools import partial

import numpy as np
import pytest

from solve import Gauss, Newmark, PeriodicSystem, Radau, periodic
from solve.certify.resolution import first_steps
from solve.period.frozen import frozen
from solve.period.points import SinglePoint
from tests.solve.systems import constant


def oscillators(*omegas, damping=0.0):
    """Uncoupled oscillators without load; the last one has a damping ratio."""
    C, K = np.zeros((2, len(omegas), len(omegas)))
    np.fill_diagonal(K, np.square(omegas))
    C[-1, -1] = 2 * damping * omegas[-1]
    return constant(np.eye(len(omegas)), C, K, lambda phase: np.zeros((len(phase), len(omegas))))


def steps(method, system, rtol=1e-6):
    point = SinglePoint(system, 1.0)
    computed, _ = first_steps(method, point, frozen(point), True, rtol, 2**20)
    return int(computed[0])


@pytest.mark.parametrize("n", [1, 2])
def test_first_grid_of_soft_systems_has_few_steps(n):
    soft = oscillators(*([1.5] * n))
    assert steps(Gauss(), soft) <= 16
    assert steps(Radau(13), soft) <= 16
    assert steps(Newmark(), soft) == 16


@pytest.mark.parametrize("method", [Gauss(), Radau(13)])
@pytest.mark.parametrize("omega", [40.0, 160.0])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_first_grid_reaches_tolerance(method, omega, rtol):
    """An undamped mode of frequency ω. The phase error of Padé's approximant with m steps is between a tenth
    of `rtol` and `rtol`, so that neither a grid nor steps are wasted."""
    m = steps(method, oscillators(1.0, omega), rtol)
    angle = 2 * np.pi * omega
    error = m * method.error_constant * (angle / m) ** (method.order + 1)
    assert 1e-2 * rtol < error < rtol


def test_modes_that_decay_within_a_period_require_few_steps():
    """The amplitude of the fast mode decays by exp(-2π 0.01 · 400) = 1e-11 within a period."""
    dying, lasting = (oscillators(1.0, 400.0, damping=damping) for damping in (0.01, 0.0))
    for method in (Gauss(), Radau(13)):
        assert steps(method, dying) < steps(method, lasting) / 2


def stiff(rates, rng):
    """Return a system W q of damped modes λ from soft to stiff, its q at the phases 0 and π/2, and its
    multipliers. W is random and triangular, so that stiff entries do not cancel. The load on each mode is cos
    φ."""
    W = np.eye(len(rates)) + np.triu(rng.uniform(-0.5, 0.5, (len(rates), len(rates))), 1)
    C, K = (W.T @ np.diag(part) @ W for part in (-2 * rates.real, np.abs(rates) ** 2))
    loads = (W.T * np.abs(rates) ** 2).sum(axis=1)
    response = np.linalg.inv(W) @ (np.abs(rates) ** 2 / ((1j - rates) * (1j - rates.conj())))
    system = constant(W.T @ W, C, K, lambda phase: np.cos(phase)[:, None] * loads)
    return system, np.array([response.real, -response.imag]).T, np.exp(2 * np.pi * rates)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("method", ["auto", "radau"])
def test_orbit_is_accurate_although_no_grid_resolves_all_modes(method, seed):
    """Modes of 2e4 and 1e6 rad/s decay to 1 % within a period. The faster one requires more steps than
    allowed. The orbit meets the tolerance, and the error of the multipliers includes the unresolved mode."""
    system, response, multipliers = stiff(
        np.array([-0.02 + 1.3j, -0.1 + 2.6j, -0.74 + 2e4j, -0.74 + 1e6j]), np.random.default_rng(seed)
    )
    orbit = periodic(system, 1.0, method, rtol=1e-6)
    error = np.abs(orbit.at([0.0, np.pi / 2]) - response).max()
    assert error < 10 * orbit.error_estimate.orbit * np.abs(response).max()
    assert orbit.error_estimate.orbit <= 1e-6
    assert 0.005 < orbit.error_estimate.multipliers < 0.05
    assert (orbit.verdict, orbit.steps < 100) == ("asymptotically stable", True)
    assert orbit.spectral_radius == pytest.approx(np.abs(multipliers).max(), rel=1e-6)
    assert "gives the multipliers to" in orbit.warnings[0]


def test_modes_that_affect_the_verdict_are_not_ignored():
    """An undamped mode that requires too many steps is not ignored; nor is a damped one if no orbit is
    computed."""
    for damping, orbit, ignored in ((0.0, True, False), (8e-7, True, True), (8e-7, False, False)):
        point = SinglePoint(oscillators(1.0, 1e6, damping=damping), 1.0)
        computed, unresolved = first_steps(Radau(13), point, frozen(point), orbit, 1e-6, 2**14)
        assert (computed[0] < 100, unresolved[0] > 0) == (ignored, ignored)


def test_higher_load_harmonics_require_more_steps():
    def loaded(order):
        return constant(
            np.eye(1), 0.1 * np.eye(1), 2.3 * np.eye(1), lambda phase: np.cos(phase) + np.cos(order * phase)
        )

    computed = [steps(Gauss(), loaded(order)) for order in (2, 50, 200)]
    assert computed[0] < computed[1] < computed[2]


@pytest.mark.parametrize("coupling", ["M", "C", "K", "d"])
def test_round_off_of_a_zero_entry_is_not_a_harmonic(coupling):
    """The second coordinate is a million times stiffer. The coupling has round-off relative to this
    stiffness."""

    def matrices(phase, speed, size):
        m = len(phase)
        M, C, K = np.zeros((3, m, 2, 2))
        M[:] = np.diag([1.0, 1.0])
        C[:] = np.diag([0.1, 100.0])
        K[:] = np.diag([4.0, 4e6])
        K[:, 0, 0] += np.cos(phase)
        d = np.column_stack((np.cos(phase), 1e3 * np.cos(phase)))
        noise = size * np.sin(1e5 * phase**2)
        if coupling == "d":
            d = np.column_stack((np.cos(phase) + 1e3 * noise, np.zeros(m)))
            d[:, 1] = noise
        else:
            part = {"M": M, "C": C, "K": K}[coupling]
            scale = np.sqrt(part[0, 0, 0] * part[0, 1, 1])
            part[:, 0, 1] = part[:, 1, 0] = scale * noise
        return M, C, K, d

    def first(size):
        return steps(Radau(13), PeriodicSystem(partial(matrices, size=size), ["a", "b"]))

    assert first(1e-16) == first(0.0) < first(1e-3)
