"""Joint forces and drive torque compared with three free bodies, Newton's laws, work and energy."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.four_bar.forces import Body, bodies, inertial_power, joint_forces, kinetic_energy
from models.four_bar.linkage import BRANCHES, Linkage
from solve import case_numbers
from tests.models.four_bar.cranks import cranks
from tests.models.four_bar.multibody import free_bodies

PARAMETERS = case_numbers("four_bar").parameters
SPEEDS = (30.0, 62.0, 300 * math.pi / 30)
POINTS = 720
OFF = np.array([0.0, 0.003, -0.003])
"""Offset of the initial guess of the reference."""

TURN = np.arange(POINTS) * (2 * math.pi / POINTS)


def thesis(branch: str = "open") -> Linkage:
    return Linkage(*(PARAMETERS[name] for name in ("L1", "L2", "L3", "L4")), branch)


def solids() -> st.SearchStrategy[Body]:
    return st.builds(
        Body,
        st.floats(0.05, 5.0),
        st.builds(complex, st.floats(-0.5, 1), st.floats(-0.5, 0.5)),
        st.floats(1e-3, 1),
    )


@given(
    cranks(),
    st.tuples(solids(), solids(), solids()),
    st.floats(-9, 9),
    st.floats(-50, 50),
    st.floats(-500, 500),
    st.floats(-100, 100),
)
def test_forces_and_torque_equal_the_multipliers_of_three_free_bodies(
    linkage, links, t1, omega1, alpha1, load
):
    motion = linkage.motion(t1, omega1, alpha1)
    ours = joint_forces(motion, links, load)
    data = [(link.mass, link.centre.real, link.centre.imag, link.J) for link in links]
    bodies = free_bodies(linkage.lengths, data, (t1, omega1, alpha1), load, motion.t + OFF)
    scale = max(np.abs(bodies.forces).max(), abs(bodies.torque), 1.0)
    for force, expected in zip((ours.F01, ours.F12, ours.F23, ours.F03), bodies.forces, strict=True):
        np.testing.assert_allclose(force, complex(*expected), atol=1e-10 * scale)
    assert ours.torque == pytest.approx(bodies.torque, abs=1e-10 * scale)


@given(cranks(), st.floats(-9, 9), st.floats(-50, 50), st.floats(-500, 500))
def test_newtons_laws_hold_for_each_bar(linkage, t1, omega1, alpha1):
    """Forces, and moments about the centres of mass, as in section 3.7 of the thesis."""
    masses = (1.0, 0.7, 1.3)
    links = [Body.bar(mass, length) for mass, length in zip(masses, linkage.lengths, strict=False)]
    motion = linkage.motion(t1, omega1, alpha1)
    computed = joint_forces(motion, links)
    at_first = (computed.F01, computed.F12, computed.F03)
    at_second = (-computed.F12, -computed.F23, computed.F23)
    drives = (computed.torque, 0.0, 0.0)
    scale = np.abs([*at_first, *at_second]).max() + 1.0
    for k, (first, second, drive) in enumerate(zip(at_first, at_second, drives, strict=True)):
        t, length = motion.t[k], linkage.lengths[k]
        sum_of_forces = masses[k] * motion.acceleration(k + 1, length / 2)
        assert first + second == pytest.approx(sum_of_forces, abs=1e-12 * scale)
        arm = length / 2
        moment = drive + arm * (first.real - second.real) * math.sin(t)
        moment += arm * (second.imag - first.imag) * math.cos(t)
        J = masses[k] * length**2 / 12
        assert moment == pytest.approx(J * motion.alpha[k], abs=1e-12 * scale)


@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("speed", SPEEDS)
def test_work_of_the_torque_equals_the_change_of_kinetic_energy(speed, branch):
    """Up to each crank angle, the work equals the gain of kinetic energy; over a revolution, it is zero."""
    links, linkage = bodies(PARAMETERS), thesis(branch)
    motion = linkage.motion(TURN, speed)
    torque = joint_forces(motion, links).torque
    energy = kinetic_energy(motion, links)
    assert abs(torque.mean()) < 1e-12 * np.abs(torque).max()
    orders = np.arange(1, POINTS // 2 + 1)
    work = np.fft.irfft(np.append(0.0, np.fft.rfft(torque)[1:] / (1j * orders)), POINTS)
    np.testing.assert_allclose(work - work[0], energy - energy[0], atol=1e-12 * np.ptp(energy))


@given(cranks(), st.floats(0.1, 100.0), st.floats(-500, 500), st.floats(-50, 50))
def test_power_balance(linkage, omega1, alpha1, load):
    """Principle of virtual work: the power of drive and load equals that of the inertia forces."""
    links = [Body.bar(mass, length) for mass, length in zip((1.0, 0.7, 1.3), linkage.lengths, strict=False)]
    motion = linkage.motion(TURN, omega1, alpha1)
    supplied = joint_forces(motion, links, load).torque * omega1
    delivered = load * motion.omega[2]
    inertia = inertial_power(motion, links)
    scale = np.abs(inertia).max() + np.abs(delivered).max()
    np.testing.assert_allclose(supplied, inertia + delivered, atol=1e-12 * scale)


@given(cranks(), st.floats(0.1, 100.0))
def test_inertial_power_is_the_rate_of_the_kinetic_energy(linkage, omega1):
    links = [Body.bar(mass, length) for mass, length in zip((1.0, 0.7, 1.3), linkage.lengths, strict=False)]
    step = 1e-3
    energies = [kinetic_energy(linkage.motion(TURN + k * step, omega1), links) for k in (-2, -1, 1, 2)]
    rate = (energies[0] - 8 * energies[1] + 8 * energies[2] - energies[3]) / (12 * step) * omega1
    power = inertial_power(linkage.motion(TURN, omega1), links)
    np.testing.assert_allclose(power, rate, atol=1e-5 * np.abs(power).max())


def test_torque_against_a_load_is_the_mechanical_advantage():
    """Without inertia, T3/T1 = ω1/ω3. The torque due to the load is added to that due to inertia."""
    links, linkage = bodies(PARAMETERS), thesis()
    motion = linkage.motion(TURN, 30.0)
    part = joint_forces(motion, links, 5.0).torque - joint_forces(motion, links).torque
    np.testing.assert_allclose(part, 5.0 / linkage.mechanical_advantage(TURN), atol=1e-12)


def test_forces_grow_with_the_square_of_the_speed():
    links, linkage = bodies(PARAMETERS), thesis()
    slow, fast = (joint_forces(linkage.motion(TURN, speed), links) for speed in (30.0, 90.0))
    for name in ("F01", "F12", "F23", "F03", "torque"):
        values = getattr(slow, name)
        np.testing.assert_allclose(getattr(fast, name), 9 * values, atol=1e-11 * np.abs(values).max())


def test_joint_masses_are_attached_to_crank_and_follower():
    crank, coupler, follower = bodies(PARAMETERS)
    bar = 7850 * 157.5e-6 * 0.170
    assert crank.mass == pytest.approx(bar + 0.174)
    # Moments about the pivot O: bar and point mass add.
    assert crank.centre * crank.mass == pytest.approx(bar * 0.085 + 0.174 * 0.170)
    about_pivot = crank.J + crank.mass * abs(crank.centre) ** 2
    assert about_pivot == pytest.approx(bar * 0.170**2 / 3 + 0.174 * 0.170**2)
    assert coupler.mass == pytest.approx(7850 * 85.5e-6 * 0.328)
    assert coupler.centre == pytest.approx(0.164)
    np.testing.assert_allclose(coupler.J, coupler.mass * 0.328**2 / 12)
    rod = 7850 * 78.75e-6 * 0.525
    assert follower.mass == pytest.approx(rod + 0.174)
    about_pivot = follower.J + follower.mass * abs(follower.centre) ** 2
    assert about_pivot == pytest.approx(rod * 0.525**2 / 3 + 0.174 * 0.525**2)


@given(solids(), st.floats(0.01, 3), st.builds(complex, st.floats(-1, 1), st.floats(-1, 1)))
def test_point_mass_adds_to_mass_and_moments(body, mass, point):
    both = body.with_mass(mass, point)
    assert both.mass == pytest.approx(body.mass + mass)
    assert both.mass * both.centre == pytest.approx(body.mass * body.centre + mass * point, abs=1e-12)
    about_origin = [x.J + x.mass * abs(x.centre) ** 2 for x in (body, both)]
    assert about_origin[1] == pytest.approx(about_origin[0] + mass * abs(point) ** 2)
