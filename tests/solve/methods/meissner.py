"""Meissner's equation with a load and damping, and its periodic solution from products of matrix
exponentials."""

import numpy as np
from scipy.linalg import expm

from tests.solve.systems import meissner

DELTA, EPSILON, ZETA, LOAD = 1.3, 0.7, 0.05, -0.4
JUMP, TURN = 0.8 * np.pi, 2 * np.pi
EQUATION = meissner(DELTA, EPSILON, ZETA, LOAD)


def generator(stiffness, damping, load):
    """Matrix of the linear system for (q, q′, 1)."""
    return np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, load], [0.0, 0.0, 0.0]])


FIRST = generator(DELTA + EPSILON, 2 * ZETA, 1.0)
SECOND = generator(DELTA - EPSILON, 2 * ZETA, LOAD)
PERIOD = expm(SECOND * (TURN - JUMP)) @ expm(FIRST * JUMP)
MULTIPLIERS = np.linalg.eigvals(PERIOD[:2, :2])
START = np.linalg.solve(np.eye(2) - PERIOD[:2, :2], PERIOD[:2, 2])


def states(phase):
    """States (q, q′) of the periodic solution at phases within one period: (2, k)."""
    at_jump = expm(FIRST * JUMP) @ [*START, 1.0]
    columns = [
        expm(FIRST * p) @ [*START, 1.0] if p < JUMP else expm(SECOND * (p - JUMP)) @ at_jump for p in phase
    ]
    return np.array(columns).T[:2]
