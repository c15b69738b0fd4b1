"""The gear pair with backlash against integration from event to event."""

import numpy as np
import pytest

import solve
from tests.models.gear_backlash.integration import PITCH, fold, integrated, orbit

HERE = 27400.0
"""A speed, rad/s, at which the teeth separate."""


def by_modulus(values):
    return values[np.lexsort((values.imag, np.abs(values)))]


def compared(found, **given):
    """Differences of state, multipliers and events from the reference, the state relative to the orbit."""
    state, multipliers, events = orbit([found.q[0, 0], found.qd[0, 0] / found.speed], found.speed, **given)
    size = np.abs(found.q).max()
    off = np.abs([found.q[0, 0] - state[0], found.qd[0, 0] / found.speed - state[1]]).max() / size
    apart = np.abs(by_modulus(found.multipliers) - by_modulus(multipliers)).max()
    assert len(events) == len(found.events)
    return off, apart, np.abs(np.array(found.events) - events).max(initial=0.0)


def test_single_sided_contact():
    found = solve.nonlinear(solve.load("gear_backlash"), HERE)
    assert max(compared(found)) < 1e-8
    assert len(found.events) == 2
    first, second = found.events
    apart = 1 - found.statistics("driving_contact").mean
    assert apart == pytest.approx(min(second - first, 2 * np.pi - second + first) / 2 / np.pi, abs=1e-3)
    assert found.statistics("back_contact").max == 0
    assert found.statistics("gap").max == pytest.approx(-found.statistics("q").min - 2000 / 4e8, rel=1e-9)
    assert found.statistics("mesh_force").min == 0
