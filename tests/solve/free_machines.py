"""Free machines with exact solutions: a chain of five discs (as matrices and as a mechanism), and two discs
on a stiffening shaft."""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

import solve
from derive import Mechanism, cos, rate
from solve import PeriodicSystem
from solve.results.orbit import Orbit
from tests.solve.period.test_rigid_body import CHAIN, chain

J = np.diag([3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05])
K = chain(CHAIN)
NONE, SHAFTS = 0 * K, 1e-4 * K
DRAG = SHAFTS + np.diag([0, 0, 0.05, 0, 0.02])
TORQUE = np.array([10.0, 0, 0, 0, 0])
SPEED = 1000 * np.pi / 30


def train(C=NONE, mean=0.0, M=J, stiffness=K, torque=TORQUE, order=2):
    """Return discs with a torque proportional to cos kφ and a mean torque on the first disc."""
    M, C, stiffness, torque = (np.asarray(part, dtype=float) for part in (M, C, stiffness, torque))

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        d = np.cos(order * phase)[:, None] * torque + mean * np.eye(len(M))[0]
        return one * M, one * C, one * stiffness, d

    return PeriodicSystem(matrices, [f"q{at + 1}" for at in range(len(M))])


def amplitudes(speed, C=NONE, M=J, stiffness=K, torque=TORQUE, order=2):
    """Return amplitudes from the complex solution."""
    rate_ = order * speed
    return np.abs(np.linalg.solve(stiffness + 1j * rate_ * C - rate_**2 * M, torque))


def orders(orbit: Orbit, order=2):
    return np.array([orbit.harmonics(name)[0][order] for name in orbit.coordinates])


def exact_multipliers(C, speed, M=J, stiffness=K):
    """Return the exact multipliers in descending order of modulus."""
    zero, one = np.zeros_like(M), np.eye(len(M))
    A = np.block([[zero, one], [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, C)]])
    rho = np.exp(np.linalg.eigvals(A) * 2 * np.pi / speed)
    return rho[np.argsort(-np.abs(rho), kind="stable")]


def after_a_period(system, speed, orbit):
    """Return the state (2n,) after one period, integrated by DOP853 from the initial state of the orbit, and
    that initial state."""

    def f(t, y):
        M, C, stiffness, d = (part[0] for part in system.at(np.array([speed * t]), speed))
        q, v = np.split(y, 2)
        return np.concatenate((v, np.linalg.solve(M, d - C @ v - stiffness @ q)))

    start = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    solved = solve_ivp(f, (0, system.period / speed), start, "DOP853", rtol=1e-12, atol=1e-14)
    return solved.y[:, -1], start


def cubic(T0=0.0, b=0.0):
    machine = Mechanism("cubic", "Two free discs and a shaft that stiffens")
    q1, q2 = machine.coordinates(q1=("rad", "disc 1"), q2=("rad", "disc 2"))
    J1, J2 = machine.parameters(J1=("kg m^2", "disc 1", "> 0"), J2=("kg m^2", "disc 2", "> 0"))
    k, k3 = machine.parameters(k=("N m/rad", "shaft"), k3=("N m/rad^3", "stiffening"))
    c, drag = machine.parameters(c=("N m s/rad", "shaft"), b=("N m s/rad", "drag"))
    T, mean = machine.parameters(T=("N m", "amplitude"), T0=("N m", "mean"))
    machine.kinetic = (J1 * rate(q1) ** 2 + J2 * rate(q2) ** 2) / 2
    machine.potential = k * (q1 - q2) ** 2 / 2 + k3 * (q1 - q2) ** 4 / 4
    machine.dissipation = c * rate(q1 - q2) ** 2 / 2 + drag * rate(q2) ** 2 / 2
    machine.force(T * cos(machine.phase) + mean, along=q1)
    machine.output("drag", drag * rate(q2), "N m", "torque of the drag")
    return solve.load(machine, J1=1.0, J2=2.0, k=3.0, k3=0.5, c=0.02, b=b, T=1.0, T0=T0)


def mechanism(**numbers):
    """Return the chain as a mechanism, with drag at disc 3 and outputs."""
    names = range(1, 6)
    machine = Mechanism("drive_train", "Five discs on a shaft that turns freely")
    q = machine.coordinates(**{f"q{at}": ("rad", f"disc {at}") for at in names})
    inertias = machine.parameters(**{f"J{at}": ("kg m^2", f"disc {at}", "> 0") for at in names})
    k = machine.parameters(**{f"k{at}": ("N m/rad", f"shaft {at}", "> 0") for at in range(1, 5)})
    c, b = machine.parameters(c=("s", "damping of the shafts", ">= 0"), b=("N m s/rad", "drag", ">= 0"))
    T, T0 = machine.parameters(T=("N m", "torque of order 2"), T0=("N m", "mean torque"))
    twist = [one - other for one, other in pairwise(q)]
    machine.kinetic = sum(j * rate(angle) ** 2 for j, angle in zip(inertias, q, strict=True)) / 2
    machine.potential = sum(each * angle**2 for each, angle in zip(k, twist, strict=True)) / 2
    losses = sum(c * each * rate(angle) ** 2 for each, angle in zip(k, twist, strict=True))
    machine.dissipation = (losses + b * rate(q[2]) ** 2) / 2
    machine.force(T0 + T * cos(2 * machine.phase), along=q[0])
    machine.output("shaft", k[3] * twist[3], "N m", "torque in the last shaft")
    machine.output("drag", b * rate(q[2]), "N m", "torque of the drag")
    given = {f"J{at}": float(J[at - 1, at - 1]) for at in names}
    given |= {f"k{at}": float(each) for at, each in enumerate(CHAIN, start=1)}
    return solve.load(machine, **{**given, "c": 1e-4, "b": 0.0, "T": 10.0, "T0": 0.0, **numbers})
