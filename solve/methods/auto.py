"""The choice that a user who names no method gets."""

from dataclasses import dataclass

import numpy as np

from solve.methods.gauss import Gauss
from solve.methods.method import Method, OneStep
from solve.methods.radau import Radau
from solve.system import PeriodicSystem

RESOLVABLE = 512
"""ω_max T up to which a grid of moderate size follows even the fastest mode, so that Gauss is safe."""

PHASES = 32
"""At which the coefficients are frozen to see how fast their modes are."""


@dataclass(frozen=True)
class Auto(OneStep):
    """Gauss where ω_max T, the angle that the fastest frozen mode turns in one period, is at most 512:
    then 512 steps have ω_max h ≤ 1. Radau IIA otherwise, which keeps no mode that it does not resolve."""

    name = "auto"
    order = 9
    curve_order = 8
    l_stable = True

    def settled(self, system: PeriodicSystem, speed: float) -> Method:
        phase = (np.arange(PHASES) + 0.5) * (system.period / PHASES)
        return Gauss() if system.fastest(phase, speed) * system.period <= RESOLVABLE else Radau()
