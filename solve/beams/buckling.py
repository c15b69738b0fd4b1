"""Compression of moving links beside what they bear before they buckle (L. Euler)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.motion import Motion
from solve.beams.positions import Positions
from solve.beams.rigid import inertia_load

_POSITIONS = 180
"""Positions of a turn at which the axial forces are looked at."""

_HALF_WAVES = {0: 1.0, 1: 0.5, 2: 2.0}
"""Half waves of the buckled link by how many of its ends are clamped: both pinned; the other end free; both
clamped."""


@dataclass(frozen=True)
class Compression:
    """Quasi-static axial forces of moving beams, which grow with the square of the speed."""

    motion: Motion

    def doubts(self, speed: float) -> list[str]:
        """A sentence for each link whose compression at a speed (rad/s) exceeds Euler's load."""
        phase, forces = self._unit
        found = []
        for link, euler, force in zip(self.motion.beams.freedoms.links, self._euler, forces.T, strict=True):
            at = int(np.argmax(force))
            pressure = speed**2 * force[at]
            if pressure > euler:
                found.append(
                    f"stiffening: at {np.degrees(phase[at]):.4g} deg link {link.name} bears a compression of "
                    f"{pressure:.4g} N, beyond its Euler load of {euler:.4g} N; it may buckle there, which "
                    "no linear model follows: lower the speed, or give it a stiffer section"
                )
        return found

    @cached_property
    def _unit(self) -> tuple[Array, Array]:
        """Phases (m,), and the largest compression in each link's elements there at 1 rad/s, (m, links)."""
        phase = np.linspace(0.0, self.motion.period, _POSITIONS, endpoint=False)
        positions = Positions(self.motion.beams, phase)
        load = inertia_load(positions, *self.motion.rates(phase))
        forces = self.motion.axial_forces(positions, positions.matrices()[1], load)
        return phase, np.stack([-each.min(axis=1) for each in forces], axis=1)

    @property
    def _euler(self) -> Array:
        """(kπ/L)² EI (links,) for k half waves, N."""
        p, links = self.motion.beams.properties, self.motion.beams.freedoms.links
        waves = np.array([_HALF_WAVES[each[3:5].count("")] for each in links])
        return (waves * np.pi / p.length) ** 2 * p.EI
