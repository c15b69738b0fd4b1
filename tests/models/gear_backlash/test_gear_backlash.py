"""Gear pair with backlash compared with integration from event to event."""

import numpy as np
import pytest

import solve
from tests.models.gear_backlash.integration import fold, orbit

SPEED = 27400.0
"""A speed, rad/s, at which the teeth separate."""


def by_modulus(values):
    return values[np.lexsort((values.imag, np.abs(values)))]


def reference(found, **given):
    return orbit([found.q[0, 0], found.qd[0, 0] / found.speed], found.speed, **given)


def largest_difference(found, **given):
    """Largest differences from the reference: of the state (relative to the orbit), the multipliers and the
    events."""
    state, multipliers, events = reference(found, **given)
    off = [found.q[0, 0] - state[0], found.qd[0, 0] / found.speed - state[1]]
    assert len(events) == len(found.events)
    return max(
        np.abs(off).max() / np.abs(found.q).max(),
        np.abs(by_modulus(found.multipliers) - by_modulus(multipliers)).max(),
        np.abs(np.array(found.events) - events).max(initial=0.0),
    )


def fraction(found, output):
    return found.statistics(output).mean


@pytest.fixture(scope="module")
def single():
    return solve.nonlinear(solve.load("gear_backlash"), SPEED)


def test_single_sided_contact(single):
    assert largest_difference(single) < 1e-8
    first, second = single.events
    assert fraction(single, "driving_contact") == pytest.approx(1 - (second - first) / 2 / np.pi, abs=1e-3)
    assert fraction(single, "back_contact") == 0
    deflection = 2000 / 4e8 + single.statistics("q").min
    assert single.statistics("gap").max == pytest.approx(-deflection, rel=1e-9)
    assert single.statistics("mesh_force").min == 0
    assert fraction(single, "mesh_force") == pytest.approx(2000, rel=1e-5)


def test_double_sided_contact():
    found = solve.nonlinear(solve.load("gear_backlash", "rattling"), 26000.0)
    assert largest_difference(found, load=50.0, half=5e-6, error=3e-6) < 1e-8
    assert len(found.events) == 4
    assert not any("does not settle" in text for text in found.warnings)
    assert fraction(found, "driving_contact") > 0.2
    assert fraction(found, "back_contact") > 0.2
    assert found.statistics("gap").max == pytest.approx(1e-5, rel=1e-9)
    assert found.statistics("mesh_force").min < 0


def test_rectangular_mesh_stiffness():
    model = solve.load("gear_backlash", options={"mesh": "rectangular"}, E=3e-6)
    found = solve.nonlinear(model, SPEED)
    assert model.breaks == pytest.approx([0, 0.6 * np.pi, np.pi, 1.4 * np.pi])
    assert found.events
    assert largest_difference(found, share=0.6, error=3e-6) < 1e-8


def test_order_of_convergence_with_events(single):
    """With Gauss's method of order 6, multipliers converge with order 6 and curves with order 4."""
    _, multipliers, _ = reference(single)
    errors = []
    for steps in (16, 32):
        found = solve.nonlinear(single.system.model, SPEED, single, method=solve.Gauss(order=6), steps=steps)
        errors.append(np.abs(by_modulus(found.multipliers) - by_modulus(multipliers)).max())
    assert errors[1] > 1e-13
    assert np.log2(errors[0] / errors[1]) > 4


@pytest.mark.parametrize("half", [50e-6, 0.0])
def test_orbit_is_zero_if_the_loads_cancel(half):
    """At Ω² = e F/(m E), 20000 rad/s, the loads cancel except for round-off, which differs at each phase."""
    found = solve.nonlinear(solve.load("gear_backlash", b=half), 20000.0)
    assert not found.q.any()
    assert (found.steps, found.events, found.warnings) == (64, (), [])
    _, multipliers, _ = reference(found, half=half)
    np.testing.assert_allclose(by_modulus(found.multipliers), by_modulus(multipliers), atol=1e-10)


@pytest.mark.parametrize("change", [1e-12, 1e-9, 1e-6])
def test_errors_contain_the_round_off_of_loads_that_nearly_cancel(change):
    """In contact, the equation is m q̈ + c q̇ + k (1 + e cos φ) q = (m Ω² E - e F) cos φ. There is no
    cancellation if the coefficient on the right-hand side is evaluated as one number."""
    speed = 20000.0 * (1 + change)
    found = solve.nonlinear(solve.load("gear_backlash"), speed)
    load = 0.5 * 1e-6 * (speed - 20000.0) * (speed + 20000.0)
    unit = solve.PeriodicSystem(
        lambda phase, speed: (
            np.full((len(phase), 1, 1), 0.5),
            np.full((len(phase), 1, 1), 848.528137423857),
            4e8 * (1 + 0.1 * np.cos(phase))[:, None, None],
            np.cos(phase)[:, None],
        ),
        ["q"],
    )
    exact = load * solve.periodic(unit, speed, rtol=1e-10).at(found.phase)
    off = np.abs(found.q - exact).max() / np.abs(exact).max()
    assert off <= found.error_estimate.orbit
    assert found.error_estimate.orbit < 1e-14 / change
    assert bool(found.warnings) == (found.error_estimate.orbit > 1e-8)


def test_branch_passes_through_the_speed_without_vibration():
    """At Ω² = e F/(m E), 20000 rad/s, q = 0 is the exact orbit."""
    found = solve.branch(solve.load("gear_backlash"), "18000:22000 rad/s", points=40)
    assert not found.warnings
    assert found.values[-1] == pytest.approx(22000)
    near = np.abs(found.values - 20000.0).argmin()
    assert found.peaks[near, 0] < 0.05 * found.peaks[0, 0]


@pytest.mark.slow
def test_jumps_of_a_slow_sweep():
    found = solve.branch(solve.load("gear_backlash"), "24000:30000 rad/s", rtol=1e-8)
    up, down = found.jumps
    assert (up["direction"], down["direction"]) == ("up", "down")
    model, beside = solve.load("gear_backlash"), None
    low = solve.nonlinear(model, 27270.0)
    for speed in (SPEED, 27250, 27100, 26950, 26800, 26700, 26620, 26580):
        beside = solve.nonlinear(model, float(speed), beside)
    for jump, start in ((up, low), (down, beside)):
        state = [start.q[0, 0], start.qd[0, 0] / start.speed]
        assert jump["speed"] == pytest.approx(fold(state, jump["speed"]), rel=1e-6)


@pytest.mark.slow
def test_twenty_speeds():
    model, start = solve.load("gear_backlash"), None
    separate = 0
    for speed in np.linspace(28500, 26600, 20):
        start = solve.nonlinear(model, float(speed), start)
        assert largest_difference(start) < 1e-8
        separate += bool(start.events)
    assert separate >= 5
