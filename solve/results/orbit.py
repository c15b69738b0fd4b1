"""The periodic solution: a continuous curve over one turn, with its stability and its warnings."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.certify.correction import equation_residual, linearisation_error
from solve.errors import ValueOutOfBoundsError
from solve.period.curve import PeriodicCurve
from solve.period.quantities import Signal, compiled_output_figures, coordinate_figures, samples_a_step
from solve.results.contents import (
    MOST_SHOWN,
    Column,
    Contents,
    Facts,
    curves_of,
    plain,
    require_different_names,
)
from solve.results.quantities import greek, measured
from solve.results.result import Figure
from solve.results.stability import Stability
from solve.results.turn import QuasiStatic, Turn

_ALIKE = 1e-6
"""Relative difference of what a period changes that counts as none."""


@dataclass(frozen=True)
class Orbit(Stability, Turn):
    """The T-periodic solution of M q̈ + C q̇ + K q = d."""

    _subject: ClassVar[str] = "periodic motion"
    _calculated: ClassVar[tuple[str, ...]] = (
        *Stability._calculated,
        *("curve", "residual", "linearisation_error", "_figures"),
        *("outputs", "output_statistics", "output_samples"),
    )

    @cached_property
    def curve(self) -> PeriodicCurve:
        """The continuous solution, with its nodes and coefficients."""
        curve = self.certified.solutions.curve
        assert curve is not None
        return curve[0]

    @property
    def motion(self) -> PeriodicCurve:
        """The continuous curve with its nodes, as `PeriodicSystem.along` takes it."""
        return self.curve

    @property
    def coordinates(self) -> tuple[str, ...]:
        return self.system.coordinates

    @property
    def samples(self) -> int:
        """As many for every step."""
        return self.steps * samples_a_step(self.steps)

    def signal(self, name: str) -> Signal:
        """As of any turn. An output of an orbit that was read from a file is exact at the samples that the
        file holds, and a cubic spline between them."""
        if self.system.solvable or name not in self.system.outputs:
            return super().signal(name)
        from scipy.interpolate import CubicSpline

        values = self.output_samples[name]
        phases = np.arange(len(values)) * (self.system.period / (len(values) - 1))
        return CubicSpline(phases, values, bc_type="periodic", extrapolate="periodic")

    @cached_property
    def _figures(self) -> Array:
        """Of the coordinates (n, 7)."""
        return coordinate_figures(self.curve, self.certified.request.engine)

    @property
    def _output_figures(self) -> Array:
        """Figures (o, 7) of the outputs: in compiled code where the model gives them as C text."""
        engine = self.certified.request.engine
        found = compiled_output_figures(self.system, self.curve, self.speed, engine)
        return super()._output_figures if found is None else found

    @property
    def phase(self) -> Array:
        """Phases of the nodes (m+1,), both ends of the turn included."""
        return self.curve.nodes

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
        """The continuous curve: q (n, k) at phases (k,), of any turn. Raises ValueOutOfBoundsError for NaN
        and infinite ones."""
        return self.curve(_finite(np.atleast_1d(np.asarray(phase, dtype=float))))

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """q, q̇ and q̈ (n, k) at phases (k,). Raises ValueOutOfBoundsError for NaN and infinite ones."""
        q, v, a = (self.curve(_finite(phase), derivative) for derivative in range(3))
        return q, self.speed * v, self.speed**2 * a

    @cached_property
    def outputs(self) -> Mapping[str, Array]:
        """Outputs at the nodes, (m+1,) each."""
        return dict(self.system.output_values(self.phase, self.speed, self.q, self.qd, self.qdd))

    @cached_property
    def residual(self) -> float:
        """Largest residual of the equation of motion at the middles of the steps, per row, relative to
        the largest of its terms over the turn."""
        phase = (self.phase[:-1] + self.phase[1:]) / 2
        return equation_residual(self.system, self.speed, phase, self.state(phase))

    @cached_property
    def linearisation_error(self) -> Mapping[str, float] | None:
        """Estimated distance of the nonlinear orbit from this linear one: max|difference| per coordinate,
        relative to its `CoordinateScale`, which is max|q| unless the forces on it cancel. It is the size of
        one correction of Newton's method on the same grid, and accurate while it is small. NaN if this
        correction has no solution, None for linear systems."""
        if not self.system.nonlinear:
            return None
        certified = self.certified
        grid, engine = certified.solutions.grid, certified.request.engine
        sizes = linearisation_error(self.system, self.motion, self.speed, certified.method, grid, engine)
        return dict(zip(self.coordinates, sizes.tolist(), strict=True))

    @property
    def quasi_static(self) -> QuasiStatic:
        """The kinetostatic solution at the same speed."""
        return QuasiStatic(self.system, self.speed)

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each: its accuracy, and the model's bounds."""
        system = self.system
        names = {*system.judged_quantities, *(() if system.outputs_apart else system.outputs)}
        figures = {name: self.statistics(name) for name in sorted(names)}
        return [*super().warnings, *system.judged(figures), *self._not_periodic]

    @property
    def _not_periodic(self) -> list[str]:
        """Outputs that a period changes by the same everywhere, as angles that count turns: sentences."""
        system, phase = self.system, self.system.period * np.array([0.137, 0.281, 0.618])
        if system.outputs_apart or not system.solvable:
            return []
        state, texts = self.state(phase), []
        now, later = (system.output_values(at, self.speed, *state) for at in (phase, phase + system.period))
        for name, values in now.items():
            change = later[name] - values
            same = np.abs(change - change[0]) <= _ALIKE * np.abs(change[0])
            if same.all() and abs(change[0]) > _ALIKE * np.abs(values).max():
                texts.append(
                    f"{name} is not periodic: each period changes it by {change[0]:.3g}, and its figures are "
                    "false; for an angle less whole turns write wrapped(...) in the mechanism"
                )
        return texts

    @property
    def summary(self) -> str:
        """Sentence on the verdict and the largest moduli of the coordinates."""
        units, names = self.system.units, self.coordinates[:MOST_SHOWN]
        largest = ((name, abs(self.statistics(name).max_abs)) for name in names)
        reached = [f"max|{greek(name)}| = {measured(size, units.get(name, ''))}" for name, size in largest]
        more = len(self.coordinates) - len(reached)
        others = f" and {more} more coordinates" if more > 0 else ""
        return f"{super().summary} Over one period {', '.join(reached)}{others}.{self._doubt}"

    @property
    def _doubt(self) -> str:
        """Sentence on the linearisation error."""
        errors = (self.linearisation_error or {}).values()
        if not errors:
            return ""
        part = float(f"{100 * max(errors):.2g}")
        size = "unknown" if math.isnan(part) else f"{part:g} %"
        return f" Estimated linearisation error: {size}."

    def record(self, harmonics: int = 60, quasi_static: bool = False) -> dict[str, Any]:
        """Of `solve periodic --json`, with `harmonics` amplitudes above the mean for every quantity."""
        beside = {"quasi_static": self.quasi_static.turn_record(harmonics)} if quasi_static else {}
        return {**super().record(), **plain({**self.turn_record(harmonics), **beside})}

    @property
    def whole(self) -> dict[str, Any]:
        off = self.linearisation_error
        further = {} if off is None else {"linearisation_error": off}
        return {**super().whole, "residual": self.residual, **further}

    def facts(self) -> Facts:
        if self.linearisation_error is None:
            return super().facts()
        parts = (f"{name} {100 * error:.2g} %" for name, error in self.linearisation_error.items())
        return [*super().facts(), ("linearised", f"nonlinear orbit off by about {', '.join(parts)}")]

    def _accuracy(self) -> tuple[list[str], list[str]]:
        errors, checks = super()._accuracy()
        errors = [f"orbit {self.error_estimate.orbit:.1e}", *errors, f"residual {self.residual:.1e}"]
        return errors, [*checks, f"condition {self.condition:.0e}"]

    def contents(self) -> Contents:
        """Time, phase, coordinates, outputs and rates at the nodes, multipliers and exponents, for a file.

        In .npz and .mat: phase, time (m+1,); q, qd, qdd (n, m+1) with the names `coordinates`;
        output_values (k, m+1) with the names `outputs`; multipliers, exponents (complex); metadata (JSON).
        Raises ValueOutOfBoundsError where two of them have one name.
        """
        system, stability, outputs = self.system, super().contents(), self.outputs
        q, qd, qdd = self._nodal
        arrays = {name: getattr(self, name) for name in ("phase", "time", "q", "qd", "qdd")}
        arrays |= {
            "coordinates": np.array(system.coordinates),
            "outputs": np.array(system.outputs, dtype=str),
            "output_values": np.array([outputs[name] for name in system.outputs]).reshape(
                -1, len(self.phase)
            ),
        }
        curves, rates = curves_of(system, self.time, self.phase, q, outputs), []
        for suffix, word, per, rows in (("d", "velocity", "/s", qd), ("dd", "acceleration", "/s^2", qdd)):
            for name, values in zip(system.coordinates, rows, strict=True):
                unit = system.units.get(name, "")
                rate = Column(values, unit and unit + per, f"{word} of {name}", axes=("phase",))
                rates.append((name + suffix, rate))
        rates += stability.columns.items()
        require_different_names([*curves, *rates])
        return Contents(dict(curves), dict(rates), stability.metadata, {**arrays, **stability.arrays})

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
        return super().plot(names, quasi_static, scale, harmonics)


def _finite(phase: Array) -> Array:
    if not np.isfinite(phase).all():
        raise ValueOutOfBoundsError("a phase is NaN or infinite; give finite angles in rad")
    return phase
