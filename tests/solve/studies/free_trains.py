"""Mechanisms: free drive trains, two masses on springs of any sign, and a bearing without stiffness at
rest."""

import numpy as np

from derive import Mechanism, cos, rate
from tests.derive.modules import module_of
from tests.solve.newton.mechanisms import model_of

INERTIA = 3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05
STIFFNESS = 12e3, 12e3, 14e3, 10e3
HERTZ = 0.0, 81.20762902, 141.21407139, 378.9529539, 536.36328293
"""Natural frequencies in Hz of these discs in line, from mpmath."""


def train(inertia=INERTIA, stiffness=STIFFNESS, **changed):
    """Discs in series, the first with the torque 10 N m cos 2φ."""
    n = len(inertia)
    made = Mechanism("train", "Discs on a shaft that is free to turn")
    a = made.coordinates(**{f"a{i}": ("rad", f"disc {i}") for i in range(1, n + 1)})
    J = made.parameters(**{f"J{i}": ("kg m^2", f"disc {i}", "> 0") for i in range(1, n + 1)})
    k = made.parameters(**{f"k{i}": ("N m/rad", f"shaft {i}") for i in range(1, n)})
    (T,) = made.parameters(T=("N m", "torque"))
    made.kinetic = sum(Ji * rate(x) ** 2 for Ji, x in zip(J, a, strict=True)) / 2
    made.potential = sum(ki * (x - y) ** 2 for ki, x, y in zip(k, a, a[1:], strict=False)) / 2
    made.force(T * cos(2 * made.phase), along=a[0])
    numbers = {f"J{i}": value for i, value in enumerate(inertia, 1)}
    numbers |= {f"k{i}": value for i, value in enumerate(stiffness, 1)}
    return model_of(module_of(made), **{**numbers, "T": 10.0, **changed})


def masses(**changed):
    """Two masses of 1 kg with springs k1 and k2 to ground, and kc between the masses."""
    made = Mechanism("masses", "Two masses on springs")
    x, y = made.coordinates(x=("m", "first mass"), y=("m", "second mass"))
    (m,) = made.parameters(m=("kg", "each mass", "> 0"))
    k1, k2, kc = made.parameters(k1=("N/m", "first"), k2=("N/m", "second"), kc=("N/m", "between"))
    made.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = (k1 * x**2 + k2 * y**2 + kc * (x - y) ** 2) / 2
    made.force(made.parameters(F=("N", "load"))[0] * cos(made.phase), along=x)
    return model_of(module_of(made), **{"m": 1.0, "k1": 3.0, "k2": 100.0, "kc": 1.0, "F": 1.0, **changed})


def squares_of_masses(k1):
    """Closed form of λ for the two masses with k2 = 100 and kc = 1."""
    middle, root = (k1 + 102.0) / 2, np.hypot((k1 - 100.0) / 2, 1.0)
    return middle - root, middle + root


def bearing():
    """Mass on a spring whose stiffness is inversely proportional to the speed."""
    made = Mechanism("bearing", "A mass in a bearing")
    (x,) = made.coordinates(x=("m", "shaft"))
    m, k, w = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "stiffness"), w=("rad/s", "its speed"))
    made.kinetic = m * rate(x) ** 2 / 2
    made.potential = k * w / made.speed * x**2 / 2
    made.force(made.parameters(F=("N", "load"))[0] * cos(made.phase), along=x)
    return model_of(module_of(made), m=1.0, k=10.0, w=10.0, F=1.0)
