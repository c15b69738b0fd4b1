"""Independent reference: three free bodies in absolute coordinates.

The joints and the drive are constraints g(q, time) = 0, which CasADi differentiates. Velocities,
accelerations and Lagrange multipliers follow from g' = 0, M q'' + g_qᵀ λ = Q and g'' = 0. The Lagrange
multipliers are the joint forces and the drive torque.
"""

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class FreeBodies:
    """Motion and forces of three bodies.

    q, qd, qdd (3, 3): x and y (m) of the centre of mass and angle (rad) of each body, and time derivatives of
    these. F01, F12, F23, F03 (4, 2): joint forces in N. torque: drive torque in N m.
    """

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    forces: np.ndarray
    torque: float


def free_bodies(lengths, bodies, crank, load, start) -> FreeBodies:
    """Solve the motion of the bodies.

    lengths: L1 … L4. bodies: (mass, centre X, centre Y, J) of each. crank: (t1, omega1, alpha1). load: torque
    that opposes the follower. start: initial guess of the angles of the links for Newton's method.
    """
    constraints, matrices = _functions()
    p = np.concatenate([lengths, np.ravel(bodies), crank, [load]])
    q = np.concatenate([[0.0, 0.0, angle] for angle in start])
    for _ in range(30):
        g, J = (x.full() for x in constraints(q, p))
        q = q - np.linalg.solve(J, g)[:, 0]
    assert np.abs(constraints(q, p)[0].full()).max() < 1e-13, "Newton's iteration has not converged"
    J, g_t, *_ = (x.full() for x in matrices(q, np.zeros(9), p))
    qd = np.linalg.solve(J, -g_t)
    J, _, M, Q, rest = (x.full() for x in matrices(q, qd, p))
    system = np.block([[M, J.T], [J, np.zeros((9, 9))]])
    solved = np.linalg.solve(system, np.concatenate([Q, -rest]))[:, 0]
    qdd, multipliers = solved[:9], solved[9:]
    # Minus the multiplier acts on the body that its constraint counts positive.
    forces = multipliers[:8].reshape(4, 2) * np.array([-1.0, 1.0, 1.0, -1.0])[:, None]
    return FreeBodies(*(x.reshape(3, 3) for x in (q, qd, qdd)), forces, -multipliers[8])


@lru_cache
def _functions() -> tuple[ca.Function, ca.Function]:
    """Functions for g and g_q, and for g_q, g_t, M, Q and the terms of g'' other than g_q q''."""
    q, qd, time = ca.SX.sym("q", 9), ca.SX.sym("qd", 9), ca.SX.sym("time")
    lengths, bodies = ca.SX.sym("L", 4), ca.SX.sym("body", 4, 3)
    crank, load = ca.SX.sym("crank", 3), ca.SX.sym("load")
    p = ca.vertcat(lengths, ca.vec(bodies), crank, load)

    def place(k: int, x: ca.SX | float) -> ca.SX:
        """Position of the point (x, 0) in the frame of a link."""
        X, Y, angle = x - bodies[1, k], -bodies[2, k], q[3 * k + 2]
        turned = ca.vertcat(ca.cos(angle) * X - ca.sin(angle) * Y, ca.sin(angle) * X + ca.cos(angle) * Y)
        return q[3 * k : 3 * k + 2] + turned

    g = ca.vertcat(
        place(0, 0.0),
        place(0, lengths[0]) - place(1, 0.0),
        place(1, lengths[1]) - place(2, lengths[2]),
        place(2, 0.0) - ca.vertcat(lengths[3], 0),
        q[2] - (crank[0] + crank[1] * time + crank[2] * time**2 / 2),
    )
    J, g_t = ca.jacobian(g, q), ca.jacobian(g, time)
    rest = ca.jtimes(ca.mtimes(J, qd), q, qd) + ca.jacobian(g_t, time)
    M = ca.diag(ca.vertcat(*(bodies[row, k] for k in range(3) for row in (0, 0, 3))))
    Q = ca.vertcat(ca.SX.zeros(8), -load)
    now = [ca.substitute(x, time, 0) for x in (g, J, g_t, M, Q, rest)]
    return (ca.Function("constraints", [q, p], now[:2]), ca.Function("matrices", [q, qd, p], now[1:]))
