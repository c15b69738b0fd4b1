"""M, C, K and d about nonzero fundamental motions, compared with formulas derived by hand."""

import numpy as np
import pytest
import sympy
from modules import module_of

from derive import Mechanism, cos, rate, sin, sqrt
from derive.equations import gathered, linearise, residuals
from derive.errors import ExpansionError, SingularMassError
from derive.symbols import SPEED, steady


def pendulum_on_an_arm() -> Mechanism:
    """Pendulum at the tip of an arm of length R, which rotates with the drive.

    The coordinate is the angle of the pendulum in space. In the fundamental motion, the pendulum points along
    the arm, so that the angle equals the phase.
    """
    absorber = Mechanism("absorber", "Pendulum on a turning arm")
    (theta,) = absorber.coordinates(theta=("rad", "pendulum's angle in space"))
    m, L, R, g, c = absorber.parameters(
        m=("kg", "bob", "> 0"), L=("m", "pendulum", "> 0"), R=("m", "arm", "> 0"),
        g=("m/s^2", "gravity"), c=("N m s/rad", "hinge"),
    )  # fmt: skip
    x = R * cos(absorber.phase) + L * cos(theta)
    y = R * sin(absorber.phase) + L * sin(theta)
    absorber.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2
    absorber.potential = m * g * y
    absorber.dissipation = c * rate(theta - absorber.phase) ** 2 / 2
    absorber.fundamental(theta=absorber.phase)
    return absorber


def test_pendulum_on_a_rotating_arm():
    """Linearised about the direction of the arm: m l² θ̈ + c θ̇ + (m R L Ω² − m g L sin φ) θ = −m g L cos
    φ."""
    m, L, R, g, c = p = [1.3, 0.4, 0.9, 9.81, 0.02]
    for phase, speed in [(0.3, 4.0), (2.5, 11.0), (5.9, 0.5)]:
        computed = [float(part) for part in module_of(pendulum_on_an_arm()).linearised()(phase, speed, p)]
        stiffness = m * R * L * speed**2 - m * g * L * np.sin(phase)
        assert computed == pytest.approx([m * L**2, c, stiffness, -m * g * L * np.cos(phase)], rel=1e-12)


def crane() -> Mechanism:
    """Pendulum whose pivot moves horizontally by A sin φ. Its fundamental motion is B sin φ."""
    hook = Mechanism("crane", "Pendulum on a moving pivot")
    (theta,) = hook.coordinates(theta=("rad", "angle from the vertical"))
    m, L, g, A, B = hook.parameters(
        m=("kg", "bob", "> 0"), L=("m", "length", "> 0"), g=("m/s^2", "gravity"),
        A=("m", "motion of the pivot"), B=("rad", "desired swing"),
    )  # fmt: skip
    x, y = A * sin(hook.phase) + L * sin(theta), -L * cos(theta)
    hook.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2
    hook.potential = m * g * y
    hook.fundamental(theta=B * sin(hook.phase))
    return hook


def test_pendulum_on_a_moving_pivot():
    """m l² θ̈ + m L ẍ cos θ + m g L sin θ = 0 with ẍ = −A Ω² sin φ, expanded about θ = B sin φ."""
    m, L, g, A, B = p = [0.8, 1.7, 9.81, 0.3, 0.6]
    for phase, speed in [(0.4, 2.0), (1.9, 7.0), (4.4, 0.3)]:
        desired, pivot = B * np.sin(phase), -A * speed**2 * np.sin(phase)
        inertia = -m * L**2 * B * speed**2 * np.sin(phase)
        computed = [float(part) for part in module_of(crane()).linearised()(phase, speed, p)]
        stiffness = m * g * L * np.cos(desired) - m * L * pivot * np.sin(desired)
        moment = m * L * pivot * np.cos(desired) + m * g * L * np.sin(desired)
        assert computed == pytest.approx([m * L**2, 0, stiffness, -inertia - moment], rel=1e-12)


def two_masses() -> tuple[Mechanism, tuple]:
    pair = Mechanism("pair", "Two masses")
    q1, q2 = pair.coordinates(q1=("m", "first"), q2=("m", "second"))
    m, k = pair.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"))
    pair.potential = k * (q1**2 + q2**2) / 2
    return pair, (q1, q2, m)


def test_coordinate_without_kinetic_energy_is_refused():
    pair, (q1, _, m) = two_masses()
    pair.kinetic = m * rate(q1) ** 2 / 2
    with pytest.raises(SingularMassError, match="M is singular: a motion of q2 has no kinetic energy"):
        module_of(pair)


def test_combination_without_kinetic_energy_is_refused():
    pair, (q1, q2, m) = two_masses()
    pair.kinetic = m * rate(q1 + q2) ** 2 / 2
    with pytest.raises(SingularMassError, match="a motion of q1 and q2 has no kinetic energy"):
        module_of(pair)


def test_force_without_a_tangent_is_refused():
    pair, (q1, q2, m) = two_masses()
    (length,) = pair.parameters(length=("m", "length", "> 0"))
    pair.kinetic = m * (rate(q1) ** 2 + rate(q2) ** 2) / 2
    pair.force(-m * pair.speed**2 * sqrt(q2 * length), along=q2)
    with pytest.raises(ExpansionError, match="equation of q2 cannot be linearised: K is not finite"):
        module_of(pair)


def test_cancelling_terms_are_removed():
    a, b = sympy.symbols("a b", real=True)
    assert gathered((a + b) * SPEED - a * SPEED) == b * SPEED
    assert gathered(a * SPEED + b * SPEED) == (a + b) * SPEED


def test_forces_of_equally_spaced_blades_cancel():
    """Σ cos(φ + 2πk/3) = 0 exactly."""
    rotor = Mechanism("rotor", "Three blades on a hub that gives")
    x = rotor.coordinate("x", "m", "hub")
    m, r = rotor.parameters(m=("kg", "mass of a blade", "> 0"), r=("m", "radius", "> 0"))
    for k in range(3):
        root = rotor.phase + 2 * sympy.pi * k / 3
        rotor.kinetic += m * (rate(x + r * cos(root)) ** 2 + rate(r * sin(root)) ** 2) / 2
    assert linearise(rotor, steady(residuals(rotor))).d == sympy.zeros(1, 1)
