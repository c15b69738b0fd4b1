"""The flexible coupler derived a second time: energies of the deformed linkage, differentiated by CasADi.

Nothing here speaks of an axial force, a load function or a modal integral. The coupler is an inextensible
beam: its points move towards A by u = ½∫w′² dx, so that its chord is shorter than l3; the loop closes exactly
over that shorter chord, in Cartesian coordinates as the intersection of two circles. Kinetic energy T,
potential V and the power function R (drag, material damping, external moment; R_ż are the resisting forces)
are written down for finite motion, and d/dt T_ż − T_z + V_z + R_ż is linearised about the straight coupler.

Two further coordinates carry reactions: the row of the phase is the drive torque, and a gap between crank pin
and beam, along the chord, opens against the tension there: minus its row is the axial force at A.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

PARAMETERS = "l1 l2 l3 l4 s4 m4 E A I rho cx cy JC alpha alpha4 theta g Me"
NODES = 40
"""Quadrature points along the coupler: exact to rounding up to 12 modes."""


@dataclass(frozen=True)
class Linearised:
    """M, B, C (m, n, n), h (m, n) in kg, N s/m, N/m, N; at w = 0 drive torque (N m), axial force at A (N)."""

    M: np.ndarray
    B: np.ndarray
    C: np.ndarray
    h: np.ndarray
    drive_torque: np.ndarray
    axial_force: np.ndarray

    def errors(self, *others: np.ndarray) -> dict[str, float]:
        """Return the differences of other M, B, C and h, each relative to its scale."""
        here = {"M": self.M, "B": self.B, "C": self.C, "h": self.h}
        scales = {label: abs(part).max() for label, part in here.items()} | {"C": variation(self.C)}
        pairs = zip(here.items(), others, strict=True)
        return {label: abs(other - part).max() / scales[label] for (label, part), other in pairs}


def variation(matrix: np.ndarray) -> float:
    """Return the largest change of an entry over a period: the scale of C without its constant elastic
    term."""
    return np.ptp(matrix, axis=0).max()


def linearised(phase, speed: float, parameters: Mapping[str, float], modes: int, side: float) -> Linearised:
    """Linear equations at phases (m,) in rad; `side` +1 puts joint B on the left of the line from A to C."""
    phase = np.asarray(phase, dtype=float)
    values = np.array([parameters[name] for name in PARAMETERS.split()])
    columns = _equations(modes).map(len(phase))(phase[None, :], speed, values, side)
    M, B, C, rest, torque, axial = (np.array(column) for column in columns)
    M, B, C = (matrix.reshape(modes, len(phase), modes).transpose(1, 0, 2) for matrix in (M, B, C))
    return Linearised(M, B, C, -rest.T, torque[0], axial[0])


@cache
def _equations(modes: int) -> ca.Function:
    """CasADi function of phase, speed, p and side: M, B, C, and residual and reactions at w = 0."""
    phase, speed, side = (ca.SX.sym(name) for name in ("phase", "speed", "side"))
    q, qd, qdd = (ca.SX.sym(name, modes) for name in ("q", "qd", "qdd"))
    p = ca.SX.sym("p", len(PARAMETERS.split()))
    torque, axial, modal = motion(modes)(phase, speed, q, qd, qdd, p, side)
    parts = [ca.jacobian(modal, qdd), ca.jacobian(modal, qd), ca.jacobian(modal, q), modal, torque, axial]
    moving = ca.vertcat(q, qd, qdd)
    straight = ca.substitute(parts, [moving], [ca.DM.zeros(moving.shape)])
    return ca.Function("linearised", [phase, speed, p, side], straight)


@cache
def motion(modes: int) -> ca.Function:
    """The nonlinear equations: drive torque (N m), axial force at A (N) and modal residual (N)."""
    phase, speed, side, gap = (ca.SX.sym(name) for name in ("phase", "speed", "side", "gap"))
    q, qd, qdd = (ca.SX.sym(name, modes) for name in ("q", "qd", "qdd"))
    values = ca.SX.sym("p", len(PARAMETERS.split()))
    p = dict(zip(PARAMETERS.split(), ca.vertsplit(values), strict=True))
    z = ca.vertcat(phase, gap, q)
    rate = ca.SX.sym("rate", modes + 2)
    T, V, R = _energies(z, rate, p, side)
    momentum = ca.gradient(T, rate)
    d_dt = ca.jtimes(momentum, ca.vertcat(z, rate), ca.vertcat(rate, ca.vertcat(0, 0, qdd)))
    rows = d_dt - ca.gradient(T - V, z) + ca.gradient(R, rate)
    closed = ca.substitute(rows, ca.vertcat(gap, rate), ca.vertcat(0, speed, 0, qd))
    inputs = [phase, speed, q, qd, qdd, values, side]
    return ca.Function("motion", inputs, [closed[0], -closed[1], closed[2:]])


def _energies(z, rate, p, side):
    """T, V and R at the coordinates z = (phase, gap, q) with rates `rate`."""
    phase, gap, q = z[0], z[1], z[2:]
    abscissa, weight, integral = _quadrature()
    x, dx = p["l3"] * abscissa, p["l3"] * weight
    w, slope, curvature = _sines(q, abscissa, p["l3"])
    shift = p["l3"] * integral @ (slope**2 / 2)
    chord = gap + p["l3"] - ca.dot(dx, slope**2 / 2)

    A = p["l2"] * ca.vertcat(ca.cos(phase), ca.sin(phase))
    C = p["l1"] * ca.vertcat(ca.cos(p["theta"]), ca.sin(p["theta"]))
    B = _joint(A, C, chord, p["l4"], side)
    along, follower = (B - A) / chord, (B - C) / p["l4"]
    rx = A[0] + (gap + x - shift) * along[0] - w * along[1]
    ry = A[1] + (gap + x - shift) * along[1] + w * along[0]

    vx, vy, bending_rate = (ca.jtimes(each, z, rate) for each in (rx, ry, curvature))
    turning3, turning4 = (_cross(each, ca.jtimes(each, z, rate)) for each in (along, follower))
    spin = turning3 + ca.jtimes(ca.asin(slope), z, rate)
    mu, rho_I, EI = p["rho"] * p["A"], p["rho"] * p["I"], p["E"] * p["I"]
    height4 = follower[0] * ca.sin(p["alpha4"]) + follower[1] * ca.cos(p["alpha4"])

    T = ca.dot(dx, mu * (vx**2 + vy**2) + rho_I * spin**2) / 2 + p["JC"] * turning4**2 / 2
    V = ca.dot(dx, EI * curvature**2 / 2 + mu * p["g"] * ry) + p["m4"] * p["g"] * p["s4"] * height4
    tangential, normal = along[0] * vx + along[1] * vy, along[0] * vy - along[1] * vx
    R = ca.dot(dx, p["cx"] * tangential**2 + p["cy"] * normal**2 + p["alpha"] * EI * bending_rate**2) / 2
    return T, V, R + p["Me"] * turning4


def _joint(A, C, a: ca.SX, c: ca.SX, side: ca.SX):
    """Return the corner B of the triangle ABC with AB = a and CB = c, on the left of A→C for side = 1."""
    across = C - A
    square = ca.sumsqr(across)
    foot = (square + a**2 - c**2) / (2 * square)
    return A + foot * across + side * ca.sqrt(a**2 / square - foot**2) * ca.vertcat(-across[1], across[0])


def _cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def _sines(q, abscissa: np.ndarray, length: ca.SX):
    """Return deflection, slope and curvature at the nodes for q1 sin(πx/l) + q2 sin(2πx/l) + …"""
    number = np.pi * np.arange(1, q.numel() + 1)
    angle = np.outer(abscissa, number)
    sines, cosines = ca.DM(np.sin(angle)), ca.DM(np.cos(angle))
    return sines @ q, cosines @ (number * q / length), -sines @ (number**2 * q / length**2)


def _quadrature() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss–Legendre nodes and weights on [0, 1], and the matrix that integrates from 0 to each node."""
    legendre = np.polynomial.legendre
    node, weight = legendre.leggauss(NODES)
    values = legendre.legvander(node, NODES)
    antiderivative = np.empty((NODES, NODES))
    for degree in range(NODES):
        series = legendre.legint(np.eye(NODES)[degree], lbnd=-1)
        antiderivative[:, degree] = values[:, : len(series)] @ series
    integral = antiderivative @ np.linalg.inv(values[:, :NODES])
    return (node + 1) / 2, weight / 2, integral / 2
