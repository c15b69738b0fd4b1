"""The periodic solution: a continuous curve over one turn, with its stability and its warnings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError, UnknownNameError
from solve.period.curve import PeriodicCurve
from solve.period.quantities import LEAST_SAMPLES, Signal, harmonics, samples_a_step, statistics
from solve.results.contents import Contents, orbit_contents
from solve.results.plot import Motion, orbit_figure
from solve.results.rows import checked_scale, shown
from solve.results.save import checked_data, dataset, save
from solve.results.stability import Stability
from solve.results.style import Figure
from solve.statistics import Statistics
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import xarray


class Turn:
    """Coordinates and outputs of a system as functions of the phase."""

    system: PeriodicSystem
    speed: float

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """q, q̇, q̈ (n, k), derivatives by time, at phases (k,)."""
        raise NotImplementedError

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
            return lambda phase: self.state(phase)[0][row]
        if name in self.system.outputs:
            return lambda phase: self.system.output_values(phase, self.speed, *self.state(phase))[name]
        raise UnknownNameError("coordinate or output", name, [*self.system.coordinates, *self.system.outputs])

    def statistics(self, name: str) -> Statistics:
        """Extrema and mean of a coordinate or output, of the continuous curve."""
        return statistics(self.signal(name), self.system.period, self.samples)

    def harmonics(self, name: str, count: int = 60) -> tuple[Array, Array]:
        """Amplitudes [A0 … A_count] and phase angles of A0 + Σ A_k cos(kφ + ψ_k), k counted per period."""
        return harmonics(self.signal(name), self.system.period, count, self.samples)


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


@dataclass(frozen=True)
class Orbit(Stability, Turn):
    """The T-periodic solution of M q̈ + C q̇ + K q = d."""

    @property
    def _curve(self) -> PeriodicCurve:
        curve = self.certified.solutions.curve
        assert curve is not None
        return curve[0]

    @property
    def coordinates(self) -> tuple[str, ...]:
        return self.system.coordinates

    @property
    def samples(self) -> int:
        """As many for every step."""
        return self.steps * samples_a_step(self.steps)

    @property
    def phase(self) -> Array:
        """Phases of the nodes (m+1,), both ends of the turn included."""
        return self._curve.nodes

    @property
    def time(self) -> Array:
        """Times of the nodes (m+1,) in seconds."""
        return self.phase / self.speed

    @property
    def q(self) -> Array:
        """Coordinates at the nodes (n, m+1)."""
        return self._nodal[0]

    @property
    def qd(self) -> Array:
        """Velocities at the nodes (n, m+1), by time."""
        return self._nodal[1]

    @property
    def qdd(self) -> Array:
        """Accelerations at the nodes (n, m+1), by time; behind the jump where the matrices jump."""
        return self._nodal[2]

    @cached_property
    def _nodal(self) -> tuple[Array, Array, Array]:
        q, qd, qdd = (np.concatenate((part, part[:, :1]), axis=1) for part in self.state(self.phase[:-1]))
        return q, qd, qdd

    def at(self, phase: Array) -> Array:
        """The continuous curve: q (n, k) at phases (k,), of any turn."""
        return self._curve(np.atleast_1d(np.asarray(phase, dtype=float)))

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        q, v, a = (self._curve(phase, derivative) for derivative in range(3))
        return q, self.speed * v, self.speed**2 * a

    @cached_property
    def outputs(self) -> Mapping[str, Array]:
        """Outputs at the nodes, (m+1,) each."""
        return self.system.output_values(self.phase, self.speed, self.q, self.qd, self.qdd)

    @cached_property
    def residual(self) -> float:
        """Largest residual of the equation of motion at the middles of the steps, per row, relative to
        the largest of its terms over the turn."""
        phase = (self.phase[:-1] + self.phase[1:]) / 2
        M, C, K, d = self.system.at(phase, self.speed)
        q, qd, qdd = self.state(phase)
        terms = [np.einsum("kij,jk->ki", A, x) for A, x in ((M, qdd), (C, qd), (K, q))]
        scale = np.max([np.abs(term).max(axis=0) for term in (*terms, d)], axis=0)
        residual = np.abs(sum(terms) - d).max(axis=0)
        return float(np.max(residual / np.where(scale > 0, scale, 1.0)))

    @property
    def quasi_static(self) -> QuasiStatic:
        """The kinetostatic solution at the same speed."""
        return QuasiStatic(self.system, self.speed)

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each: its accuracy, and the model's bounds."""
        figures = {name: self.statistics(name) for name in self.system.judged_quantities}
        return [*super().warnings, *self.system.judged(figures)]

    def contents(self) -> Contents:
        """Time, phase, coordinates, outputs and rates at the nodes, multipliers and exponents: for a file."""
        state, stability = (self.q, self.qd, self.qdd), super().contents()
        return orbit_contents(self.system, (self.phase, self.time), state, self.outputs, stability)

    def plot(
        self,
        names: Sequence[str] | None = None,
        quasi_static: bool = False,
        scale: str = "linear",
        harmonics: int | None = None,
    ) -> Figure:
        """Time curve over one period and spectrum of each name (by default the coordinates), multipliers.

        quasi_static draws the kinetostatic solution beside. scale of the spectra is "linear" or "dB", 0 dB
        the largest amplitude; up to `harmonics` orders, by default all that can be seen. Raises
        UnknownNameError, ValueOutOfBoundsError.
        """
        checked_scale(scale)
        phase = np.linspace(0.0, self.system.period, self.samples + 1)
        motions = {}
        for name in shown(self.system, names):
            beside = self.quasi_static.signal(name)(phase) if quasi_static else None
            amplitudes, _ = self.harmonics(name, harmonics or self.samples // 8)
            motions[name] = Motion(self.signal(name)(phase), beside, amplitudes)
        return orbit_figure(self.system, self.speed, motions, self._drawn, scale)

    def save(self, path: str | Path) -> None:
        """Write the orbit as the file's ending says: .npz, .csv, .mat or .nc; whole or not at all.

        Raises FileError, and MissingExtraError for .nc without its packages.
        """
        file = checked_data(path)
        save(self.contents(), file)

    def to_xarray(self) -> "xarray.Dataset":
        """The orbit over the phase: a variable a coordinate and output; the rates of coordinate q1 are q1d
        and q1dd. Raises MissingExtraError without xarray."""
        return dataset(self.contents())
