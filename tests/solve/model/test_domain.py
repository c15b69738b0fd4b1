"""A fundamental motion that is not real and finite, at a speed or over a range of phases, is refused."""

import math
from functools import cache

import numpy as np
import pytest
import sympy

import solve
from derive import Heaviside, Mechanism, acos, asin, atan2, cos, log, pi, rate, sin, sqrt, tan, tanh
from solve.equations import require_desired_motion
from solve.errors import DesiredMotionError, MatricesError, NoResultError
from solve.system import check
from tests.derive.modules import module_of

BEAD = {"m": 0.5, "a": 0.2, "g": 9.81, "c": 2e-3}
LEAST = math.sqrt(9.81 / 0.2)
"""Speed of the hoop above which the bead leaves the bottom: cos q = g/(a Ω²)."""


def bead():
    """Bead on a hoop that rotates about its vertical diameter."""
    made = Mechanism("bead", "Bead on a hoop")
    q = made.coordinate("q", "rad", "angle from the bottom")
    m, a, g = made.parameters(m=("kg", "bead", "> 0"), a=("m", "hoop", "> 0"), g=("m/s^2", "gravity", "> 0"))
    c = made.parameter("c", "N m s/rad", "drag", ">= 0")
    made.kinetic = m * a**2 * (rate(q) ** 2 + (made.speed * sin(q)) ** 2) / 2
    made.potential = -m * g * a * cos(q)
    made.dissipation = c * rate(q) ** 2 / 2
    made.fundamental(q=acos(g / (a * made.speed**2)))
    return made


@pytest.fixture(scope="module")
def hoop():
    return solve.load(bead, **BEAD)


@pytest.mark.parametrize("speed", [1.001 * LEAST, 8.0, 12.0])
def test_multipliers_of_the_bead_match_the_closed_form(hoop, speed):
    """The equation is m a² q̈ + c q̇ + m a² Ω² sin² q₀ q = 0."""
    inertia = BEAD["m"] * BEAD["a"] ** 2
    decay, stiffness = BEAD["c"] / inertia / 2, speed**2 - (9.81 / 0.2) ** 2 / speed**2
    exponent = -decay + 1j * math.sqrt(stiffness - decay**2)
    stability = solve.floquet(hoop, speed)
    assert stability.multipliers[0] == pytest.approx(np.exp(2 * math.pi * exponent / speed), rel=1e-7) or (
        stability.multipliers[0]
        == pytest.approx(np.exp(2 * math.pi * exponent.conjugate() / speed), rel=1e-7)
    )


@pytest.mark.parametrize("work", [solve.floquet, solve.periodic, solve.nonlinear, solve.transient])
@pytest.mark.parametrize("speed", [6.0, 0.999 * LEAST])
def test_bead_is_refused_below_the_minimum_speed(hoop, work, speed):
    with pytest.raises(
        DesiredMotionError, match=r"fundamental motion of q .* acos\(g/\(a\*speed\*\*2\)\) requires"
    ):
        work(hoop, speed)


def test_speeds_are_reported_in_the_given_unit(hoop):
    for work in (solve.floquet, solve.nonlinear):
        with pytest.raises(DesiredMotionError, match=r"at 6 rad/s:"):
            work(hoop, "6 rad/s")
    with pytest.raises(NoResultError, match=r"at 5 rad/s:"):
        solve.chart(hoop, "speed=5:6:2 rad/s", "c=0.1:0.2:2")


def test_run_up_beyond_the_domain_is_refused(hoop):
    with pytest.raises(DesiredMotionError, match="fundamental motion of q"):
        solve.transient(hoop, speeds=("8 rad/s", "5 rad/s"))


def test_points_fail_individually(hoop):
    sweep = solve.sweep(hoop, [6.0, 7.0, 7.1, 9.0])
    assert [point.error is None for point in sweep.points] == [False, False, True, True]
    assert "acos(g/(a*speed**2))" in (sweep.points[0].error or "")
    over = solve.sweep(hoop, [8.0], over={"a": [0.1, 0.15, 0.16, 0.3]})
    exists = [9.81 / (a * 64) <= 1 for a in (0.1, 0.15, 0.16, 0.3)]
    assert [point.error is None for point in over.points] == exists
    chart = solve.chart(hoop, {"speed": [6.0, 8.0]}, {"a": [0.1, 0.2]}, boundaries=False)
    assert sum("acos" in reason for reason in chart.results.failures.values()) == 3
    with pytest.raises(NoResultError, match="acos"):
        solve.sweep(hoop, [5.0, 6.0]).results.require_any()


def test_motion_is_checked_although_matrices_do_not_depend_on_it():
    """A sweep evaluates the matrices without the motion, but must refuse points without a motion."""
    made = Mechanism("one", "Mass on a spring that follows")
    q = made.coordinate("q", "rad", "angle")
    m, k, w = made.parameters(
        m=("kg m^2", "inertia", "> 0"), k=("N m/rad", "spring"), w=("rad/s", "w", "> 0")
    )
    desired = asin(made.speed / w)
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * (q - desired) ** 2 / 2
    made.fundamental(q=desired)
    model = solve.load(made, m=1, k=2.3, w=5)
    sweep = solve.sweep(model, [3.0, 4.9, 5.1])
    assert [point.error is None for point in sweep.points] == [True, True, False]


@cache
def follower(desired, *names):
    """Return a mechanism whose fundamental motion depends on the phase."""
    made = Mechanism("one", "One coordinate")
    q = made.coordinate("q", "rad", "angle")
    m, k = made.parameters(m=("kg m^2", "inertia", "> 0"), k=("N m/rad", "spring", "> 0"))
    symbols = [made.parameter(name, "1", name) for name in names]
    motion = desired(made.phase, *symbols)
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * (q - motion) ** 2 / 2
    made.fundamental(q=motion)
    return made


def followed(desired, **numbers):
    """Return the model linearised about this motion."""
    return solve.load(follower(desired, *numbers), m=1, k=2, **numbers)


MOTIONS = {
    "sqrt": (lambda p, a: sqrt(a + cos(p)), (0.9, 0.99999, -2), (1.00001, 1.1)),
    "log": (lambda p, a: log(a + sin(p - 0.3)), (0.5, 0.9999, 1), (1.0001, 2)),
    "quotient": (lambda p, a: 1 / (a - cos(p)), (0.3, -1, 1, 0.99999), (1.0001, -1.1)),
    "tan": (lambda p, a: tan(a * sin(p)), (1.6, 5), (1.5, -0.3)),
    "asin": (lambda p, a: asin(a + sin(p) / 2), (0.50001, 0.9, -1), (0.49999, 0)),
    "parameter alone": (lambda p, a: sin(p) / a, (0,), (1e-3,)),
    "short": (lambda p, a: sqrt(1 - a * sympy.exp(-1e3 * sin((p - 1) / 2) ** 2)), (1.01, 3), (0.99, -1)),
}


@pytest.mark.parametrize(
    ("name", "a", "exists"),
    [
        (name, a, exists)
        for name, (_, no, yes) in MOTIONS.items()
        for exists, each in ((0, no), (1, yes))
        for a in each
    ],
)
def test_violations_over_short_phase_ranges_are_detected(name, a, exists):
    """The domains are known in closed form. The violations lie between samples or cover a hundredth of the
    period."""
    if exists:
        assert followed(MOTIONS[name][0], a=a).n == 1
    else:
        with pytest.raises(DesiredMotionError, match="fundamental motion of q is not real and finite"):
            followed(MOTIONS[name][0], a=a)


def linkage():
    """Return an offset slider-crank with an elastic shaft. The angle of its rod is asin((r sin φ + e)/l)."""
    made = Mechanism("linkage", "Offset slider-crank")
    q = made.coordinate("q", "rad", "twist")
    J, m, k = made.parameters(J=("kg m^2", "J", "> 0"), m=("kg", "slider", "> 0"), k=("N m/rad", "k", "> 0"))
    r, L, e = made.parameters(r=("m", "crank", "> 0"), L=("m", "rod", "> 0"), e=("m", "offset"))
    angle = made.phase + q
    rod = asin((r * sin(angle) + e) / L)
    made.kinetic = (J * rate(angle) ** 2 + m * rate(r * cos(angle) + L * cos(rod)) ** 2) / 2
    made.potential = k * q**2 / 2
    return made


def test_short_rod_is_refused():
    """The loop closes at all phases if r + |e| < l. Otherwise it first opens at φ = π/2."""
    numbers = {"J": 1, "m": 1, "k": 1e3, "r": 0.1, "e": 0.05}
    made = linkage()
    model = solve.load(made, L=0.16, **numbers)
    with pytest.raises(DesiredMotionError, match=r"the kinetic energy .* at phase 1\.5"):
        solve.load(made, L=0.1499, **numbers)
    sweep = solve.sweep(model, [3.0], over={"L": [0.12, 0.1499, 0.1501, 0.2]})
    assert [point.error is None for point in sweep.points] == [False, False, True, True]


@pytest.mark.parametrize("sign", [-1, 1])
def test_loop_that_a_fundamental_motion_opens_is_refused(sign):
    """A loop driven by a coordinate is evaluated along the fundamental motion of that coordinate: x² = c - b
    / sin φ."""

    def state():
        made = Mechanism("opening", "A loop driven by a coordinate")
        q = made.coordinate("q", "m", "drive of the loop")
        m, k, b, c = made.parameters(
            m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), b=("m", "amplitude"), c=("m", "place")
        )
        metre = made.parameter("one", "m", "a length", "> 0")
        (x,) = made.loop(
            {"x": "m"}, [q], lambda given, x: [x**2 / metre - given], lambda given: [2 * metre], iterations=30
        )
        made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * (q - x) ** 2 / 2
        made.fundamental(q=c + b * sin(made.phase))
        return made

    given = {"m": 1, "k": 3, "c": 1.0, "one": 1}
    assert solve.load(state, b=0.8, **given).n == 1
    with pytest.raises(solve.SolveError, match="the loop of x does not close at every phase"):
        solve.load(state, b=sign * 1.2, **given)


def test_polynomials_and_sines_require_no_domain_check():
    made = Mechanism("plain", "A motion that exists everywhere")
    q = made.coordinate("q", "rad", "angle")
    m, k, a = made.parameters(m=("kg m^2", "m", "> 0"), k=("N m/rad", "k", "> 0"), a=("1", "a", "> 0"))
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / (2 * sqrt(a))
    made.fundamental(q=sin(made.phase) ** 3 / a + cos(2 * made.phase) + pi)
    module = module_of(made)
    assert not hasattr(module, "DOMAIN")
    assert not hasattr(module, "domain")


def rotor(angle):
    """Return a rotor with a spring to ground that acts on the sum of a prescribed angle and q."""
    made = Mechanism("rotor", "Rotor on a spring")
    q, phase = made.coordinate("q", "rad", "twist"), made.phase
    k, c = made.parameters(k=("N m/rad", "spring", "> 0"), c=("N m s/rad", "drag", ">= 0"))
    made.kinetic = made.parameter("J", "kg m^2", "rotor", "> 0") * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2
    made.dissipation = c * rate(q) ** 2 / 2
    made.force(k * angle(phase), along=q)
    return solve.load(made, J=1.0, k=4.0, c=0.1)


@pytest.mark.parametrize(
    ("angle", "phase", "change"),
    [
        (lambda phase: atan2(sin(phase - 0.7), 0.5 * cos(phase - 0.7)), 0.7 + math.pi, 4 * 2 * math.pi),
        (lambda phase: atan2(2 * sin(phase + 1), cos(phase + 1)) / 3, math.pi - 1, 4 * 2 * math.pi / 3),
        (lambda phase: atan2(sin(phase), 0.5 + cos(phase)) - phase, math.pi, 4 * 2 * math.pi),
        (lambda phase: atan2(sin(2 * phase) / 4, 0.5 + sin(phase) ** 2 / 2), None, 0.0),
        (lambda phase: tanh(1e6 * sin(phase - 1)), None, 0.0),
        (lambda phase: Heaviside(sin(phase - 1)), None, 0.0),
    ],
    ids=["ellipse", "part", "beside the phase", "continuous", "steep", "a break"],
)
def test_jump_of_an_angle_is_reported_with_its_phase(angle, phase, change):
    made = rotor(angle)
    if phase is None:
        check(made, 3.0)
        return
    with pytest.raises(MatricesError) as raised:
        solve.periodic(made, 3.0)
    assert f"d jumps by {change:.3g} at phase {phase:.6g}, where the model has no break" in str(raised.value)
    with pytest.raises(NoResultError, match="d jumps by"):
        solve.sweep(made, [1.0, 2.0, 3.0]).results.require_any()


@pytest.mark.parametrize("waves", [17, 32, 64, 65, 128, 130])
def test_fast_waves_beyond_the_domain_are_refused(waves):
    """The sine reaches ±1 twice per wave. Some of these phases lie near the sampled phases."""
    made = Mechanism("waves", "Rotor whose fundamental motion has many waves")
    q = made.coordinate("q", "rad", "angle")
    J, k = made.parameters(J=("kg m^2", "rotor", "> 0"), k=("N m/rad", "spring", "> 0"))
    a, shift = made.parameters(a=("1", "amplitude"), shift=("rad", "phase of the waves"))
    made.fundamental(q=asin(a * sin(waves * made.phase + shift)) / 100)
    made.kinetic, made.potential = J * rate(q) ** 2 / 2, k * q**2 / 2
    for angle in (0.0, 0.3, 1 / 3):
        numbers = {"J": 1.0, "k": 4.0, "shift": angle}
        with pytest.raises(DesiredMotionError, match=r"asin\(a\*sin\("):
            solve.floquet(solve.load(made, a=1.001, **numbers), 3.0)
        require_desired_motion(solve.load(made, a=0.99, **numbers), np.array([3.0]))


def test_infinite_stiffness_is_reported_with_its_phase():
    """The energy of the fundamental motion is zero."""
    made = Mechanism("pole", "Mass on a spring that is infinitely stiff once a revolution")
    q = made.coordinate("q", "m", "deflection")
    m, k, e = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), e=("1", "distance"))
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / (1 + e + cos(made.phase)) / 2
    with pytest.raises(DesiredMotionError, match=r"e \+ cos\(phase\) \+ 1 != 0, which is 0 at phase 3\.142"):
        solve.floquet(solve.load(made, m=1.0, k=2.0, e=0.0), 1.0)
    assert solve.floquet(solve.load(made, m=1.0, k=2.0, e=0.5), 1.0).multipliers.shape == (2,)


def test_natural_frequencies_without_motion_at_speed_0_are_refused(hoop):
    """cos q = g/(a Ω²) has no solution at speed 0. If the motion does not depend on the speed, the
    frequencies exist."""
    expected = r"at speed 0, .* motion of q .* acos\(g/\(a\*speed\*\*2\)\) requires .* solve critical"
    with pytest.raises(DesiredMotionError, match=expected):
        solve.frequencies(hoop)
    with pytest.raises(NoResultError, match=expected):
        solve.frequencies_over(hoop, "a", [0.1, 0.3], np.zeros(1))
