"""Closed loops compared with complex numbers, spectral derivatives, and CasADi's root finder."""

from functools import cache

import casadi
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from modules import module_of

from derive import Mechanism, cos, rate, sin, sqrt
from derive.checks import check
from derive.errors import DeclarationError, UnitError, UnknownSymbolError

COUNT = 256
PHASES = 2 * np.pi * np.arange(COUNT) / COUNT
HARMONIC = np.fft.fftfreq(COUNT, 1 / COUNT)
SIDES = {"open": 1, "crossed": -1}
CRANK_ROCKER = [1.0, 0.25, 0.8, 0.7, 0.3]
DOUBLE_CRANK = [0.2, 0.5, 0.45, 0.6, -0.4]
DOUBLE_ROCKER_NEARLY = [1.0, 0.3, 0.65, 0.85, 1.1]
LINKAGES = [CRANK_ROCKER, DOUBLE_CRANK, DOUBLE_ROCKER_NEARLY]


def four_bar(newton: bool = False) -> Mechanism:
    """Disc on the shaft of the follower. The outputs are the angles of the linkage and three derivatives of
    each."""
    linkage = Mechanism("linkage", "Four-bar linkage")
    (q,) = linkage.coordinates(q=("rad", "twist of the crank's shaft"))
    a, b, c, d, tilt = linkage.parameters(
        a=("m", "ground line", "> 0"), b=("m", "crank", "> 0"), c=("m", "coupler", "> 0"),
        d=("m", "follower", "> 0"), tilt=("rad", "inclination of the ground line"),
    )  # fmt: skip
    J, k = linkage.parameters(J=("kg m^2", "follower", "> 0"), k=("N m/rad", "shaft", "> 0"))
    branch = linkage.option("branch", ("open", "crossed"))
    angle, side = linkage.phase + q, branch.choose(**SIDES)
    if newton:
        phi3, phi4 = linkage.loop(
            {"phi3": "rad", "phi4": "rad"},
            driven_by=(angle,),
            closure=lambda x, phi3, phi4: (
                b * cos(x) + c * cos(phi3) - a * cos(tilt) - d * cos(phi4),
                b * sin(x) + c * sin(phi3) - a * sin(tilt) - d * sin(phi4),
            ),
            start=lambda x: (tilt + side * 1.1, tilt + side * 2.0),
        )
    else:
        phi3, phi4 = linkage.four_bar(
            "phi3", "phi4", ground=a, crank=b, coupler=c, follower=d, tilt=tilt, angle=angle, side=side
        )
    linkage.kinetic = J * rate(phi4) ** 2 / 2
    linkage.potential = k * q**2 / 2
    for name, expression in (("coupler_angle", phi3), ("follower_angle", phi4)):
        for order in range(4):
            derivative = expression.diff(linkage.phase, order)
            linkage.output(f"{name}_{order}", derivative, "rad", f"derivative {order} by the crank's angle")
    return linkage


@cache
def in_closed_form():
    return module_of(four_bar())


@cache
def by_newton():
    return module_of(four_bar(newton=True))


def angles(module, lengths, branch="open"):
    """Array (8, COUNT) at PHASES: φ3 and its three derivatives, then φ4 and its three derivatives."""
    at_rest = np.zeros(1)
    p = np.array([*lengths, 1.0, 1.0])
    values = module.outputs(branch=branch)(PHASES[None], 1.0, at_rest, at_rest, at_rest, p)
    return np.array([np.array(value)[0] for value in values[1:]])


def spectral_derivatives(angle, orders=3):
    """Derivatives of exp(i angle) by FFT. This function is periodic even if the angle makes full turns."""
    spectrum = np.fft.fft(np.exp(1j * angle))
    return [np.fft.ifft((1j * HARMONIC) ** order * spectrum) for order in range(1, orders + 1)]


@st.composite
def turning_linkages(draw):
    """Lengths with which the crank can turn fully, with a margin of 0.05 m in both inequalities."""
    short, longer = draw(st.floats(0.1, 1.0)), draw(st.floats(0.1, 1.0))
    a, b = draw(st.permutations([short, short + longer]))
    together = a + b + 0.05 + draw(st.floats(0, 2.0))
    difference = (abs(a - b) - 0.05) * draw(st.floats(-1, 1))
    return [a, b, (together + difference) / 2, (together - difference) / 2, draw(st.floats(-3.0, 3.0))]


@pytest.mark.parametrize("branch", SIDES)
@settings(max_examples=100, deadline=None)
@given(lengths=turning_linkages())
def test_loop_closes_on_the_selected_side(lengths, branch):
    a, b, c, d, tilt = lengths
    values = angles(in_closed_form(), lengths, branch)
    pin, pivot = b * np.exp(1j * PHASES), a * np.exp(1j * tilt)
    joint = pin + c * np.exp(1j * values[0])
    assert abs(joint - pivot - d * np.exp(1j * values[4])).max() < 1e-13
    left_of_diagonal = np.imag((joint - pin) / (pivot - pin))
    assert (SIDES[branch] * left_of_diagonal > 0).all()


@pytest.mark.parametrize("lengths", LINKAGES)
@pytest.mark.parametrize("branch", SIDES)
def test_three_derivatives_match_spectral_derivatives(lengths, branch):
    values = angles(in_closed_form(), lengths, branch)
    for angle, first, second, third in (values[:4], values[4:]):
        unit = np.exp(1j * angle)
        derivatives = [
            1j * first * unit,
            (1j * second - first**2) * unit,
            (1j * third - 3 * first * second - 1j * first**3) * unit,
        ]
        for given_, spectral in zip(derivatives, spectral_derivatives(angle), strict=True):
            assert abs(given_ - spectral).max() < 1e-8 * abs(spectral).max()


@pytest.mark.parametrize("branch", SIDES)
def test_newtons_method_agrees_with_the_closed_form(branch):
    np.testing.assert_allclose(
        angles(by_newton(), CRANK_ROCKER, branch),
        angles(in_closed_form(), CRANK_ROCKER, branch),
        rtol=0,
        atol=1e-11,
    )


def test_loop_agrees_with_the_root_finder_of_casadi():
    a, b, c, d, tilt = CRANK_ROCKER
    x, z = casadi.SX.sym("x"), casadi.SX.sym("z", 2)
    gap = casadi.vertcat(
        b * casadi.cos(x) + c * casadi.cos(z[0]) - a * np.cos(tilt) - d * casadi.cos(z[1]),
        b * casadi.sin(x) + c * casadi.sin(z[0]) - a * np.sin(tilt) - d * casadi.sin(z[1]),
    )
    finder = casadi.rootfinder("finder", "newton", casadi.Function("gap", [z, x], [gap]))
    computed = np.hstack([np.array(finder([tilt + 1.1, tilt + 2.0], phase)) for phase in PHASES])
    np.testing.assert_allclose(angles(by_newton(), CRANK_ROCKER)[[0, 4]], computed, rtol=0, atol=1e-9)


@pytest.mark.parametrize("branch", SIDES)
def test_linkage_with_an_elastic_shaft_is_linearised_through_the_loop(branch):
    """φ4 depends on the phase plus the twist of the shaft. M, C, K and d are compared with derivatives of the
    residual."""
    module, p = in_closed_form(), np.array([*CRANK_ROCKER, 2.0, 300.0])
    residual = module.residual(branch=branch)
    phase, speed, q, qd, qdd = (casadi.SX.sym(name) for name in ("phase", "speed", "q", "qd", "qdd"))
    r = residual(phase, speed, q, qd, qdd, p)
    rows = [*(casadi.jacobian(r, x) for x in (qdd, qd, q)), -r]
    rest = casadi.substitute(rows, [q, qd, qdd], [casadi.DM(0)] * 3)
    differentiated = casadi.Function("differentiated", [phase, speed], rest)
    for first, second in zip(
        module.linearised(branch=branch)(PHASES[None], 7.0, p), differentiated(PHASES[None], 7.0), strict=True
    ):
        first, second = np.array(first), np.array(second)
        assert abs(first - second).max() < 1e-12 * abs(second).max()


def test_slider_crank_loop_matches_the_closed_form():
    """Position of the slider: s = r cos φ + sqrt(L² − (e − r sin φ)²)."""
    press = Mechanism("press", "Slider-crank")
    (q,) = press.coordinates(q=("m", "spring on the slider"))
    r, L, e, m, k = press.parameters(
        r=("m", "crank", "> 0"), L=("m", "rod", "> 0"), e=("m", "offset"),
        m=("kg", "slider", "> 0"), k=("N/m", "spring", "> 0"),
    )  # fmt: skip
    s, _ = press.loop(
        {"s": "m", "beta": "rad"},
        driven_by=(press.phase,),
        closure=lambda x, s, beta: (r * cos(x) + L * cos(beta) - s, r * sin(x) + L * sin(beta) - e),
        start=lambda x: (r * cos(x) + L, 0),
    )
    press.kinetic = m * rate(s + q) ** 2 / 2
    press.potential = k * q**2 / 2
    written_out = r * cos(press.phase) + sqrt(L**2 - (e - r * sin(press.phase)) ** 2)
    press.output("computed", rate(rate(s)), "m/s^2", "by Newton's method")
    press.output("known", rate(rate(written_out)), "m/s^2", "in closed form")
    module, zero = module_of(press), np.zeros(1)
    _, computed, known = module.outputs()(PHASES[None], 20.0, zero, zero, zero, [0.1, 0.3, 0.03, 1.0, 1.0])
    np.testing.assert_allclose(np.array(computed), np.array(known), rtol=0, atol=1e-11)


@pytest.mark.parametrize("drive", ["linkage", "loop", "series", "series of a loop"])
def test_loop_driven_by_other_motions_matches_the_closed_form(drive):
    """The rocker of a six-bar linkage pushes a slider: s = r cos φ4 + sqrt(L² − (e − r sin φ4)²), behind an
    elastic shaft. In other cases, another loop or a series replaces the rocker."""
    press = Mechanism("press", "Six-bar")
    (q,) = press.coordinates(q=("rad", "twist of the crank's shaft"))
    r, L, e, J, k = press.parameters(
        r=("m", "arm", "> 0"), L=("m", "rod", "> 0"), e=("m", "offset"),
        J=("kg m^2", "crank", "> 0"), k=("N m/rad", "shaft", "> 0"),
    )  # fmt: skip
    angle, numbers = press.phase + q, [0.1, 0.3, 0.03, 1.0, 1.0]
    if drive == "linkage":
        _, psi = press.four_bar(
            "phi3", "phi4", ground=20, crank=5, coupler=16, follower=14, tilt=0, angle=angle, side=1
        )
    elif drive == "series":
        psi = press.series("U", 2, "rad", "oscillating arm")(angle)
    else:
        (psi,) = press.loop(
            {"psi": "rad"}, (angle,), lambda x, z: (z + sin(z) / 4 - sin(x),), lambda x: (sin(x) / 2,)
        )
        if drive == "series of a loop":
            psi = press.series("U", 2, "rad", "oscillating arm")(psi)
    numbers += [0.4, 0.3, 0.2, 0.1, 0.2] if "series" in drive else []
    s, _ = press.loop(
        {"s": "m", "beta": "rad"},
        driven_by=(psi,),
        closure=lambda x, s, beta: (r * cos(x) + L * cos(beta) - s, r * sin(x) + L * sin(beta) - e),
        start=lambda x: (r * cos(x) + L, 0),
    )
    press.kinetic = J * rate(angle) ** 2 / 2
    press.potential = k * q**2 / 2
    written_out = r * cos(psi) + sqrt(L**2 - (e - r * sin(psi)) ** 2)
    press.output("computed", rate(rate(s)), "m/s^2", "by Newton's method")
    press.output("known", rate(rate(written_out)), "m/s^2", "in closed form")
    module = module_of(press)
    assert len(module.PARAMETERS) == len(numbers)
    _, computed, known = module.outputs()(PHASES[None], 20.0, 0.3, -5.0, 70.0, numbers)
    assert np.abs(np.array(known)).max() > 1.0
    np.testing.assert_allclose(np.array(computed), np.array(known), rtol=0, atol=1e-10)


def margins(module, lengths, **options):
    count = len(module.PARAMETERS) - len(lengths)
    return np.array(module.conditions(**options)(PHASES[None], [*lengths, *[1.0] * count]))


@pytest.mark.parametrize(
    ("lengths", "turns"),
    [
        (CRANK_ROCKER, [True, True]),
        ([1.0, 0.9, 0.8, 0.8, 0.0], [False, True]),
        ([1.0, 0.8, 1.5, 0.6, 0.0], [True, False]),
        ([1.0, 1.0, 1.0, 1.0, 0.0], [False, False]),
    ],
)
def test_conditions_hold_if_the_crank_turns_fully(lengths, turns):
    expected = [
        ("a + b < c + d", "the crank cannot turn fully", ("a", "b", "c", "d")),
        ("|a - b| > |c - d|", "the crank cannot turn fully", ("a", "b", "c", "d")),
    ]
    assert list(in_closed_form().CONDITIONS) == expected
    assert [bool(holds) for holds in (margins(in_closed_form(), lengths) > 0).all(axis=1)] == turns


def test_condition_of_a_loop_fails_where_it_cannot_close():
    """Newton's method leaves a gap only at those phases at which the loop cannot be closed."""
    (text, meaning, names), second = by_newton().CONDITIONS
    assert (text, meaning) == (
        "gap of phi3, phi4 < 1e-9",
        "the loop of phi3, phi4 does not close at every phase",
    )
    assert names == second[2] == ("a", "b", "c", "d", "tilt")
    assert (margins(by_newton(), CRANK_ROCKER) > 0).all()
    locked = [1.0, 0.9, 0.8, 0.8, 0.0]
    closed = (margins(by_newton(), locked) > 0).all(axis=0)
    reachable = abs(locked[0] - locked[1] * np.exp(1j * PHASES)) < locked[2] + locked[3]
    assert not closed[~reachable].any()
    assert 0 < reachable.sum() < COUNT


def test_linkage_with_impossible_numbers_is_refused_at_once():
    linkage = Mechanism("linkage", "Four-bar linkage")
    with pytest.raises(DeclarationError, match="the crank cannot turn fully"):
        linkage.four_bar("phi3", "phi4", ground=1, crank=2, coupler=1, follower=1)


def test_condition_must_be_inequality():
    one = Mechanism("one", "One mass")
    m, k = one.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"))
    with pytest.raises(DeclarationError, match="give an inequality with < or >"):
        one.require(m, "too light")
    one.coordinates(q=("m", "displacement"))
    one.require(m < k, "too light")
    one.decline_drive_torque("nothing turns")
    with pytest.raises(UnitError, match="condition m < k"):
        check(one)


def loop_of(closure, start=lambda x: (0, 0), driven_by=None):
    one = Mechanism("one", "One mass")
    (q,) = one.coordinates(q=("m", "displacement"))
    r, m = one.parameters(r=("m", "crank"), m=("kg", "mass", "> 0"))
    s, _ = one.loop(
        {"s": "m", "beta": "rad"},
        (one.phase,) if driven_by is None else driven_by,
        lambda *given: closure(r, *given),
        start,
    )
    one.kinetic = m * rate(s + q) ** 2 / 2
    return one


@pytest.mark.parametrize(
    "wrong",
    [
        {"closure": lambda r, x, s, beta: (s - r * cos(beta),)},
        {"closure": lambda r, x, s, beta: (s, beta), "start": lambda x: (0,)},
        {"closure": lambda r, s, beta: (s, beta), "start": lambda: (0, 0), "driven_by": ()},
    ],
)
def test_loop_requires_an_equation_and_a_guess_per_unknown(wrong):
    with pytest.raises(DeclarationError, match="give one equation and one guess per unknown"):
        loop_of(**wrong)


def test_wrong_units_in_a_loop_are_refused():
    with pytest.raises(UnitError, match="loop of s, beta"):
        check(loop_of(lambda r, x, s, beta: (s - r * cos(x), beta - r)))


def test_undeclared_symbol_in_a_loop_is_refused():
    stray = sympy.Symbol("stray", real=True)
    with pytest.raises(UnknownSymbolError, match="loop of s, beta contains stray"):
        check(loop_of(lambda r, x, s, beta: (s - r * cos(x), beta - stray)))


def test_parameter_cannot_reuse_the_name_of_an_unknown():
    one = loop_of(lambda r, x, s, beta: (s - r * cos(x), beta - x))
    with pytest.raises(DeclarationError, match='"beta" is declared twice'):
        one.parameters(beta=("rad", "angle"))
