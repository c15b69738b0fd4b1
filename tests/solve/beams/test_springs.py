"""Springs and dashpots between joints and the ground, compared with closed forms."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq

import solve
from derive import Section, Structure
from derive.checks import check
from derive.errors import DeclarationError, UnitError
from solve.errors import StructureError

BENDS = {"E": 1e6, "A": 1.0, "I": 1e-6, "rho": 1.0, "L": 1.0}
"""EI = 1, EA = 1e6, a mass of 1 kg per m, length 1 m: frequencies in bending are β²."""


@cache
def bar(*held):
    """Return a bar along x from L to R with supports (verb, joint, *directions of springs) of the
    statement."""
    made = Structure("bar", "A bar on supports")
    E, A, I, rho, L, k = made.parameters(  # noqa: E741 - the field's symbol
        E=("Pa", "modulus"), A=("m^2", "area"), I=("m^4", "second moment"), rho=("kg/m^3", "density"),
        L=("m", "length"), k=("N/m", "spring"),
    )  # fmt: skip
    made.link("bar", "L", "R", L, 0, Section(E, A, I, rho))
    for verb, joint, *directions in held:
        units = {"x": 1, "y": 1, "turn": L**2}
        getattr(made, verb)(joint, **{direction: k * units[direction] for direction in directions})
    return made


def roots(function, count=3):
    """Return the lowest zeros of a function that changes sign at each zero."""
    x = np.linspace(1e-3, 12.0, 24001)
    y = function(x)
    starts = np.flatnonzero(y[1:] * y[:-1] < 0)[:count]
    return np.array([brentq(function, x[i], x[i + 1], xtol=1e-14) for i in starts])


def cc(x):
    return np.cos(x) * np.cosh(x)


def sc(x):
    return np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)


CLOSED = [
    ((("clamp", "L"), ("spring", "R", "y")), lambda k, x: x**3 * (1 + cc(x)) + k * sc(x)),
    ((("support", "L"), ("spring", "L", "turn")), lambda k, x: k * (1 + cc(x)) - x * sc(x)),
    (
        (("spring", "L", "x", "y"), ("support", "R")),
        lambda k, x: 2 * k * np.sin(x) * np.sinh(x) - x**3 * sc(x),
    ),
]


@pytest.mark.parametrize("element", ["dynamic", "internal", "curvature", "cubic"])
@pytest.mark.parametrize(("held", "closed"), CLOSED, ids=["support", "clamp", "pivot"])
def test_elastic_supports_match_the_characteristic_equations(held, closed, element):
    """The beams are a cantilever supported by a spring k at its end, a pinned beam with a rotational spring k
    L², and a beam between a pin and an elastic pivot."""
    count, rtol = {"dynamic": (1, 1e-9), "cubic": (48, 1e-5)}.get(element, (6, 1e-6))
    for k in (0.3, 7.0, 500.0):
        model = solve.load(bar(*held), options={"element": element, "elements": count}, k=k, **BENDS)
        computed = solve.frequencies(model, count=3).values[0]
        np.testing.assert_allclose(computed, roots(lambda x, k=k: closed(k, x)) ** 2, rtol=rtol)


@cache
def rotor():
    """Return a stiff arm with a mass at its tip, driven about a pivot on springs and dashpots."""
    made = Structure("rotor", "Unbalance on an elastic pivot")
    E, A, I, rho, L, m = made.parameters(  # noqa: E741 - the field's symbol
        E=("Pa", "modulus"), A=("m^2", "area"), I=("m^4", "second moment"), rho=("kg/m^3", "density"),
        L=("m", "length"), m=("kg", "mass"),
    )  # fmt: skip
    kx, ky, kt = made.parameters(kx=("N/m", "across"), ky=("N/m", "up"), kt=("N m/rad", "drive's shaft"))
    c = made.parameter("c", "N s/m", "dashpots")
    made.link("arm", "O", "tip", L, made.phase, Section(E, A, I, rho))
    made.mass("tip", m)
    made.spring("O", x=kx, y=ky, turn=kt)
    made.dashpot("O", x=c, y=c)
    return made


def test_unbalance_response_matches_the_closed_form():
    """For a rigid arm of mass μL with m at its tip, (μL + m) ẍ + c ẋ + k x = (μL/2 + m) L Ω² cos φ. The
    deflection of the elastic arm is inversely proportional to its stiffness."""
    numbers = {"E": 1e12, "A": 1e-4, "I": 1e-5, "rho": 5e3, "L": 0.5, "m": 0.4}
    springs = {"kx": 900.0, "ky": 2500.0, "kt": 1e9, "c": 8.0}
    speed, mass, unbalance = 40.0, 0.25 + 0.4, (0.125 + 0.4) * 0.5
    orbit = solve.periodic(solve.load(rotor(), **numbers, **springs), speed, rtol=1e-6)
    assert orbit.error_estimate.orbit < 1e-6
    assert orbit.steps < 64
    for name, k, load in (("O_x", 900.0, 1.0), ("O_y", 2500.0, -1j)):
        expected = unbalance * speed**2 * load / (k - mass * speed**2 + 8j * speed)
        amplitudes, phases = orbit.harmonics(name, 1)
        assert amplitudes[1] * np.exp(1j * phases[1]) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("held", "words"),
    [
        ((("support", "L"), ("spring", "L", "y")), ("joint L is supported rigidly and elastically (y)",)),
        ((("clamp", "L"), ("dashpot", "L", "turn")), ("supported rigidly and elastically (turn)",)),
        ((("dashpot", "L", "y"),), ("has no support", "spring(joint, ...)")),
    ],
)
def test_contradictory_supports_are_refused(held, words):
    with pytest.raises(DeclarationError) as caught:
        check(bar(*held))
    assert all(word in str(caught.value) for word in words)


def test_invalid_units_joints_and_places_are_refused():
    made = bar.__wrapped__()
    k = made.declared_parameters[-1].symbol
    with pytest.raises(DeclarationError, match='no link ends at a joint "Q"'):
        made.spring("Q", y=k)
    made.spring("L", turn=k)
    with pytest.raises(UnitError, match=r"spring of joint L \(turn\)"):
        check(made)


def test_joint_on_a_spring_with_prescribed_motion_is_refused():
    made = rotor.__wrapped__()
    made.spring("tip", x=made.declared_parameters[6].symbol)
    numbers = {"E": 1e14, "A": 1e-4, "I": 1e-5, "rho": 5e3, "L": 0.5, "m": 0.4}
    with pytest.raises(StructureError, match="joint tip is supported, but the angles of the links move it"):
        solve.load(made, **numbers, kx=900.0, ky=2500.0, kt=1e9, c=8.0)
