"""Features of the matrices that are narrower than the steps: detected, undetected, and between breaks."""

import numpy as np
import pytest

from solve import PeriodicSystem, floquet, periodic

IMPULSE, DAMPING, STIFFNESS = 0.5, 0.2, 4.0


def struck(place, width, breaks=(), damping=DAMPING, stiffness=STIFFNESS):
    """Return q″ + 0.2 q′ + (4 + bump) q = cos φ, where the bump is a Gaussian of area 1/2."""

    def matrices(phase, speed):
        away = np.remainder(phase - place + np.pi, 2 * np.pi) - np.pi
        bump = IMPULSE * np.exp(-((away / width) ** 2)) / (width * np.sqrt(np.pi))
        one = np.ones((len(phase), 1, 1))
        return one, damping * one, (stiffness + bump)[:, None, None], np.cos(phase)[:, None]

    return PeriodicSystem(matrices, ["q"], breaks=breaks)


def kicked():
    """Return the multipliers in the limit of zero width: once per period, q′ of the constant system changes
    by -q/2."""
    from scipy.linalg import expm

    turn = expm(2 * np.pi * np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]]))
    return np.linalg.eigvals(turn @ np.array([[1.0, 0.0], [-IMPULSE, 1.0]]))


@pytest.mark.parametrize("place", np.linspace(0.1, 6.1, 9))
@pytest.mark.parametrize("method", ["auto", "radau"])
def test_stiffness_pulse_of_a_thousandth_of_the_period_is_detected(place, method):
    stability = floquet(struck(place, 2 * np.pi / 1000), 1.0, method)
    assert stability.warnings == []
    np.testing.assert_allclose(np.abs(stability.multipliers), np.abs(kicked()), rtol=1e-4)


@pytest.mark.parametrize("place", [0.0, np.pi / 8, np.pi / 4, np.pi / 2, np.pi, 5.663832566240261])
@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-8])
@pytest.mark.parametrize("find", [floquet, periodic])
def test_bump_at_nodes_common_to_all_grids_is_detected(place, rtol, find):
    """No other stage of the grids lies near the bump. The grids therefore agree on the solution of another
    system."""
    computed = find(struck(place, 2 * np.pi / 1000), 1.0, rtol=rtol)
    np.testing.assert_allclose(np.abs(computed.multipliers), np.abs(kicked()), rtol=2 * rtol + 1e-4)


def test_bump_at_a_node_makes_its_system_unstable():
    """In q″ + 0.02 q′ + 3.9 q, q′ changes by -q/2 once per period. In the limit of zero width, a product of
    two exponentials, the spectral radius is 1.061."""
    from scipy.linalg import expm

    turn = expm(2 * np.pi * np.array([[0.0, 1.0], [-3.9, -0.02]]))
    kick = np.abs(np.linalg.eigvals(turn @ np.array([[1.0, 0.0], [-IMPULSE, 1.0]]))).max()
    given = struck(5.663832566240261, 2 * np.pi / 1000, damping=0.02, stiffness=3.9)
    for find in (floquet, periodic):
        computed = find(given, 1.0)
        assert computed.verdict == "unstable"
        assert computed.spectral_radius == pytest.approx(kick, rel=5e-4)


def test_bump_narrower_than_all_samples_may_be_missed():
    """This is a limitation of every method that samples. A bump that changes the spectral radius by 6 % and
    has a width of 1/100 000 of the period is missed at some of 30 phases. A bump with a width of 1/6000 is
    detected at all of them."""
    free = np.exp(-DAMPING / 2 * 2 * np.pi)
    places = np.random.default_rng(0).uniform(0.0, 2 * np.pi, 30)

    def is_missed(place, width):
        computed = floquet(struck(place, width), 1.0)
        return computed.spectral_radius < 1.01 * free and computed.warnings == []

    assert not any(is_missed(place, 2 * np.pi / 6000) for place in places)
    assert any(is_missed(place, 2 * np.pi / 100_000) for place in places)
    assert np.abs(kicked()).max() > 1.05 * free


@pytest.mark.parametrize("part", [300, 3000, 30_000])
@pytest.mark.parametrize("place", [0.9, 2.4, 5.1])
def test_bumps_between_breaks_are_resolved_at_every_width(place, part):
    width = 2 * np.pi / part
    edges = (place - 6 * width, place + 6 * width)
    orbit = periodic(struck(place, width, edges), 1.0)
    truth = periodic(struck(place, width), 1.0, steps=2 * part, rtol=1e-6)
    error = np.abs(orbit.at(truth.phase) - truth.q).max() / np.abs(truth.q).max()
    assert error <= 1e-8
    assert abs(orbit.spectral_radius / truth.spectral_radius - 1) < 1e-8
    assert orbit.warnings == truth.warnings == []
    few = floquet(struck(place, width, edges), 1.0, steps=6, rtol=1e-12)
    miss = abs(few.spectral_radius / truth.spectral_radius - 1)
    assert miss <= 10 * few.error_estimate.multipliers


def answer(orders, parts):
    """Return the response of q″ + 0.2 q′ + 4 q to a load Re Σ part exp(i order φ), as a function of the
    phase."""
    orders, parts = np.array(orders), np.array(parts, dtype=complex)
    parts /= STIFFNESS - orders**2 + 1j * DAMPING * orders
    return lambda phase: np.real(np.exp(1j * np.outer(phase, orders)) @ parts)


def oscillator(load, breaks=()):
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, DAMPING * one, STIFFNESS * one, load(phase)[:, None]

    return PeriodicSystem(matrices, ["q"], breaks=breaks)


def ripple(order, part, breaks=()):
    truth = answer([1, order], [1.0, part])
    return oscillator(lambda phase: np.cos(phase) + part * np.cos(order * phase), breaks), truth


def kinked(place):
    """Return an oscillator under a load |cos(φ + place)|. Between kinks, its response is that to a cosine
    plus a free motion that makes the response and its derivative continuous."""
    forced = 1 / (STIFFNESS - 1 + 1j * DAMPING)
    rate = -DAMPING / 2 + 1j * np.sqrt(STIFFNESS - DAMPING**2 / 4)
    real = 2 * forced.imag
    free = (real + 1j * (rate.real * real - 2 * forced.real) / rate.imag) / (2 * np.sinh(rate * np.pi / 2))

    def truth(phase):
        since = np.remainder(phase + place + np.pi / 2, np.pi) - np.pi / 2
        return np.real(forced * np.exp(1j * since) + free * np.exp(rate * since))

    return oscillator(lambda phase: np.abs(np.cos(phase + place))), truth


RIPPLES = [
    ripple(order, part, breaks)
    for breaks in ((), (0.7, 2.9))
    for order in (115, 128, 160, 224, 260, 300)
    for part in (1e-2, 1e-4)
]


@pytest.mark.parametrize("case", [*RIPPLES, *map(kinked, (0.0, 0.7, 1.777, 2.9))])
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_error_covers_harmonics_above_the_step_resolution(case, rtol):
    """Harmonics whose order exceeds the number of samples are aliased in nearly the same way on all grids."""
    given, truth = case
    computed, phase = periodic(given, 1.0, rtol=rtol), np.linspace(0, 2 * np.pi, 801)
    q = truth(phase)
    error = np.abs(computed.at(phase)[0] - q).max() / np.abs(q).max()
    assert error <= 10 * computed.error_estimate.orbit <= 10 * rtol
