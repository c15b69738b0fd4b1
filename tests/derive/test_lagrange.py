"""Equations of motion compared with textbook forms."""

import numpy as np
import pytest
import sympy
from modules import module_of, values

import derive
from derive import Mechanism, cos, rate, sin
from derive.equations import drive_torque, residuals
from derive.symbols import ACCELERATION, PHASE, SPEED, Moving, steady


def pendulum() -> Mechanism:
    swing = Mechanism("pendulum", "Plane pendulum")
    (theta,) = swing.coordinates(theta=("rad", "angle from the vertical"))
    m, L, c, g = swing.parameters(
        m=("kg", "bob", "> 0"), L=("m", "length", "> 0"), c=("N m s/rad", "pivot"), g=("m/s^2", "gravity")
    )
    swing.kinetic = m * L**2 * rate(theta) ** 2 / 2
    swing.potential = -m * g * L * cos(theta)
    swing.dissipation = c * rate(theta) ** 2 / 2
    return swing


def torque(mechanism: Mechanism) -> sympy.Expr:
    return drive_torque(mechanism, residuals(mechanism))


def symbols(names: str) -> list[sympy.Symbol]:
    return [sympy.Symbol(name, real=True) for name in names.split()]


def test_equation_of_a_pendulum_matches_the_textbook():
    m, L, c, g = symbols("m L c g")
    theta, thetad, thetadd = (Moving("theta" + order) for order in ("", "d", "dd"))
    textbook = m * L**2 * thetadd + c * thetad + m * g * L * sympy.sin(theta)
    assert sympy.simplify(residuals(pendulum())[0] - textbook) == 0
    assert torque(pendulum()) == 0


def test_rate_includes_phase_coordinates_and_their_rates():
    q, qd, qdd = (Moving("q" + order) for order in ("", "d", "dd"))
    assert rate(q**2 * sympy.sin(2 * PHASE)) == 2 * q * qd * sympy.sin(
        2 * PHASE
    ) + 2 * SPEED * q**2 * sympy.cos(2 * PHASE)
    assert sympy.expand(rate(rate(q * SPEED))) == SPEED * qdd + 2 * ACCELERATION * qd
    assert steady(rate(SPEED)) == 0
    assert rate(3) == 0


def bead() -> Mechanism:
    """Bead on a straight wire that rotates about its end with the drive. A spring k acts towards the axis;
    there is no gravity."""
    wire = Mechanism("bead", "Bead on a turning wire")
    (r,) = wire.coordinates(r=("m", "distance from the axis"))
    m, k, J, P = wire.parameters(
        m=("kg", "bead", "> 0"), k=("N/m", "spring"), J=("kg m^2", "wire"), P=("N", "force across the wire")
    )
    x, y = r * cos(wire.phase), r * sin(wire.phase)
    wire.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2 + J * rate(wire.phase) ** 2 / 2
    wire.potential = k * r**2 / 2
    wire.force(-P * sin(wire.phase), along=x)
    wire.force(P * cos(wire.phase), along=y)
    return wire


def test_equation_and_torque_of_a_bead_on_a_rotating_wire():
    """The equation is m r̈ − m Ω² r + k r = 0. The drive torque balances the Coriolis force, the transverse
    force and the inertia about the axis: 2 m r ṙ Ω − P r + (J + m r²) Ω̇."""
    m, k, P, J = symbols("m k P J")
    r, rd, rdd = (Moving("r" + order) for order in ("", "d", "dd"))
    assert sympy.simplify(residuals(bead())[0] - (m * rdd - m * SPEED**2 * r + k * r)) == 0
    expected = 2 * m * r * rd * SPEED - P * r + (J + m * r**2) * ACCELERATION
    assert sympy.simplify(torque(bead()) - expected) == 0


def test_torque_in_a_shaft_is_the_drive_torque():
    """Chapter Eq. (51): for a rotor on an elastic shaft, the drive torque equals the torque in the shaft."""
    rotor = Mechanism("rotor", "Rotor on an elastic shaft")
    (q,) = rotor.coordinates(q=("rad", "twist"))
    J, k, c, m, e, g = rotor.parameters(
        J=("kg m^2", "rotor", "> 0"), k=("N m/rad", "shaft"), c=("N m s/rad", "shaft"),
        m=("kg", "unbalance"), e=("m", "its arm"), g=("m/s^2", "gravity"),
    )  # fmt: skip
    rotor.kinetic = (J + m * e**2) * rate(rotor.phase + q) ** 2 / 2
    rotor.potential = k * q**2 / 2 + m * g * e * sin(rotor.phase + q)
    rotor.dissipation = c * rate(q) ** 2 / 2
    assert sympy.expand(torque(rotor) + k * q + c * rate(q)) == 0


def test_fundamental_motion_is_substituted_before_differentiation():
    """A pendulum with θ = A sin φ + θ′ satisfies the equation of the pendulum for θ."""
    plain, moved = pendulum(), pendulum()
    theta = Moving("theta")
    (A,) = moved.parameters(A=("rad", "desired amplitude"))
    moved.fundamental(theta=A * sin(moved.phase))
    moved.output("angle", theta, "rad", "angle from the vertical")
    moved.output("rate", rate(theta), "rad/s", "its rate")
    moved.output("acceleration", rate(rate(theta)), "rad/s^2", "its acceleration")
    p, A = [2.0, 0.7, 0.3, 9.81], 0.4
    phase, speed, deviation, rate_, acceleration = 1.1, 5.0, 0.2, -0.3, 0.9
    total = [
        A * np.sin(phase) + deviation,
        A * speed * np.cos(phase) + rate_,
        -A * speed**2 * np.sin(phase) + acceleration,
    ]
    expected = p[0] * p[1] ** 2 * total[2] + p[2] * total[1] + p[0] * p[3] * p[1] * np.sin(total[0])
    module = module_of(moved)
    state = (phase, speed, deviation, rate_, acceleration)
    assert values(module.residual(), *state, [*p, A])[0] == pytest.approx(expected, rel=1e-13)
    computed = [value.item() for value in values(module.outputs(), *state, [*p, A])[1:]]
    assert computed == pytest.approx(total, rel=1e-14)
    varying = values(module.outputs_varying(), *state[:2], 0.0, *state[2:], [*p, A])[1:]
    assert [value.item() for value in varying] == computed
    assert values(module_of(plain).residual(), phase, speed, *total, p)[0] == pytest.approx(
        expected, rel=1e-13
    )


@pytest.mark.parametrize(
    ("name", "slope"),
    [
        ("acos", -1 / np.sqrt(1 - 0.3**2)),
        ("asin", 1 / np.sqrt(1 - 0.3**2)),
        ("asinh", 1 / np.sqrt(1 + 0.3**2)),
        ("atan", 1 / (1 + 0.3**2)),
        ("atanh", 1 / (1 - 0.3**2)),
        ("cosh", np.sinh(0.3)),
        ("log", 1 / 0.3),
        ("sinh", np.cosh(0.3)),
    ],
)
def test_elementary_functions_have_correct_derivatives(name, slope):
    q, qd = Moving("q"), Moving("qd")
    assert float(rate(getattr(derive, name)(q)).subs({q: 0.3, qd: 1})) == pytest.approx(slope, rel=1e-12)
