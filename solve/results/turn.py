"""Coordinates and outputs over one period: their curves, figures and spectra."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError, UnknownNameError
from solve.period.quantities import LEAST_SAMPLES, Signal, harmonics, statistics
from solve.results.quantities import fixed, prefixed
from solve.results.report import Table, table
from solve.statistics import Statistics
from solve.system import PeriodicSystem

_LONGEST_NAME = 26


class Turn:
    """Coordinates and outputs of a system as functions of the phase."""

    system: PeriodicSystem
    speed: float

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """q, q̇, q̈ (n, k), derivatives by time, at phases (k,)."""
        raise NotImplementedError

    def at(self, phase: Array) -> Array:
        """q (n, k) at phases (k,)."""
        return self.state(phase)[0]

    @property
    def samples(self) -> int:
        """Samples a turn that resolve the curve."""
        return LEAST_SAMPLES

    def signal(self, name: str) -> Signal:
        """The coordinate or output of that name as a function of the phase.

        Raises UnknownNameError.
        """
        if name in self.system.coordinates:
            row = self.system.coordinates.index(name)
            return lambda phase: self.at(phase)[row]
        if name in self.system.outputs:
            return lambda phase: self.system.output_values(phase, self.speed, *self.state(phase))[name]
        raise UnknownNameError("coordinate or output", name, [*self.system.coordinates, *self.system.outputs])

    def statistics(self, name: str) -> Statistics:
        """Extrema and mean of a coordinate or output, of the continuous curve."""
        return statistics(self.signal(name), self.system.period, self.samples)

    def harmonics(self, name: str, count: int = 60) -> tuple[Array, Array]:
        """Amplitudes [A0 … A_count] and phase angles of A0 + Σ A_k cos(kφ + ψ_k), k counted per period."""
        return harmonics(self.signal(name), self.system.period, count, self.samples)

    def turn_record(self, count: int) -> dict[str, Any]:
        """Figures and `count` harmonics of every coordinate and output."""
        system = self.system

        def quantity(name: str) -> dict[str, Any]:
            amplitudes, phases = self.harmonics(name, count)
            labels = {"unit": system.units.get(name, ""), "meaning": system.meanings.get(name, "")}
            figures = self.statistics(name)._asdict()
            return {**labels, **figures, "harmonics": amplitudes, "phases": phases}

        parts = {"coordinates": system.coordinates, "outputs": system.outputs}
        return {part: {name: quantity(name) for name in names} for part, names in parts.items()}

    def extrema_table(self, title: str) -> Table:
        """Largest, least and mean values, and at which phases."""
        made = table(title, "quantity", "unit", "max", "at", "min", "at", "mean", left=2)
        for name in self.system.known_quantities():
            found = self.statistics(name)
            factor, unit = prefixed(self.system.units.get(name, ""), found.max_abs)
            high, low, mean = (
                fixed(value * factor, found.max_abs * factor) for value in (found.max, found.min, found.mean)
            )
            high_at, low_at = map(self._degrees, (found.max_phase, found.min_phase))
            made.add_row(broken(name), unit, high, high_at, low, low_at, mean)
        return made

    def _degrees(self, phase: float) -> str:
        """A phase of the drive, the end of the turn as its beginning."""
        rounded = round(math.degrees(phase), 1)
        return f"{rounded if rounded < round(math.degrees(self.system.period), 1) else 0.0:.1f}°"


@dataclass(frozen=True)
class QuasiStatic(Turn):
    """The kinetostatic solution K(φ) q = d(φ): what remains when q̇ and q̈ are neglected."""

    system: PeriodicSystem
    speed: float

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        _, _, K, d = self.system.at(phase, self.speed)
        try:
            q = np.linalg.solve(K, d[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            raise MatricesError(
                "K is singular: without inertia some coordinate has no equilibrium; leave the quasi-static "
                "solution out, or give every coordinate a stiffness"
            ) from None
        return q, np.zeros_like(q), np.zeros_like(q)


def broken(name: str) -> str:
    """A long name on two lines, parted at an underscore: 80 columns leave it no more than these."""
    place = name.rfind("_", 0, _LONGEST_NAME) + 1
    return name if len(name) <= _LONGEST_NAME or not place else f"{name[:place]}\n{name[place:]}"
