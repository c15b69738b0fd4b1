"""Time marching until the transient has decayed: required number of revolutions, and result."""

import re

import numpy as np
import pytest

from solve import Newmark, floquet, periodic
from solve.errors import StepsError, ValueOutOfBoundsError
from solve.methods.march import March
from tests.solve.certificates.population import member
from tests.solve.references import relative_error
from tests.solve.systems import constant, random_system


def oscillator(frequency, radius):
    """Oscillator with |ρ| = radius at 1 rad/s."""
    damping = -np.log(radius) / np.pi
    return constant(np.eye(1), [[damping]], [[frequency**2]], lambda phase: 0.3 + np.cos(phase)[:, None])


def turns(orbit):
    (note,) = (text for text in orbit.notes if text.startswith("march: "))
    match = re.fullmatch(r"march: (\d+) periods until the transient decayed to \S+ of its initial size", note)
    assert match, note
    return int(match[1])


@pytest.mark.parametrize("radius", [0.2, 0.485, 0.674, 0.9, 0.97])
def test_revolutions_to_convergence_follow_from_the_multiplier(radius):
    orbit = periodic(oscillator(1.0, radius), 1.0, "march", steps=400, rtol=0.9)
    expected = np.log(1e-4) / np.log(orbit.spectral_radius)
    assert abs(turns(orbit) - np.ceil(expected)) <= 1


@pytest.mark.parametrize("frequency", [0.7, 1.0, 1.3, 1.6])
def test_revolutions_at_the_spectral_radius_of_the_thesis(frequency):
    """|ρ| = 0.674 at 62 rad/s: ln 1e-4 / ln 0.674 = 23.3, to within one revolution."""
    computed = turns(periodic(oscillator(frequency, 0.674), 1.0, "march", steps=400, rtol=0.9))
    assert abs(computed - np.ceil(23.3)) <= 1


@pytest.mark.parametrize("frequency", [0.3, 0.7, 1.6, 3.4])
@pytest.mark.parametrize("radius", [0.2, 0.674, 0.9, 0.97])
def test_number_of_revolutions_depends_on_the_convergence_norm(frequency, radius):
    """‖(q, q′)‖ of a free motion varies by the factor ω within a cycle."""
    orbit = periodic(oscillator(frequency, radius), 1.0, "march", steps=400, rtol=0.9)
    decay = -np.log(orbit.spectral_radius)
    shift = abs(np.log(frequency)) / decay
    assert abs(turns(orbit) - np.log(1e4) / decay) <= 1.1 * shift + 2


@pytest.mark.parametrize("index", [0, 4, 8, 20, 24, 40, 56])
def test_revolutions_per_decade_follow_from_the_slowest_mode(index):
    """With several modes, the first decades depend on the load, and later ones on the spectral radius
    only."""
    given = member(index)
    needed = [
        turns(periodic(given.system, given.speed, March(tolerance=t), steps=200, rtol=0.9))
        for t in (1e-6, 1e-10)
    ]
    radius = floquet(given.system, given.speed, "newmark", steps=200, rtol=0.9).spectral_radius
    assert needed[1] - needed[0] == pytest.approx(np.log(1e-4) / np.log(radius), rel=0.05, abs=1.5)


def test_hand_coded_marching_takes_the_same_revolutions():
    """The reference starts from rest and uses the average-acceleration method."""
    system = oscillator(1.3, 0.674)
    h, damping, stiffness = 2 * np.pi / 400, -np.log(0.674) / np.pi, 1.3**2
    force = 0.3 + np.cos(h * np.arange(401))
    limit = periodic(system, 1.0, "newmark", steps=400, rtol=0.9)
    q, v, a = 0.0, 0.0, force[0]
    for turn in range(40):
        predicted, steady = (
            (x + h * y + h**2 / 4 * z, y + h / 2 * z)
            for x, y, z in ((q, v, a), (limit.q[0, 0], limit.qd[0, 0], limit.qdd[0, 0]))
        )
        if turn and np.hypot(*np.subtract(predicted, steady)) <= 1e-4 * np.hypot(*steady):
            break
        for load in force[1:]:
            ahead, rate = q + h * v + h**2 / 4 * a, v + h / 2 * a
            a = (load - damping * rate - stiffness * ahead) / (1 + h / 2 * damping + h**2 / 4 * stiffness)
            q, v = ahead + h**2 / 4 * a, rate + h / 2 * a
    assert abs(turns(periodic(system, 1.0, "march", steps=400, rtol=0.9)) - turn) <= 1


def test_error_estimate_includes_the_remaining_transient():
    system = random_system(3, 2)
    phases = np.linspace(0.0, 2 * np.pi, 301)
    limit = periodic(system, 1.0, "newmark", steps=2000, rtol=0.9)
    for tolerance in (1e-2, 1e-4, 1e-6):
        orbit = periodic(system, 1.0, March(tolerance=tolerance), steps=2000, rtol=0.9)
        left = relative_error(orbit.at(phases), limit.at(phases))
        stated = orbit.error_estimate.orbit
        assert left <= 10 * stated
        # The transients of both solutions that are compared are within the tolerance.
        assert 1e-3 * tolerance < stated < 2 * tolerance + limit.error_estimate.orbit * 1.01
    np.testing.assert_allclose(orbit.multipliers, limit.multipliers, rtol=1e-12)


def test_marching_with_other_settings_of_newmark():
    base = Newmark(0.5, 1 / 6)
    marched = March(tolerance=1e-9, base=base)
    phases = np.linspace(0.0, 2 * np.pi, 301)
    computed, limit = (
        periodic(random_system(3, 2), 1.0, rule, steps=500, rtol=0.9) for rule in (marched, base)
    )
    assert relative_error(computed.at(phases), limit.at(phases)) < 1e-7


@pytest.mark.parametrize(("radius", "most"), [(1.0, 10**6), (1.2, 10**6), (0.9, 50)])
def test_transient_that_does_not_decay_is_refused(radius, most):
    with pytest.raises(StepsError, match=rf"does not decay within {most} periods .* such as radau"):
        periodic(oscillator(1.3, radius), 1.0, March(most_turns=most), steps=400)


@pytest.mark.parametrize("tolerance", [0.0, 1.0, -1e-3, np.nan])
def test_invalid_march_tolerances_are_refused(tolerance):
    with pytest.raises(ValueOutOfBoundsError, match=r"tolerance of march is .*; allowed: between 0 and 1"):
        March(tolerance=tolerance)
