"""Branches across orbits that graze a stop."""

import numpy as np
import pytest

import solve
from derive import Max, Mechanism, cos, rate
from solve.equations import events_of, nonlinear_of
from solve.newton.arclength import first_point
from solve.newton.branches import continuation
from solve.newton.grazing import points_beyond
from solve.newton.manifold import Manifold
from solve.newton.special_points import zero_between
from solve.results.branch import DOUBLING, FOLD, GRAZING, KINDS
from tests.solve.newton.mechanisms import model_of, stop, two_stops
from tests.solve.newton.shooting import doubling, fold, located
from tests.solve.newton.test_events import NUMBERS, SPEED, integrated

REACH = NUMBERS["f"] / abs(1 - SPEED**2 + 2j * NUMBERS["zeta"] * SPEED)
"""Amplitude of the mass without the stop."""


@pytest.fixture(scope="module")
def grazing():
    """Parameters other than the clearance, and the orbit that nearly touches the stop."""
    gap = 1.00001 * REACH
    model = model_of(stop(), **NUMBERS | {"gap": gap})
    parameters, _ = continuation(model, SPEED, f"gap={gap!r}:{0.8 * REACH!r}", 1, 1e-7, "auto")
    return parameters, first_point(parameters, solve.nonlinear(model, SPEED), gap)


def test_orbit_beyond_a_grazing_orbit_equals_integration(grazing):
    parameters, before = grazing
    (*_, after), _ = points_beyond(Manifold(parameters), before)
    gap = after.value
    assert gap < 1.00001 * REACH
    curve = after.unknowns.curve
    state = np.array([curve(np.zeros(1))[0, 0], SPEED * curve(np.zeros(1), 1)[0, 0]])
    end, Phi, events = integrated(state, NUMBERS | {"gap": gap})
    assert end == pytest.approx(state, abs=1e-6)
    assert len(events) == 2
    found = nonlinear_of(parameters.task_at(after.orbit.values).system).along_events(curve, SPEED)
    assert events_of(found).phases == pytest.approx(events, abs=1e-4)
    assert sorted(np.abs(after.orbit.multipliers)) == pytest.approx(
        sorted(np.abs(np.linalg.eigvals(Phi))), abs=1e-5
    )


def test_orbit_with_unchanged_events_is_not_grazing():
    model = model_of(stop(), **NUMBERS)
    parameters, _ = continuation(model, SPEED, "gap=0.5:0.4", 1, 1e-7, "auto")
    inside = first_point(parameters, solve.nonlinear(model, SPEED), NUMBERS["gap"])
    with pytest.raises(solve.errors.NoOrbitError, match="no orbit with other events was found nearby"):
        points_beyond(Manifold(parameters), inside)


@pytest.mark.parametrize(("speed", "kappa", "way"), [(0.6, 300.0, 1), (2.2, 100.0, -1)])
def test_branch_continues_on_the_unstable_orbit_after_grazing(speed, kappa, way):
    """At the lower speed, the branch turns back to larger clearances; at the higher speed, it continues to
    smaller ones. At the lower speed, it does not jump to the stable orbit that coexists."""
    numbers = NUMBERS | {"kappa": kappa}
    reach = 1 / abs(1 - speed**2 + 2j * numbers["zeta"] * speed)
    gap = 1.00001 * reach
    model = model_of(stop(), **numbers | {"gap": gap})
    parameters, _ = continuation(model, speed, f"gap={gap!r}:{0.9 * reach!r}", 1, 1e-7, "auto")
    before = first_point(parameters, solve.nonlinear(model, speed), gap)
    (*_, after), _ = points_beyond(Manifold(parameters), before)
    assert way * (after.value - gap) > 0
    assert way * after.direction.value > 0
    curve = after.unknowns.curve
    state = np.array([curve(np.zeros(1))[0, 0], speed * curve(np.zeros(1), 1)[0, 0]])
    end, Phi, events = integrated(state, numbers | {"gap": after.value}, speed)
    assert end == pytest.approx(state, abs=1e-6)
    assert len(events) == 2
    rho = np.sort(np.abs(after.orbit.multipliers))
    assert rho[-1] > 1.2
    assert rho == pytest.approx(np.sort(np.abs(np.linalg.eigvals(Phi))), rel=1e-6)


HARD = NUMBERS | {"kappa": 300.0}
HARD_REACH = HARD["f"] / abs(1 - 0.6**2 + 2j * HARD["zeta"] * 0.6)
"""Numbers of a hard stop, and the amplitude of the mass without this stop at 0.6 times its frequency."""


def hard_branch(begin):
    """Branch over decreasing clearance from `begin` times the amplitude without the stop."""
    gap = begin * HARD_REACH
    model = model_of(stop(), **HARD | {"gap": gap})
    return solve.branch(model, 0.6, over=f"gap={gap!r}:{0.9 * HARD_REACH!r}", rtol=1e-6)


@pytest.fixture(scope="module")
def hard_fold():
    """Clearance at the fold of the hard stop, by shooting."""
    found, zero = hard_branch(1.001), np.zeros(1)
    curve = found.curve(int(np.flatnonzero(found.turns)[0]))
    state = np.array([curve(zero)[0, 0], 0.6 * curve(zero, 1)[0, 0]])

    def returned(x, gap):
        return integrated(x, HARD | {"gap": gap}, 0.6)[:2]

    return located(fold, returned, state, found.folds[0]["gap"])[0]


@pytest.mark.parametrize(
    "begin", [1.00001, 1.001, *(pytest.param(far, marks=pytest.mark.slow) for far in (1.05, 1.2))]
)
def test_branch_that_starts_near_grazing_orbit_has_jump(hard_fold, begin):
    """The branch turns back at a fold that is 5e-6 from the grazing orbit. The nearest starts are within a
    step of it."""
    found = hard_branch(begin)
    assert found.ended == ""
    assert found.grazing == []
    jump, only = found.jumps[0], found.folds[0]
    assert jump["direction"] == "down"
    assert jump["gap"] == only["gap"]
    assert only["gap"] == pytest.approx(hard_fold, rel=1e-8)
    assert 1e-6 < 1 - hard_fold / HARD_REACH < 1e-5


def test_branch_turns_back_from_orbit_just_beyond_grazing():
    """The last orbit before the step along the switching function already has two events."""
    zeta, speed = 0.035, 1.25
    reach = 1 / abs(1 - speed**2 + 2j * zeta * speed)
    gap = (1 + 6e-5) * reach
    model = model_of(stop(), zeta=zeta, k=1.0, kappa=350.0, gap=gap, f=1.0)
    found = solve.branch(model, speed, over=f"gap={gap!r}:{0.97 * reach!r}", rtol=1e-5)
    assert found.ended == ""
    assert found.values[-1] == gap
    assert found.peaks[-1, 0] > gap
    assert found.radius[-1] > 1


def test_branch_that_turns_back_does_not_retrace_itself():
    """Within the tolerance, an orbit beyond the fold looks like one before it. All orbits after the fold
    touch the stops."""
    zeta, speed = 0.0261, 1.5261
    reach = 1 / abs(1 - speed**2 + 2j * zeta * speed)
    model = model_of(two_stops(), zeta=zeta, k=1.0, kappa=109.4, gap=reach, f=0.85)
    found = solve.branch(model, speed, over="f=0.85:1.3", rtol=1e-4)
    assert found.ended == ""
    (only,) = found.folds
    assert only["f"] == pytest.approx(1, abs=1e-4)
    turn = int(found.values.argmax())
    assert (found.peaks[turn + 1 :, 0] > reach).all()
    assert found.values[-1] == 0.85


def test_branch_over_load_passes_two_stops_simultaneously():
    zeta, speed = 0.029, 0.78
    reach = 1 / abs(1 - speed**2 + 2j * zeta * speed)
    model = model_of(two_stops(), zeta=zeta, k=1.0, kappa=37.0, gap=reach, f=0.85)
    found = solve.branch(model, speed, over="f=0.85:1.3", rtol=1e-4)
    assert (found.ended, found.folds, found.values[-1]) == ("", [], 1.3)


@pytest.mark.parametrize(
    ("zeta", "kappa"), [(0.05, 300.0), pytest.param(0.1, 2000.0, marks=pytest.mark.slow)]
)
def test_branch_passes_orbit_that_grazes_two_stops(zeta, kappa):
    """Beyond this orbit the symmetric orbits are unstable, although the branch does not turn back."""
    numbers = {"zeta": zeta, "k": 1.0, "kappa": kappa, "gap": 2.0, "f": 1.0}
    grazing_speed = np.sqrt(1 - 2 * zeta**2 - np.sqrt((1 - 2 * zeta**2) ** 2 - 3 / 4))
    model, speed = model_of(two_stops(), **numbers), 0.73
    branch = solve.branch(model, (0.7, speed), rtol=1e-6)
    assert branch.ended == ""
    assert (branch.folds, branch.doublings, branch.tori) == ([], [], [])
    touches, is_near = branch.peaks[:, 0] > 2, np.abs(branch.values / grazing_speed - 1) < 2e-6
    assert (touches | is_near).tolist() == ((branch.values > grazing_speed) | is_near).tolist()
    assert branch.values[-1] == speed
    # The stored curve is too inaccurate to start shooting for such multipliers.
    orbit = solve.nonlinear(model, speed, start=branch.curve(len(branch.values) - 1))
    x = np.array([orbit.q[0, 0], orbit.qd[0, 0]])
    for _ in range(2):
        after, Phi, events = integrated(x, numbers, speed, abs)
        x = x + np.linalg.solve(np.eye(2) - Phi, after - x)
    assert len(events) == 4
    assert np.array(events[2:]) - events[:2] == pytest.approx(np.pi, abs=1e-6)
    assert branch.peaks[-1, 0] == pytest.approx(orbit.statistics("q").max_abs, rel=1e-6)
    rho = np.sort(np.abs(branch.multipliers[-1]))
    assert rho[-1] > 10
    assert rho == pytest.approx(np.sort(np.abs(np.linalg.eigvals(Phi))), rel=1e-4)


def test_grazing_orbits_on_a_branch_have_the_single_verdict():
    gap = 1.0005 * REACH
    model = model_of(stop(), **NUMBERS | {"gap": gap})
    found = solve.branch(model, SPEED, over=f"gap={gap!r}:{1.3 * REACH!r}", points=2)
    assert solve.nonlinear(model, SPEED).verdict == "undetermined"
    assert found.verdicts == ["undetermined", "asymptotically stable"]


@pytest.mark.slow
def test_slider_crank_branch_passes_grazing_orbit():
    """Without a step beyond the orbit at 1018.54 rpm, the branch would end there."""
    found = solve.branch(solve.load("slider_crank"), "1018:1088 rpm", points=10)
    assert found.ended.startswith("the branch continues")
    (point,) = found.grazing
    assert point["speed"] * 30 / np.pi == pytest.approx(1018.54, abs=0.01)
    at = int(np.flatnonzero(found.kinds == KINDS.index(GRAZING))[0])
    assert found.verdicts[at] == "undetermined"
    assert found.radius.max() < 1


def rattling(order):
    """Mass on two springs, one of them with a clearance, under a load with the given harmonic."""
    made = Mechanism("rattling", "Mass on two springs, one with a clearance", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    c, k, gap = made.parameters(
        c=("1/s", "damping"), k=("1/s^2", "stiffness"), gap=("1", "clearance of the second spring")
    )
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2 + k * Max(0, q - gap) ** 2 / 2
    made.force(k * cos(order * made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return made


@pytest.mark.parametrize(("order", "chatters"), [(16, False), (17, True)])
def test_more_than_32_events_per_period_give_a_warning(order, chatters):
    """The mass crosses the switch twice per period of the load."""
    model = solve.load(lambda: rattling(order), c=2.0, k=400.0, gap=0.1)
    orbit = solve.nonlinear(model, 1.0, rtol=1e-6, engine="numpy")
    assert len(orbit.events) == 2 * order
    warnings = [text for text in orbit.warnings if "chatter" in text]
    assert len(warnings) == chatters
    assert all(f"{2 * order} times" in text and "\n" not in text for text in warnings)


def test_more_than_128_events_per_period_are_refused():
    model = solve.load(lambda: rattling(70), c=2.0, k=7656.25, gap=0.02)
    with pytest.raises(solve.errors.ChatterError) as refused:
        solve.nonlinear(model, 1.0, rtol=1e-6, engine="numpy")
    text = str(refused.value)
    assert "140 times per period" in text
    assert "allowed: 128 times" in text
    assert "\n" not in text
    phase = float(text.split("near phase ")[1].split(" rad")[0])
    assert 0 <= phase < 2 * np.pi
    assert text.endswith("give the contact more damping or less stiffness")


RESONANT = {"zeta": 0.05, "k": 1.0, "kappa": 30.0, "gap": 2.0, "f": 1.0}
GRAZING_SPEEDS = np.sqrt(1 - 2 * 0.05**2 + np.array([-1, 1]) * np.sqrt((1 - 2 * 0.05**2) ** 2 - 3 / 4))
"""Speeds at which the amplitude without the stop equals the clearance: |1 - Ω² + 2iζΩ| = 1/2."""


def returned(x, speed):
    """Return the state of the resonant mass after one period, and its derivatives."""
    return integrated(x, RESONANT, speed)[:2]


def state_at(found, kind, number):
    """Value and state at phase 0 of a special point of a branch."""
    at = int(np.flatnonzero(found.kinds == KINDS.index(kind))[number])
    curve, speed, zero = found.curve(at), found.values[at], np.zeros(1)
    return speed, np.array([curve(zero)[0, 0], speed * curve(zero, 1)[0, 0]])


@pytest.mark.slow
def test_special_points_next_to_grazing_orbits_equal_shooting():
    """One doubling and one fold are within 4e-5 of the grazing orbits, at which no multiplier is real."""
    found = solve.branch(model_of(stop(), **RESONANT), "0.6:2 rad/s", rtol=1e-7)
    assert (len(found.folds), len(found.doublings), found.tori, found.grazing) == (2, 2, [], [])
    assert [found.doublings[0]["speed"], found.folds[1]["speed"]] == pytest.approx(GRAZING_SPEEDS, rel=4e-5)
    for kind, test in ((FOLD, fold), (DOUBLING, doubling)):
        for number in range(2):
            speed, state = state_at(found, kind, number)
            exact, _ = located(test, returned, state, speed)
            assert speed == pytest.approx(exact, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("speeds", ["0.6:2 rad/s", "2:0.6 rad/s"])
def test_special_points_of_a_hard_stop_are_found_once(speeds):
    """Near the lower grazing orbit, the largest multiplier changes from 0.64 to below -1 within a relative
    change of speed of 1e-6. The branch does not turn back there."""
    found = solve.branch(model_of(stop(), **RESONANT | {"kappa": 300.0}), speeds, rtol=1e-6)
    ends = [float(end) for end in speeds.split()[0].split(":")]
    assert found.values[[0, -1]] == pytest.approx(ends)
    (only,) = [point for point in found.doublings if point["speed"] > 0.72]
    near = [point["speed"] for point in [*found.grazing, *found.doublings] if point["speed"] < 0.72]
    assert len(found.folds) == 2
    assert sorted(point["speed"] for point in found.folds)[0] == pytest.approx(GRAZING_SPEEDS[1], rel=1e-5)
    assert near == pytest.approx([GRAZING_SPEEDS[0]], rel=3e-5)
    assert {jump["direction"] for jump in found.jumps} == {"up", "down"}
    assert only["multiplier"] == pytest.approx(-1, abs=1e-4)


@pytest.mark.parametrize(("jumps", "words"), [(True, "not located"), (False, "")])
def test_discontinuous_function_has_no_zero(jumps, words):
    def function(argument):
        return (np.sign(argument - 0.3) if jumps else argument - 0.3), argument

    def agree(one, other):
        return abs(one - other) < 1e-6

    ends = (0.0, 1.0), (function(0.0)[0], function(1.0)[0])
    if jumps:
        with pytest.raises(solve.errors.NoOrbitError, match=words):
            zero_between(function, *ends, agree, 0.0)
    else:
        assert zero_between(function, *ends, agree, 0.0)[0] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("zeta", "kappa", "gap", "speeds"),
    [
        (0.07052568751940078, 98.7369959466119, 1.3206630229499496, "0.62:2 rad/s"),
        pytest.param(0.10938717392199174, 349.8, 2.5765622090932165, "0.62:2 rad/s", marks=pytest.mark.slow),
        pytest.param(0.087, 300.0, 2.2, "0.6:2 rad/s", marks=pytest.mark.slow),
    ],
)
def test_branch_lists_every_fold_and_grazing_orbit(zeta, kappa, gap, speeds):
    """The orbit without contact grazes the stop if its amplitude equals the clearance."""
    model = model_of(stop(), zeta=zeta, k=1.0, kappa=kappa, gap=gap, f=1.0)
    branch = solve.branch(model, speeds, rtol=1e-4, points=120)
    ways = np.sign(np.diff(branch.values))
    marked = np.isin(branch.kinds, [KINDS.index(FOLD), KINDS.index(GRAZING)])
    for at in (np.flatnonzero(ways[1:] * ways[:-1] < 0) + 1).tolist():
        assert marked[at - 1 : at + 2].any()
    listed = np.array([point["speed"] for point in (*branch.grazing, *branch.folds)])
    for exact in np.sqrt(np.roots([1, 4 * zeta**2 - 2, 1 - gap**-2])):
        if branch.values[0] < exact < branch.values[-1]:
            assert np.abs(listed / exact - 1).min() < 1e-4


@pytest.mark.parametrize(
    ("made", "zeta", "kappa", "speed"), [(stop, 0.054, 1120.0, 1.215), (two_stops, 0.0673, 794.0, 1.887)]
)
def test_branch_may_turn_back_and_leave_range_in_step_beyond_grazing(made, zeta, kappa, speed):
    """The range begins 1e-6 before the grazing orbit."""
    reach = 1 / abs(1 - speed**2 + 2j * zeta * speed)
    numbers = {"zeta": zeta, "k": 1.0, "kappa": kappa, "gap": reach, "f": 1 - 1e-6}
    model = model_of(made(), **numbers)
    found = solve.branch(model, speed, over=f"f={numbers['f']!r}:1.1", rtol=1e-5)
    assert found.ended == ""
    assert found.values[-1] == found.values[0] == numbers["f"]
    orbit = solve.nonlinear(model, speed, start=found.curve(len(found.values) - 1))
    x = np.array([orbit.q[0, 0], orbit.qd[0, 0]])
    for _ in range(2):
        after, Phi, events = integrated(x, numbers, speed, *((abs,) if made is two_stops else ()))
        x = x + np.linalg.solve(np.eye(2) - Phi, after - x)
    assert len(events) in (2, 4)
    assert found.radius[-1] == pytest.approx(np.abs(np.linalg.eigvals(Phi)).max(), rel=1e-3)
    assert found.radius[-1] > 2
