"""Coordinates and outputs over one period: their curves, figures and spectra."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.errors import MatricesError, require_name
from solve.period.quantities import (
    LEAST_SAMPLES,
    Signal,
    enough_samples,
    figures,
    harmonics,
    spectrum,
    statistics,
)
from solve.system import PeriodicSystem


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
        self._require(name)
        if name in self.system.coordinates:
            row = self.system.coordinates.index(name)
            return lambda phase: self.at(phase)[row]
        return lambda phase: self.system.output_values(phase, self.speed, *self.state(phase))[name]

    def statistics(self, name: str) -> Statistics:
        """Extrema and mean of a coordinate or output of the continuous curve. Raises UnknownNameError."""
        if name in self.system.coordinates:
            return Statistics(*self._figures[self.system.coordinates.index(name)].tolist())
        self._require(name)
        if self._is_apart("output_statistics"):
            return statistics(self.signal(name), self.system.period, self.samples)
        return self.output_statistics[name]

    def harmonics(self, name: str, count: int = 60) -> tuple[Array, Array]:
        """Amplitudes [A0 … A_count] and phase angles of A0 + Σ A_k cos(kφ + ψ_k), k counted per period.
        Raises UnknownNameError, ValueOutOfBoundsError."""
        self._require(name)
        of_output = name not in self.system.coordinates
        too_few = enough_samples(self.samples, count) > self.samples
        if too_few or (of_output and self._is_apart("output_samples")):
            return harmonics(self.signal(name), self.system.period, count, self.samples)
        if of_output:
            return spectrum(self.output_samples[name][:-1], count)
        return spectrum(self._coordinate_samples[self.system.coordinates.index(name)], count)

    def _is_apart(self, figures: str) -> bool:
        """Whether an output is evaluated separately because these statistics of the others are not known
        yet."""
        return self.system.outputs_apart and figures not in self.__dict__

    def evaluate_outputs(self) -> None:
        """Evaluate the statistics of all outputs together, for displays of all outputs."""
        if self.system.outputs:
            self.output_statistics  # noqa: B018 - cached from here on

    def _require(self, name: str) -> None:
        """Raise UnknownNameError unless there is a coordinate or output of that name."""
        require_name("coordinate or output", name, [*self.system.coordinates, *self.system.outputs])

    @property
    def _sample_phases(self) -> Array:
        """Equidistant phases (samples,) of the period that resolve the curve."""
        return np.arange(self.samples) * (self.system.period / self.samples)

    @cached_property
    def _coordinate_samples(self) -> Array:
        """Coordinates (n, samples) at the sample phases."""
        return self.at(self._sample_phases)

    @cached_property
    def output_samples(self) -> Mapping[str, Array]:
        """Outputs (samples + 1,) at equidistant phases that resolve them, including both ends."""
        phase = self._sample_phases
        sampled = self.system.output_values(phase, self.speed, *self.state(phase))
        return {name: np.append(sampled[name], sampled[name][0]) for name in self.system.outputs}

    @cached_property
    def _figures(self) -> Array:
        """Statistics (n, 7) of the coordinates, the fields of `Statistics`."""
        return figures(self._coordinate_samples, self._coordinates_at, self.system.period)

    @cached_property
    def output_statistics(self) -> Mapping[str, Statistics]:
        """Extrema and means of the outputs, by name."""
        rows = self._output_figures.tolist() if self.system.outputs else []
        return {name: Statistics(*row) for name, row in zip(self.system.outputs, rows, strict=True)}

    @property
    def _output_figures(self) -> Array:
        """Statistics (o, 7) of the outputs, the fields of `Statistics`."""
        samples = np.array([self.output_samples[name][:-1] for name in self.system.outputs])
        return figures(samples, self._outputs_at, self.system.period)

    def _coordinates_at(self, phase: Array) -> Array:
        """Coordinates (n, k), each at its own phases (n, k)."""
        values, rows = self.at(phase.ravel()).reshape(len(phase), *phase.shape), np.arange(len(phase))
        return values[rows, rows]

    def _outputs_at(self, phase: Array) -> Array:
        """Outputs (o, k), each at its own phases (o, k)."""
        every = phase.ravel()
        values = self.system.output_values(every, self.speed, *self.state(every))
        return np.stack(
            [values[name].reshape(phase.shape)[row] for row, name in enumerate(self.system.outputs)]
        )

    def turn_record(self, count: int) -> dict[str, Any]:
        """Figures and `count` harmonics of every coordinate and output."""
        system = self.system
        self.evaluate_outputs()

        def quantity(name: str) -> dict[str, Any]:
            amplitudes, phases = self.harmonics(name, count)
            labels = {"unit": system.units.get(name, ""), "meaning": system.meanings.get(name, "")}
            figures = self.statistics(name)._asdict()
            return {**labels, **figures, "harmonics": amplitudes, "phases": phases}

        parts = {"coordinates": system.coordinates, "outputs": system.outputs}
        return {part: {name: quantity(name) for name in names} for part, names in parts.items()}


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
