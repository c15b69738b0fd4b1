"""Rotor of finite elements: Timoshenko shaft, two discs, and two bearings with different stiffness in two
directions."""

import numpy as np

import solve
from tests.foreign.wall import Case, Source

ROSS = Source(
    "R. Timbó and others",
    "ROSS - Rotordynamic Open Source Software, Journal of Open Source Software 5(48), 2120",
    "2020",
    "petrobras/ross, ross/tests/test_rotor_assembly.py",
)
E, G, RHO = 211e9, 81.2e9, 7810.0
DIAMETER, LENGTH, ELEMENTS = 0.05, 1.5, 6
DISCS = {2: 0.28, 4: 0.35}
"""Outer diameters (m) by node; 0.07 m wide, on the shaft."""


def element(length):
    """Masses, rotary inertias and stiffness (4, 4) of deflection and slope at both ends, by Gauss's
    quadrature of the shapes that solve the static equations; Cowper's shear coefficient."""
    area, inertia = np.pi * DIAMETER**2 / 4, np.pi * DIAMETER**4 / 64
    nu = E / (2 * G) - 1
    shear = 6 * (1 + nu) / (7 + 6 * nu) * G * area
    phi = 12 * E * inertia / (shear * length**2)
    x, weight = np.polynomial.legendre.leggauss(6)
    x, weight = (x + 1) / 2, length * weight / 2
    bump, side = phi * (x - x**2) / 2, 6 * (x - x**2) / length
    deflection = np.array([
        1 - 3 * x**2 + 2 * x**3 + phi * (1 - x), length * (x - 2 * x**2 + x**3 + bump),
        3 * x**2 - 2 * x**3 + phi * x, length * (x**3 - x**2 - bump),
    ])  # fmt: skip
    slope = np.array([-side, 1 - 4 * x + 3 * x**2 + phi * (1 - x), side, 3 * x**2 - 2 * x + phi * x])
    bending = np.array([12 * x - 6, length * (6 * x - 4 - phi), 6 - 12 * x, length * (6 * x - 2 + phi)])
    sliding = np.array([1.0, length / 2, -1.0, length / 2])[:, None] * np.ones_like(x) * phi / length

    def integral(shapes):
        return np.einsum("ik,jk,k->ij", shapes, shapes, weight) / (1 + phi) ** 2

    stiffness = E * inertia * integral(bending / length**2) + shear * integral(sliding)
    return RHO * area * integral(deflection), RHO * inertia * integral(slope), stiffness


def rotor():
    """Coordinates: x and its slope at every node, then y and its slope."""
    n = 2 * ELEMENTS + 2
    mass, rotary, stiffness = np.zeros((3, n, n))
    for k in range(ELEMENTS):
        at = slice(2 * k, 2 * k + 4)
        for whole, part in zip((mass, rotary, stiffness), element(LENGTH / ELEMENTS), strict=True):
            whole[at, at] += part
    mass, polar = mass + rotary, 2 * rotary
    for node, outer in DISCS.items():
        m, squares = RHO * np.pi * 0.07 * (outer**2 - DIAMETER**2) / 4, (outer**2 + DIAMETER**2) / 4
        mass[2 * node, 2 * node] += m
        mass[2 * node + 1, 2 * node + 1] += m * (3 * squares + 0.07**2) / 12
        polar[2 * node + 1, 2 * node + 1] += m * squares / 2
    zero, bearing = np.zeros((n, n)), np.zeros((n, n))
    bearing[0, 0] = bearing[-2, -2] = 1e6
    M = np.block([[mass, zero], [zero, mass]])
    K = np.block([[stiffness + bearing, zero], [zero, stiffness + 0.8 * bearing]])
    gyroscopic = np.block([[zero, polar], [-polar, zero]])

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return M * one, speed * gyroscopic * one, K * one, np.zeros((len(phase), 2 * n))

    axes = [f"{axis}{kind}{node}" for axis in "xy" for node in range(ELEMENTS + 1) for kind in ("", "'")]
    return solve.PeriodicSystem(matrices, axes)


def at_rest(index):
    """Return the natural frequency (rad/s) at speed zero with this index, from 0."""
    return solve.frequencies(rotor(), 0.0, index + 1).values[0, index]


def whirling(near):
    """Return the whirl frequency (rad/s) at 2000 rad/s nearest to `near`. Multipliers determine it modulo the
    speed."""
    speed = 2000.0
    angles = np.abs(np.angle(solve.floquet(rotor(), speed, rtol=1e-10).multipliers)) * speed / (2 * np.pi)
    return min(angles, key=lambda value: abs(value - near))


CASES = [
    Case(ROSS, "test_kappa_rotor3", "first natural frequency, rad/s", "82.653037", lambda: at_rest(0)),
    Case(ROSS, "test_kappa_rotor3", "backward whirl at 2000 rad/s", "77.37957042",
         lambda: whirling(77.4), within=1e-7),
    Case(ROSS, "test_kappa_rotor3", "forward whirl at 2000 rad/s", "88.98733511566752",
         lambda: whirling(89.0), within=1e-7),
]  # fmt: skip
