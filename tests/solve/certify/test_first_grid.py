"""The first grid, from the frozen modes and the harmonics of the coefficients."""

from functools import partial

import numpy as np
import pytest

from solve import Gauss, Newmark, PeriodicSystem, Radau
from solve.certify.resolution import first_steps
from solve.period.frozen import frozen
from solve.period.points import SinglePoint
from tests.solve.systems import constant


def oscillators(*omegas, damping=0.0):
    """Uncoupled oscillators without load; the last one with a damping ratio."""
    C, K = np.zeros((2, len(omegas), len(omegas)))
    np.fill_diagonal(K, np.square(omegas))
    C[-1, -1] = 2 * damping * omegas[-1]
    return constant(np.eye(len(omegas)), C, K, lambda phase: np.zeros((len(phase), len(omegas))))


def steps(method, system, rtol=1e-6):
    point = SinglePoint(system, 1.0)
    (computed,) = first_steps(method, point, frozen(point), True, rtol).tolist()
    return computed


@pytest.mark.parametrize("n", [1, 2])
def test_soft_systems_begin_with_few_steps(n):
    soft = oscillators(*([1.5] * n))
    assert steps(Gauss(), soft) <= 16
    assert steps(Radau(13), soft) <= 16
    assert steps(Newmark(), soft) == 16


@pytest.mark.parametrize("method", [Gauss(), Radau(13)])
@pytest.mark.parametrize("omega", [40.0, 160.0])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_the_first_grid_reaches_the_tolerance(method, omega, rtol):
    """An undamped mode of frequency ω, which m steps turn by too much: the phase error of Padé's approximant
    is within a tenth and the whole of `rtol`, so that neither a grid nor steps are wasted."""
    m = steps(method, oscillators(1.0, omega), rtol)
    angle = 2 * np.pi * omega
    error = m * method.error_constant * (angle / m) ** (method.order + 1)
    assert 1e-2 * rtol < error < rtol


def test_modes_that_die_out_need_few_steps():
    """A period leaves exp(-2π 0.01 · 400) = 1e-11 of the fast mode."""
    dying, lasting = (oscillators(1.0, 400.0, damping=damping) for damping in (0.01, 0.0))
    for method in (Gauss(), Radau(13)):
        assert steps(method, dying) < steps(method, lasting) / 2


def test_harmonics_of_the_load_count_as_far_as_inertia_lets_them():
    def loaded(order):
        return constant(
            np.eye(1), 0.1 * np.eye(1), 2.3 * np.eye(1), lambda phase: np.cos(phase) + np.cos(order * phase)
        )

    computed = [steps(Gauss(), loaded(order)) for order in (2, 50, 200)]
    assert computed[0] < computed[1] < computed[2]


@pytest.mark.parametrize("coupling", ["M", "C", "K", "d"])
def test_round_off_of_an_entry_that_vanishes_is_no_harmonic(coupling):
    """The second coordinate is a million times stiffer; what couples it has the round-off of its size."""

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
