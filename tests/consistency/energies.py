"""Energies of the chapter's mechanisms in CasADi, and Lagrange's equations by automatic differentiation.

An independent reference: it shares no code with the derivation, sums Fourier series term by term, and is not
linearised by hand.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca

Symbols = Mapping[str, ca.SX]


@dataclass(frozen=True)
class Energies:
    """T, V, R and pairs (force, displacement), as CasADi expressions."""

    kinetic: ca.SX
    potential: ca.SX
    dissipation: ca.SX
    work: list[tuple[ca.SX, ca.SX]]


@dataclass(frozen=True)
class State:
    """Symbols of one evaluation: coordinates z and their first and second derivatives."""

    z: ca.SX
    zd: ca.SX
    zdd: ca.SX

    @staticmethod
    def of(size: int) -> "State":
        return State(*(ca.SX.sym(name, size) for name in ("z", "zd", "zdd")))

    def rate(self, expression: ca.SX) -> ca.SX:
        """Return the total time derivative."""
        return ca.jtimes(expression, self.z, self.zd) + ca.jtimes(expression, self.zd, self.zdd)

    def rows(self, energies: Energies) -> ca.SX:
        """Return d/dt ∂T/∂ż − ∂T/∂z + ∂V/∂z + ∂R/∂ż − Q for every z."""
        momentum = ca.gradient(energies.kinetic, self.zd)
        rows = self.rate(momentum) - ca.gradient(energies.kinetic, self.z)
        rows += ca.gradient(energies.potential, self.z) + ca.gradient(energies.dissipation, self.zd)
        for force, along in energies.work:
            rows -= force * ca.gradient(along, self.z)
        return rows


def parameters(names: tuple[str, ...]) -> tuple[ca.SX, Symbols]:
    p = ca.SX.sym("p", len(names))
    return p, {name: p[i] for i, name in enumerate(names)}


def transmission(angle: ca.SX, p: Symbols) -> ca.SX:
    """Return U, the integral with zero mean of U′ = Σ aₖ cos kφ + bₖ sin kφ."""
    return sum((p[f"a{k}"] * ca.sin(k * angle) - p[f"b{k}"] * ca.cos(k * angle)) / k for k in range(1, 13))


def cam_load(phase: ca.SX, p: Symbols) -> ca.SX:
    harmonics = (p[f"Fa{k}"] * ca.cos(k * phase) + p[f"Fb{k}"] * ca.sin(k * phase) for k in range(1, 7))
    return sum(harmonics, p["F"])


def cam(state: State, p: Symbols) -> Energies:
    """Eqs. (41)–(45), where the coordinates are the angle φ0 of the drive and then q1, q2, q3."""
    phi0, q1, _, _ = ca.vertsplit(state.z)
    phi1 = phi0 + q1
    y1 = transmission(phi1, p)
    y2 = y1 + state.z[2]
    y3 = y2 + state.z[3]
    speeds = {name: state.rate(y) for name, y in (("0", phi0), ("1", phi1), ("2", y2), ("3", y3))}
    inertias = {"0": p["I0"], "1": p["I1"], "2": p["m2"], "3": p["m3"]}
    stretches = (phi1 - phi0, y2 - y1, y3 - y2)
    return Energies(
        sum(inertias[i] * speeds[i] ** 2 / 2 for i in inertias),
        sum(p[f"k{i}"] * s**2 / 2 for i, s in enumerate(stretches, 1)),
        sum(p[f"c{i}"] * state.rate(s) ** 2 / 2 for i, s in enumerate(stretches, 1)),
        [(-cam_load(phi0, p), y3)],
    )


def manipulator(state: State, p: Symbols) -> Energies:
    """Energies of Eq. (77), where the coordinates are the angle φ0 of the drive and then q1, q2."""
    phi0, q1, q2 = ca.vertsplit(state.z)
    U = transmission(phi0 + q1, p)
    speeds = (state.rate(phi0), state.rate(phi0 + q1), state.rate(U + q2))
    inertias = (p["I0"], p["I1"], p["m2"])
    return Energies(
        sum(i * v**2 / 2 for i, v in zip(inertias, speeds, strict=True)),
        p["k1"] * q1**2 / 2 + p["k2"] * q2**2 / 2,
        p["c1"] * state.rate(q1) ** 2 / 2 + p["c2"] * state.rate(q2) ** 2 / 2,
        [(-p["F"], U + q2)],
    )


@cache
def driven(energies: Callable[[State, Symbols], Energies], names: tuple[str, ...], n: int) -> ca.Function:
    """Rows of a mechanism whose first coordinate is driven: inputs as in generated code where the speed
    varies. Outputs: r of the n coordinates, and the torque of the drive.
    """
    state, (p, symbols) = State.of(n + 1), parameters(names)
    rows = state.rows(energies(state, symbols))
    drive = [ca.SX.sym(name) for name in ("phase", "speed", "acceleration")]
    motion = [ca.SX.sym(name, n) for name in ("q", "qd", "qdd")]
    moving = [ca.vertcat(first, rest) for first, rest in zip(drive, motion, strict=True)]
    rows = ca.substitute([rows], [state.z, state.zd, state.zdd], moving)[0]
    return ca.Function("driven", [*drive, *motion, p], [rows[1:], rows[0]])


@cache
def gear_pair(names: tuple[str, ...], load: str) -> ca.Function:
    """Residual of q from the two gears' own equations (66), (67), without any splitting of their rotation.

    The angles are eliminated at the end: q̈ = r_b1 φ̈1 + r_b2 φ̈2; the load acts on the pinion alone.
    """
    gears, (p, s) = State.of(2), parameters(names)
    phase, speed = ca.SX.sym("phase"), ca.SX.sym("speed")
    q, qd, qdd = (ca.SX.sym(name) for name in ("q", "qd", "qdd"))
    error = sum(s[f"e{i}"] * ca.cos(i * phase + s[f"alpha{i}"]) for i in range(1, 7))
    error_rate = ca.jtimes(error, phase, speed)
    tooth = (s[f"k{n}"] * ca.cos(n * s["z1"] * phase + s[f"gamma{n}"]) for n in range(1, 11))
    m_red = s["J1"] * s["J2"] / (s["J1"] * s["rb2"] ** 2 + s["J2"] * s["rb1"] ** 2)
    c_z = 2 * s["zeta"] * ca.sqrt(s["k0"] / m_red) * m_red
    F = s["k0"] * s["q0"] + (s["k0"] * error if load == "tracking" else 0)
    path = s["rb1"] * gears.z[0] + s["rb2"] * gears.z[1]
    mesh = Energies(
        s["J1"] * gears.zd[0] ** 2 / 2 + s["J2"] * gears.zd[1] ** 2 / 2,
        sum(tooth, s["k0"]) * (path + error) ** 2 / 2,
        c_z * (gears.rate(path) + error_rate) ** 2 / 2,
        [(F * s["J1"] / (m_red * s["rb1"]), gears.z[0])],
    )
    rows = ca.substitute([gears.rows(mesh)], [gears.zdd], [ca.SX.zeros(2)])[0]
    rigid = [ca.vertcat(q / s["rb1"], 0), ca.vertcat(qd / s["rb1"], 0)]
    torques = ca.substitute([rows], [gears.z, gears.zd], rigid)[0]
    accelerated = -s["rb1"] * torques[0] / s["J1"] - s["rb2"] * torques[1] / s["J2"]
    return ca.Function("gears", [phase, speed, q, qd, qdd, p], [m_red * (qdd - accelerated)])
