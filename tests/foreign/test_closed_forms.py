"""Fundamental matrices in closed form of SKHiPPR's tests (F. Bayer, R. Leine, University of Stuttgart,
inm-unistuttgart/SKHiPPR, test/test_closed_form_fundamental_matrix.py): Hill's equation with constant and
with rectangular stiffness, a + b sign(cos ωt), ω = √2, by matrix exponentials."""

import numpy as np
import pytest
from scipy.linalg import expm

import solve
from tests.foreign.wall import oscillator

SPEED = np.sqrt(2)


def meissner(a, b, damping):
    """In phase time: q'' + (damping/ω) q' + (a + b sign(cos φ))/ω² q = 0."""

    def stiffness(phase):
        first = (phase < np.pi / 2) | (phase >= 3 * np.pi / 2)
        return np.where(first, a + b, a - b) / SPEED**2

    return oscillator(
        stiffness, lambda phase: np.full_like(phase, damping / SPEED), breaks=(np.pi / 2, 3 * np.pi / 2)
    )


def closed(a, b, damping):
    turn = 2 * np.pi / SPEED

    def piece(stiffness, share):
        return expm(np.array([[0.0, 1.0], [-stiffness, -damping]]) * turn * share)

    return piece(a + b, 0.25) @ piece(a - b, 0.5) @ piece(a + b, 0.25)


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("a", [-2.0, 0.0, 2.0])
@pytest.mark.parametrize("b", [-2.0, 0.0, 2.0])
def test_multipliers_of_meissners_equation(a, b, damping):
    """Theirs are compared to 5e-5; here the trace and the determinant to 1e-9 of the largest multiplier."""
    Phi = closed(a, b, damping)
    found = solve.floquet(meissner(a, b, damping), 1.0, rtol=1e-10).multipliers
    largest = max(1.0, np.abs(np.linalg.eigvals(Phi)).max())
    assert abs(found.sum() - np.trace(Phi)) < 1e-9 * largest
    assert abs(np.prod(found) - np.exp(-damping * 2 * np.pi / SPEED)) < 1e-9 * largest
