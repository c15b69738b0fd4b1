"""Mass matrices that are singular at phases between the samples: every solver gives one message of one
line."""

import numpy as np
import pytest

from solve import PeriodicSystem, floquet, periodic, sweep
from solve.errors import MatricesError


def one(inertia, breaks=(), period=2 * np.pi):
    """System with one coordinate and a varying inertia."""

    def matrices(phase, speed):
        unit = np.ones((len(phase), 1, 1))
        return inertia(phase)[:, None, None], 0.3 * unit, 2.3 * unit, np.cos(phase)[:, None]

    return PeriodicSystem(matrices, ["q"], period, breaks)


def two(coupling):
    """System of two coordinates with unit inertia; M is singular where their coupling is 1."""

    def matrices(phase, speed):
        unit = np.broadcast_to(np.eye(2), (len(phase), 2, 2))
        M = unit + coupling(phase)[:, None, None] * np.array([[0.0, 1.0], [1.0, 0.0]])
        return M, 0.3 * unit, np.diag([2.3, 5.1]) * unit, np.cos(phase)[:, None] * np.ones(2)

    return PeriodicSystem(matrices, ["q1", "q2"])


def dip(phase, place, width, depth=1.0):
    """Inertia of 1 with a dip."""
    return 1 - depth / (1 + ((phase - place + np.pi) % (2 * np.pi) - np.pi) ** 2 / width**2)


SINGULAR = {
    "touches zero": (one(lambda p: 1 - np.cos(p - 1)), 1.0),
    "touches zero in a short period": (one(lambda p: 1 - np.cos(1e6 * p - 3.9), period=2e-6 * np.pi), 3.9e-6),
    "changes sign": (one(lambda p: 0.3 + np.cos(p)), np.arccos(-0.3)),
    "negative for a moment": (one(lambda p: 0.99999 - np.cos(p - 1)), 1 - np.arccos(0.99999)),
    "coupled, touches": (two(lambda p: np.cos(p - 1)), 1.0),
    "coupled, changes": (two(lambda p: 1.2 * np.cos(p)), np.arccos(1 / 1.2)),
    "touches in a dip between the samples": (one(lambda p: dip(p, 2.0, 0.02)), 2.0),
    "touches in the shallower of two dips": (one(lambda p: dip(p, 2.0, 0.3) * dip(p, 5.0, 0.5, 0.9999)), 2.0),
    "touches with a kink": (one(lambda p: np.abs(np.sin((p - 2.5) / 2))), 2.5),
    "vanishes after a jump": (one(lambda p: (p - 4.0) % (2 * np.pi), (4.0,)), 4.0),
    "vanishes before a jump": (one(lambda p: (1.0 - p) % (2 * np.pi), (1.0,)), 1.0),
    "coupled, touches in a dip": (two(lambda p: 1 - dip(p, 3.0, 0.01)), 3.0),
}
REGULAR = {
    "nearly singular in two dips": one(lambda p: dip(p, 2.0, 0.2, 0.999) * dip(p, 5.0, 0.1, 0.995)),
    "small after a jump": one(lambda p: 1e-3 + (p - 4.0) % (2 * np.pi), (4.0,)),
    "nearly singular": one(lambda p: 1.0001 - np.cos(p - 1)),
    "negative": one(lambda p: -1.5 + np.cos(p)),
    "smallest after a jump of sign at 0": one(
        lambda p: np.where(p % (2 * np.pi) < 3.0, 0.002 + p % (2 * np.pi) / 10, -0.5), (0.0, 3.0)
    ),
    "smallest before a jump, with its own side there": one(
        lambda p: np.where((p - 1) % (2 * np.pi) <= 3.0, 0.302 - (p - 1) % (2 * np.pi) / 10, -0.5), (1.0, 4.0)
    ),
    "jumps to negative": one(lambda p: np.where(p % (2 * np.pi) < 2.0, 1.0, -1.0), (0.0, 2.0)),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_every_solver_reports_the_phase_of_a_singular_mass_matrix(name):
    given, phase = SINGULAR[name]
    texts = {sweep(given, [1.0, 1.1], rtol=1e-6).record()["points"][at]["error"] for at in range(2)}
    for solved in (periodic, floquet):
        with pytest.raises(MatricesError) as refused:
            solved(given, 1.0)
        texts.add(str(refused.value))
    (text,) = texts
    assert text.startswith("M is singular near phase ")
    assert text.endswith("give every coordinate a mass at every phase")
    assert float(text.split()[5].rstrip(":")) == pytest.approx(phase, abs=2 * np.pi / 128)


@pytest.mark.parametrize("name", REGULAR)
def test_small_and_negative_inertia_and_jumps_are_not_singular(name):
    assert periodic(REGULAR[name], 1.0, rtol=1e-6).error_estimate.orbit <= 1e-6
