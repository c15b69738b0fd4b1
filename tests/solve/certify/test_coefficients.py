"""Phases at which coefficients are compared."""

import numpy as np
import pytest

import solve
from solve.certify.coefficients import require_load
from solve.errors import NoLoadError


def loaded(start, length, amplitude, breaks):
    """Oscillator with a load for phases of the length `length`."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        load = amplitude * (np.mod(phase - start, 2 * np.pi) < length)
        return one, 0.1 * one, 2.3 * one, load[:, None]

    return solve.PeriodicSystem(matrices, ["q"], breaks=breaks)


@pytest.mark.parametrize(("start", "length"), [(1.2345, 1e-4), (5.4321, 3e-6)])
def test_loads_between_breaks_are_found_however_short(start, length):
    breaks = [start, start + length]
    require_load(loaded(start, length, 1.0, breaks), 1.0)
    with pytest.raises(NoLoadError, match="has no load"):
        require_load(loaded(start, length, 0.0, breaks), 1.0)


def test_loads_that_are_not_between_breaks_are_found_if_longer_than_a_compared_interval():
    for start in np.linspace(0.1, 6.1, 41):
        require_load(loaded(start, 2 * np.pi / 1000, 1.0, []), 1.0)
