"""Jeffcott rotor that rubs against a ring, without contact at rest: circular orbit in closed form."""

import numpy as np
import pytest
from scipy.optimize import brentq

import solve
from derive import Max, Mechanism, cos, rate, sin, sqrt
from solve.errors import ValueOutOfBoundsError

NUMBERS = {"m": 1.0, "k": 1e4, "c": 10.0, "u": 1e-4, "kr": 4e4, "gap": 2e-4}


def jeffcott():
    made = Mechanism("jeffcott", "Jeffcott rotor in a ring")
    x, y = made.coordinates(x=("m", "across"), y=("m", "up"))
    m, k, c = made.parameters(
        m=("kg", "disc", "> 0"), k=("N/m", "shaft", "> 0"), c=("N s/m", "damper", ">= 0")
    )
    u, kr, gap = made.parameters(
        u=("kg m", "unbalance"), kr=("N/m", "ring", ">= 0"), gap=("m", "clearance of the ring")
    )
    made.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = k * (x**2 + y**2) / 2 + kr * Max(0, sqrt(x**2 + y**2) - gap) ** 2 / 2
    made.dissipation = c * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.force(u * made.speed**2 * cos(made.phase), along=x)
    made.force(u * made.speed**2 * sin(made.phase), along=y)
    return made


def rubbing_amplitude(speed, m=1.0, k=1e4, c=10.0, u=1e-4, kr=4e4, gap=2e-4):
    """Largest A with contact, or None: (s A - kr gap)² + (c Ω A)² = (u Ω²)² with s = k - mΩ² + kr."""
    s = k + kr - m * speed**2
    roots = np.roots([s**2 + (c * speed) ** 2, -2 * s * kr * gap, (kr * gap) ** 2 - (u * speed**2) ** 2])
    return max(roots.real) if np.isreal(roots).all() and max(roots.real) > gap else None


@pytest.fixture(scope="module")
def rotor():
    return solve.load(jeffcott, **NUMBERS)


def amplitude(speed, m, k, c, u, kr, gap):
    """Largest A with |k - mΩ² + kr (1 - gap/A)⁺ + i c Ω| A = u Ω²."""

    def residual(A):
        return abs(k - m * speed**2 + kr * max(0.0, 1 - gap / A) + 1j * c * speed) * A - u * speed**2

    free = u * speed**2 / abs(k - m * speed**2 + 1j * c * speed)
    return free if free <= gap else brentq(residual, gap, free, xtol=1e-16)


def test_ring_has_no_effect_at_rest(rotor):
    orbit = solve.periodic(rotor, 90.0)
    assert orbit.statistics("x").max == pytest.approx(amplitude(90.0, **{**NUMBERS, "kr": 0.0}), rel=1e-9)


@pytest.mark.parametrize("speed", [40.0, 75.0, 90.0])
def test_rubbing_orbit_matches_the_closed_form(rotor, speed):
    """At 90 rad/s, the amplitude is 209.7303 µm; at 40 rad/s, the rotor does not touch the ring."""
    orbit = solve.nonlinear(rotor, speed)
    assert orbit.statistics("x").max == pytest.approx(amplitude(speed, **NUMBERS), rel=1e-8)
    assert orbit.statistics("y").min == pytest.approx(-amplitude(speed, **NUMBERS), rel=1e-8)
    if speed == 90.0:
        assert orbit.statistics("x").max == pytest.approx(209.7303e-6, abs=5e-11)


def test_branch_passes_the_speed_at_which_contact_begins(rotor):
    """At 82.063 rad/s, the rotor touches the ring at all phases simultaneously."""
    found = solve.branch(rotor, "60:140 rad/s", rtol=1e-6)
    assert found.values[-1] == 140.0
    (touching,) = found.grazing
    free = [amplitude(touching["speed"] * (1 + side), **NUMBERS) for side in (-1e-4, 1e-4)]
    assert free[0] < NUMBERS["gap"] < free[1]
    for speed, peak in zip(found.values, found.peaks[:, 0], strict=True):
        stiffness = 1e4 - speed**2 + 4e4 * max(0.0, 1 - 2e-4 / peak) + 10j * speed
        assert abs(stiffness) * peak == pytest.approx(1e-4 * speed**2, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("speeds", ["100:240 rad/s", "240:100 rad/s"])
def test_slow_sweep_jumps_where_contact_begins(rotor, speeds):
    """Above the resonance, the branch turns back at the grazing orbit, to unstable orbits with contact. It is
    followed in both directions, so that the grazing orbit is reached once without and once with contact."""
    found = solve.branch(rotor, speeds, rtol=1e-6)
    jumps = {jump["direction"]: jump for jump in found.jumps}
    down, up = jumps["down"]["speed"], jumps["up"]["speed"]
    free = {**NUMBERS, "kr": 0.0}
    touching = brentq(lambda speed: amplitude(speed, **free) - NUMBERS["gap"], 110, 240)
    assert down == pytest.approx(touching, rel=1e-4)
    assert jumps["down"]["to"] == pytest.approx(rubbing_amplitude(down), rel=0.02)
    assert jumps["up"]["to"] == pytest.approx(amplitude(up, **free), rel=0.02)
    assert [point["speed"] for point in found.folds] == [up]
    assert rubbing_amplitude(up * (1 - 1e-6)) > NUMBERS["gap"]
    assert rubbing_amplitude(up * (1 + 1e-6)) is None


def test_transient_from_the_middle_of_the_ring_reaches_the_orbit(rotor):
    """In the initial state, the ring force is 0·(0/0)."""
    transient = solve.transient(rotor, 90.0, turns=60, nonlinear=True)
    assert np.isfinite(transient.q).all()
    assert np.abs(transient.q[0]).max() == pytest.approx(np.abs(transient.q).max(), rel=0.2)
    last = np.hypot(*transient.q[:, -64:])
    assert last == pytest.approx(np.full(64, amplitude(90.0, **NUMBERS)), rel=1e-3)


def test_ring_with_preload_at_rest_is_refused():
    with pytest.raises(ValueOutOfBoundsError, match=r"gap > 0 does not hold for gap = -0\.0002 m"):
        solve.load(jeffcott, **{**NUMBERS, "gap": -2e-4})
