"""Studies of systems that are constant except during short fractions of the period."""

import numpy as np
import pytest

import solve

STIFFNESS, DAMPING, IMPULSE = 3.1, 0.03, 0.5


def pulsed(start, length, stiffness=STIFFNESS, is_declared=True):
    """Return an oscillator whose stiffness is increased by IMPULSE/`length` over a range of phases of this
    length."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        is_in_pulse = np.mod(phase - start, 2 * np.pi) < length
        if is_declared:
            pulse = IMPULSE / length * is_in_pulse
        else:
            pulse = 8 / 3 * IMPULSE / length * is_in_pulse * np.sin(np.pi * (phase - start) / length) ** 4
        return one, DAMPING * one, (stiffness + pulse)[:, None, None], np.cos(phase)[:, None]

    breaks = [start, start + length] if is_declared else []
    return solve.PeriodicSystem(matrices, ["q"], breaks=breaks)


def spectral_radius(speed, length):
    """Return the spectral radius for the rectangular pulse, from the product of the two transition
    matrices."""
    total = np.eye(2)
    for stiffness, duration in (
        (STIFFNESS + IMPULSE / length, length / speed),
        (STIFFNESS, (2 * np.pi - length) / speed),
    ):
        frequency = np.sqrt(stiffness - DAMPING**2 / 4)
        c, s = np.cos(frequency * duration), np.sin(frequency * duration) / frequency
        matrix = [[c + DAMPING / 2 * s, s], [-stiffness * s, c - DAMPING / 2 * s]]
        total = np.exp(-DAMPING / 2 * duration) * np.array(matrix) @ total
    return np.abs(np.linalg.eigvals(total)).max()


@pytest.mark.parametrize(("start", "length"), [(160.6 / 1001, 1 / 3000), (653.7 / 1001, 1 / 20_000)])
def test_bands_due_to_pulses_between_breaks_are_found(start, length):
    """Meissner's equation has a pulse that contains none of 1001 equidistant phases."""
    start, length = 2 * np.pi * start, 2 * np.pi * length
    speeds = np.linspace(0.9, 1.9, 21)
    bands = solve.bands(pulsed(start, length), speeds)
    fine = np.linspace(0.9, 1.9, 5001)
    is_unstable = np.array([spectral_radius(speed, length) > 1 for speed in fine])
    is_in_band = np.zeros(len(fine), dtype=bool)
    for band in bands:
        is_in_band |= (fine > band.low) & (fine < band.high)
    assert is_unstable.any()
    assert np.array_equal(is_in_band, is_unstable)


@pytest.mark.parametrize("cell", [7, 93])
def test_boundaries_due_to_short_undeclared_pulses_are_found(cell):
    """The pulse lies between two of 128 equidistant phases."""
    start, length = (cell + 0.55) * 2 * np.pi / 128, 2 * np.pi / 140
    chart = solve.chart(
        lambda stiffness, scale: pulsed(start, length, scale * stiffness, is_declared=False),
        {"stiffness": np.linspace(1.6, 2.8, 9)},
        {"scale": [1.0, 1.1]},
        speed=1.0,
    )
    lowest = sorted(float(x) for curve in chart.boundaries for x, y in curve.points if y == 1.0)
    assert len(lowest) == 2
    for value in lowest:
        found = solve.floquet(pulsed(start, length, value, is_declared=False), 1.0)
        assert found.spectral_radius == pytest.approx(1.0, abs=1e-6)
