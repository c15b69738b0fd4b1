"""Joint forces of the flexible four-bar linkage: agreement with the rigid linkage for stiff links, and
conservation laws with integrals evaluated in the test."""

import numpy as np
import pytest

import solve
from solve.equations import output_values
from solve.errors import UnknownNameError
from tests.models.four_bar.multibody import free_bodies

PHASE = np.array([0.3, 1.9, 3.1, 5.2])
SPEED = 30.0


def bar(density, area, length, tip_mass):
    """Mass, centre of mass X and Y, and moment of inertia J about it, of a uniform bar with a point mass at
    its end."""
    mass = density * area * length
    total = mass + tip_mass
    centre = (mass * length / 2 + tip_mass * length) / total
    J = mass * length**2 / 12 + mass * (centre - length / 2) ** 2 + tip_mass * (length - centre) ** 2
    return total, centre, 0.0, J


def test_joint_forces_of_stiff_links_equal_rigid_bodies():
    stiff = solve.load("four_bar", E=2.1e18)
    orbit = solve.periodic(stiff, SPEED, steps=64)
    outputs = output_values(stiff, PHASE, SPEED, *orbit.quasi_static.state(PHASE))
    p, angles = stiff.parameters, stiff.at_positions(PHASE).angle
    lengths = [p[name] for name in ("L1", "L2", "L3", "L4")]
    bodies = [
        bar(p["rho"], p["A1"], p["L1"], p["mA"]),
        bar(p["rho"], p["A2"], p["L2"], p["mB"]),
        bar(p["rho"], p["A3"], p["L3"], 0.0),
    ]
    for k, phase in enumerate(PHASE):
        rigid = free_bodies(lengths, bodies, (phase, SPEED, 0.0), 0.0, angles[k])
        scale = np.abs(rigid.forces).max()
        for joint, force in zip("OABC", rigid.forces, strict=True):
            ours = [outputs[f"{joint}_force_{axis}"][k] for axis in "xy"]
            np.testing.assert_allclose(ours, force, atol=1e-6 * scale)
        assert outputs["O_moment"][k] == pytest.approx(rigid.torque, abs=1e-6 * scale * p["L1"])


@pytest.mark.parametrize("element", ["cubic", "internal", "curvature"])
@pytest.mark.parametrize("options", [{}, {"terms": "full", "stiffening": "on"}])
def test_joint_and_damping_forces_accelerate_the_joint_mass(element, options):
    model = solve.load("four_bar", options={"element": element, "elements": "1,2,1", **options})
    orbit = solve.periodic(model, SPEED, rtol=1e-7)
    _, qd, qdd = orbit.state(PHASE)
    undamped = model.varied({"zeta": 0.0})
    C = model.at(PHASE, SPEED)[1] - undamped.at(PHASE, SPEED)[1]
    damping = np.einsum("kij,jk->ik", C, qd)
    angle = model.at_positions(PHASE).angle
    p = model.parameters
    places = {"A": p["L1"] * np.exp(1j * angle[:, 0])}
    places["B"] = places["A"] + p["L2"] * np.exp(1j * angle[:, 1])
    for joint, links in (("A", ("crank", "coupler")), ("B", ("coupler", "follower"))):
        forces = [model.joint_force(link, joint, orbit, PHASE) for link in links]
        along, across = sum(np.array(force[:2]) for force in forces)
        row = model.coordinates.index(f"{joint}_x"), model.coordinates.index(f"{joint}_y")
        rigid = -(SPEED**2) * places["A"] if joint == "A" else rigid_acceleration_of_B(model, PHASE)
        acceleration = np.real(rigid) + qdd[row[0]], np.imag(rigid) + qdd[row[1]]
        scale = np.abs([each for force in forces for each in force[:2]]).max()
        for total, axis in ((along, 0), (across, 1)):
            expected = -p[f"m{joint}"] * acceleration[axis] - damping[row[axis]]
            np.testing.assert_allclose(total, expected, atol=1e-6 * scale)
        for moment in (forces[0][2], forces[1][2]):
            turning = [
                damping[i] for i, name in enumerate(model.coordinates) if name.endswith(f"{joint}_turn")
            ]
            assert min(np.abs(moment + each).max() for each in turning) < 1e-6 * scale


def rigid_acceleration_of_B(model, phase):
    """Acceleration of B relative to C, by differences of the follower's angle."""
    h = 1e-4
    place = [
        model.parameters["L3"] * np.exp(1j * model.at_positions(phase + k * h).angle[:, 2])
        for k in (-1, 0, 1)
    ]
    return SPEED**2 * (place[0] - 2 * place[1] + place[2]) / h**2


@pytest.mark.parametrize("link", [0, 1, 2])
@pytest.mark.parametrize("options", [{}, {"terms": "full"}])
def test_end_forces_accelerate_the_link(link, options):
    """Sums of forces and of moments about the start equal the inertia, integrated over the Hermite cubics.
    With the instantaneous terms, accelerations are interpolated along the current axes of the link."""
    model = solve.load("four_bar", options=options)
    orbit = solve.periodic(model, SPEED, steps=128)
    name, start, end = model.module.LINKS[link][:3]
    p, angle = model.parameters, model.at_positions(PHASE).angle[:, link]
    ends = [model.joint_force(name, joint, orbit, PHASE) for joint in (start, end)]
    force = [x + 1j * y for x, y, _ in ends]
    length, mu = p[f"L{link + 1}"], p["rho"] * p[f"A{link + 1}"]
    arm = length * np.exp(1j * angle)
    moment = ends[0][2] + ends[1][2] + np.imag(np.conj(arm) * force[1])
    nodes, weights = np.polynomial.legendre.leggauss(6)
    total, about = 0.0, 0.0
    for xi, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
        acceleration = acceleration_along(model, orbit, link, xi, bool(options))
        total = total + mu * length * weight * acceleration
        about = about + mu * length * weight * np.imag(np.conj(xi * arm) * acceleration)
    scale = np.abs(force).max()
    np.testing.assert_allclose(force[0] + force[1], total, atol=2e-5 * scale)
    np.testing.assert_allclose(moment, about, atol=2e-5 * scale * length)


def acceleration_along(model, computed, link, xi, turning):
    """Acceleration x + iy of the point ξ of a link: that of the rigid link plus that of the deflection."""
    h = 2e-4
    grid = PHASE[:, None] + h * np.array([-1, 0, 1])
    rigid = np.reshape([rigid_place(model, each, link, xi) for each in grid.T], (3, -1))
    if turning:
        w = np.reshape(
            [deflection(model, computed.state(each)[0], each, link, xi) for each in grid.T], (3, -1)
        )
        elastic = SPEED**2 * (w[0] - 2 * w[1] + w[2]) / h**2
    else:
        elastic = deflection(model, computed.state(PHASE)[2], PHASE, link, xi)
    return SPEED**2 * (rigid[0] - 2 * rigid[1] + rigid[2]) / h**2 + elastic


def rigid_place(model, phase, link, xi):
    p, angle = model.parameters, model.at_positions(phase).angle
    start = (0.0, p["L1"] * np.exp(1j * angle[:, 0]), p["L4"])[link]
    return start + xi * p[f"L{link + 1}"] * np.exp(1j * angle[:, link])


def deflection(model, q, phase, link, xi):
    """Displacement x + iy of the point ξ between the ends of a single cubic element."""
    angle, L = model.at_positions(phase).angle[:, link], model.parameters[f"L{link + 1}"]
    row = dict(zip(model.coordinates, q, strict=True))
    ends = (("O", "A"), ("A", "B"), ("C", "B"))[link]
    name = ("crank", "coupler", "follower")[link]
    moved = [row.get(f"{joint}_x", 0.0) + 1j * row.get(f"{joint}_y", 0.0) for joint in ends]
    turned = [row.get(f"{name}_{joint}_turn", 0.0) for joint in ends]
    local = [each * np.exp(-1j * angle) for each in moved]
    u = (1 - xi) * np.real(local[0]) + xi * np.real(local[1])
    v = (1 - 3 * xi**2 + 2 * xi**3) * np.imag(local[0]) + (3 * xi**2 - 2 * xi**3) * np.imag(local[1])
    v = v + L * ((xi - 2 * xi**2 + xi**3) * turned[0] + (xi**3 - xi**2) * turned[1])
    return (u + 1j * v) * np.exp(1j * angle)


def test_drive_power_balances_inertia_and_damping():
    """Power for the rigid motion, per phase: the moment at O equals the integral of the inertia forces of
    links and joint masses, and the damping forces."""
    model = solve.load("four_bar", options={"terms": "full"})
    orbit = solve.periodic(model, SPEED, rtol=1e-7)
    _, qd, _ = orbit.state(PHASE)
    C = model.at(PHASE, SPEED)[1] - model.varied({"zeta": 0.0}).at(PHASE, SPEED)[1]
    power = np.einsum("kij,jk,ik->k", C, qd, rigid_rates(model))
    nodes, weights = np.polynomial.legendre.leggauss(6)
    p = model.parameters
    parts = [
        (link, xi, p["rho"] * p[f"A{link + 1}"] * p[f"L{link + 1}"] * weight)
        for link in range(3)
        for xi, weight in zip((nodes + 1) / 2, weights / 2, strict=True)
    ]
    for link, xi, mass in (*parts, (0, 1.0, p["mA"]), (1, 1.0, p["mB"])):
        velocity = rate_of(lambda phase, link=link, xi=xi: rigid_place(model, phase, link, xi))
        acceleration = acceleration_along(model, orbit, link, xi, turning=True)
        power = power + mass * np.real(np.conj(velocity) * acceleration)
    moment = output_values(model, PHASE, SPEED, *orbit.state(PHASE))["O_moment"]
    np.testing.assert_allclose(moment, power, atol=2e-5 * np.abs(moment).max())


def rate_of(value, h=1e-5):
    return (value(PHASE + h) - value(PHASE - h)) / (2 * h)


def rigid_rates(model):
    """Derivatives with respect to the phase of the coordinates (n, k), for one element per link and the rigid
    motion."""
    turning = rate_of(lambda phase: model.at_positions(phase).angle)
    computed = {}
    for joint, link in (("A", 0), ("B", 1)):
        velocity = rate_of(lambda phase, link=link: rigid_place(model, phase, link, 1.0))
        computed |= {f"{joint}_x": np.real(velocity), f"{joint}_y": np.imag(velocity)}
    for end, link in (
        ("crank_A", 0),
        ("coupler_A", 1),
        ("coupler_B", 1),
        ("follower_B", 2),
        ("follower_C", 2),
    ):
        computed[f"{end}_turn"] = turning[:, link]
    return np.array([computed[name] for name in model.coordinates])


def test_joint_of_other_link_is_rejected():
    model = solve.load("four_bar")
    with pytest.raises(UnknownNameError, match="joint of link coupler"):
        model.joint_force("coupler", "O", solve.periodic(model, SPEED, steps=64), PHASE)
