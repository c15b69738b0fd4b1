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


def test_load_pulses_longer_than_a_compared_interval_are_found():
    for start in np.linspace(0.1, 6.1, 41):
        require_load(loaded(start, 2 * np.pi / 1000, 1.0, []), 1.0)


@pytest.mark.parametrize("method", ["hsu", "newmark", "rk4"])
@pytest.mark.parametrize("steps", [640, 1536])
def test_estimates_of_evenly_sampling_methods_include_undeclared_jumps(method, steps):
    """Both grids of a pair can contain the same fraction of a pulse between undeclared jumps. The closed form
    is the trace of the two transition matrices of Meissner's equation."""
    for start, length in [(0.9137, 0.0171), (2.4681, 0.0263), (4.0507, 0.0349)]:

        def matrices(phase, speed, start=start, length=length):
            one = np.ones((len(phase), 1, 1))
            is_in_pulse = np.mod(phase - start, 2 * np.pi) < length
            stiffness = 3.1 + 0.7 / length * is_in_pulse
            return one, 0.0 * one, stiffness[:, None, None], np.cos(phase)[:, None]

        found = solve.floquet(solve.PeriodicSystem(matrices, ["q"]), 1.0, method=method, steps=steps)
        total = np.eye(2)
        for stiffness, duration in ((3.1 + 0.7 / length, length), (3.1, 2 * np.pi - length)):
            c, s = np.cos(stiffness**0.5 * duration), np.sin(stiffness**0.5 * duration)
            total = np.array([[c, s / stiffness**0.5], [-(stiffness**0.5) * s, c]]) @ total
        error = abs(found.spectral_radius - np.abs(np.linalg.eigvals(total)).max()) / found.spectral_radius
        assert error <= 10 * found.error_estimate.multipliers
