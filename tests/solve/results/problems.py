"""Small periodic systems with results in closed form, for tests of figures and files."""

import math

import numpy as np

import solve
from solve import PeriodicSystem
from solve.capabilities import Outputs
from solve.labels import Labels

SPEED = 3.0


def oscillators(damping=0.4):
    """Return two uncoupled oscillators, q″ + damping q′ + 4 q = cos φ + 2 and q″ + damping q′ + 9 q = sin
    3φ."""

    def matrices(phase, speed):
        one = np.broadcast_to(np.eye(2), (len(phase), 2, 2))
        d = np.stack((np.cos(phase) + 2.0, np.sin(3 * phase)), axis=1)
        return one, damping * one, one * np.array([4.0, 9.0]), d

    class Oscillators(PeriodicSystem, Outputs):
        labels = Labels(
            name="two oscillators",
            units={"x": "m", "phi": "rad", "power": "W"},
            meanings={"x": "slide", "phi": "twist", "power": "lost in the damper"},
        )
        outputs = ("power",)

        @property
        def capabilities(self):
            return super().capabilities._replace(outputs=self)

        def output_values(self, phase, speed, q, qd, qdd, acceleration=0.0):
            return {"power": damping * qd[0] ** 2}

    return Oscillators(matrices, ["x", "phi"])


def response(stiffness, damping, order, speed=SPEED):
    """Return the complex amplitude of the response to a unit force cos(order φ)."""
    omega = order * speed
    return 1.0 / (stiffness - omega**2 + 1j * damping * omega)


def x_of(phase, damping=0.4):
    return np.real(response(4.0, damping, 1) * np.exp(1j * phase)) + 0.5


def multipliers(damping=0.4):
    """Return exp(λT) of the dominant pair. Both oscillators have the same decay rate."""
    return math.exp(-damping / 2 * 2 * math.pi / SPEED)


def orbit(damping=0.4, **settings):
    return solve.periodic(oscillators(damping), SPEED, **settings)


def chain(n):
    """Return n identical oscillators with given names."""

    def matrices(phase, speed):
        one = np.broadcast_to(np.eye(n), (len(phase), n, n))
        return one, 0.4 * one, 4.0 * one, np.cos(phase)[:, None] * np.arange(1.0, n + 1)

    return PeriodicSystem(matrices, [f"q{k}" for k in range(1, n + 1)])
