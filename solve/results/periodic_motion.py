"""Coordinates and outputs over one period: curves, statistics and spectra."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array, uniform_phases
from solve.certify.certified import Certified
from solve.contracts import Statistics
from solve.equations import output_values
from solve.errors import MatricesError, require_name
from solve.matrices import finite_phases
from solve.period.curve import PeriodicCurve
from solve.period.quantities import compiled_output_figures, coordinate_figures
from solve.period.signals import (
    LEAST_SAMPLES,
    Signal,
    enough_samples,
    figures,
    harmonics,
    samples_a_step,
    signal_statistics,
    spectrum,
)
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem


class PeriodicMotion:
    """Coordinates and outputs of a system as functions of the phase."""

    system: PeriodicSystem
    speed: float

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return q, q̇ and q̈ (n, k) at phases (k,); derivatives are with respect to time."""
        raise NotImplementedError

    def at(self, phase: Array) -> Array:
        """Return q (n, k) at phases (k,)."""
        return self.state(phase)[0]

    @property
    def samples(self) -> int:
        """Number of samples per period, sufficient to resolve the curves."""
        return LEAST_SAMPLES

    @matches_annotations
    def signal(self, name: str) -> Signal:
        """Coordinate or output as a function of the phase.

        Parameters
        ----------
        name : str
            Name of a coordinate or output.

        Returns
        -------
        callable
            Function from phases (k,) in rad to values (k,) in SI units.

        Raises
        ------
        UnknownNameError
        """
        self._require(name)
        if name in self.system.coordinates:
            row = self.system.coordinates.index(name)
            return lambda phase: self.at(phase)[row]
        return lambda phase: output_values(self.system, phase, self.speed, *self.state(phase))[name]

    @matches_annotations
    def statistics(self, name: str) -> Statistics:
        """Statistics of a coordinate or output over one period, evaluated on the continuous curve. Raises
        UnknownNameError."""
        if name in self.system.coordinates:
            return Statistics(*self._figures[self.system.coordinates.index(name)].tolist())
        self._require(name)
        if self._is_evaluated_alone("output_statistics"):
            return signal_statistics(self.signal(name), self.system.period, self.samples)
        return self.output_statistics[name]

    @matches_annotations
    def harmonics(self, name: str, count: int = 60) -> tuple[Array, Array]:
        """Amplitudes and phase angles of the Fourier series of a coordinate or output.

        Parameters
        ----------
        name : str
            Name of a coordinate or output.
        count : int
            Number of harmonics above the mean.

        Returns
        -------
        amplitudes, angles : (count + 1,) array
            A_k in SI units and ψ_k in rad of A_0 + Σ A_k cos(kφ + ψ_k), with k counted per period.

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        self._require(name)
        is_output = name not in self.system.coordinates
        too_few = enough_samples(self.samples, count) > self.samples
        if too_few or (is_output and self._is_evaluated_alone("output_samples")):
            return harmonics(self.signal(name), self.system.period, count, self.samples)
        if is_output:
            return spectrum(self.output_samples[name][:-1], count)
        return spectrum(self._coordinate_samples[self.system.coordinates.index(name)], count)

    def _is_evaluated_alone(self, cache: str) -> bool:
        """Whether an output must be evaluated separately because the outputs have not yet been evaluated
        together."""
        return self.system.labels.outputs_apart and cache not in self.__dict__

    def evaluate_outputs(self) -> None:
        """Evaluate the statistics of all outputs together. If all outputs are shown, this is faster than
        separate evaluations."""
        if self.system.outputs:
            self.output_statistics  # noqa: B018 - cached from here on

    def _require(self, name: str) -> None:
        """Raise UnknownNameError unless a coordinate or output has this name."""
        require_name("coordinate or output", name, [*self.system.coordinates, *self.system.outputs])

    @property
    def _sample_phases(self) -> Array:
        """Equidistant phases (samples,) over the period that resolve the curves."""
        return uniform_phases(self.samples, self.system.period)

    @cached_property
    def _coordinate_samples(self) -> Array:
        """Coordinates (n, samples) at the sample phases."""
        return self.at(self._sample_phases)

    @stored_property
    def output_samples(self) -> Mapping[str, Array]:
        """Mapping from outputs to their values (samples + 1,) at equidistant phases that resolve the curves
        and include both ends of the period."""
        phase = self._sample_phases
        sampled = output_values(self.system, phase, self.speed, *self.state(phase))
        return {name: np.append(sampled[name], sampled[name][0]) for name in self.system.outputs}

    @cached_property
    def _figures(self) -> Array:
        """Fields of `Statistics` (n, 7) of the coordinates."""
        return figures(self._coordinate_samples, self._coordinates_at, self.system.period)

    @stored_property
    def output_statistics(self) -> Mapping[str, Statistics]:
        """Mapping from outputs to their statistics."""
        rows = self._output_figures.tolist() if self.system.outputs else []
        return {name: Statistics(*row) for name, row in zip(self.system.outputs, rows, strict=True)}

    @property
    def _output_figures(self) -> Array:
        """Fields of `Statistics` (o, 7) of the outputs."""
        samples = np.array([self.output_samples[name][:-1] for name in self.system.outputs])
        return figures(samples, self._outputs_at, self.system.period)

    def _coordinates_at(self, phase: Array) -> Array:
        """Values (n, k) of the coordinates at phases (n, k), one row of phases per coordinate."""
        values, rows = self.at(phase.ravel()).reshape(len(phase), *phase.shape), np.arange(len(phase))
        return values[rows, rows]

    def _outputs_at(self, phase: Array) -> Array:
        """Values (o, k) of the outputs at phases (o, k), one row of phases per output."""
        flat = phase.ravel()
        values = output_values(self.system, flat, self.speed, *self.state(flat))
        return np.stack(
            [values[name].reshape(phase.shape)[row] for row, name in enumerate(self.system.outputs)]
        )

    def curve_record(self, count: int) -> dict[str, Any]:
        """JSON object with the statistics and `count` harmonics of every coordinate and output."""
        system = self.system
        self.evaluate_outputs()

        def quantity(name: str) -> dict[str, Any]:
            amplitudes, phases = self.harmonics(name, count)
            labels = {
                "unit": system.labels.units.get(name, ""),
                "meaning": system.labels.meanings.get(name, ""),
            }
            figures = self.statistics(name)._asdict()
            return {**labels, **figures, "harmonics": amplitudes, "phases": phases}

        groups = {"coordinates": system.coordinates, "outputs": system.outputs}
        return {group: {name: quantity(name) for name in names} for group, names in groups.items()}


@dataclass(frozen=True)
class QuasiStatic(PeriodicMotion):
    """Quasi-static solution K(φ) q = d(φ), in which q̇ and q̈ are neglected."""

    system: PeriodicSystem
    speed: float

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return q, q̇ = 0 and q̈ = 0 (n, k) at phases (k,). Raises MatricesError for a singular K."""
        _, _, K, d = self.system.at(phase, self.speed)
        try:
            q = np.linalg.solve(K, d[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            raise MatricesError(
                "K is singular, so that the quasi-static solution of some coordinate does not exist; leave "
                "out the quasi-static solution, or give every coordinate a stiffness"
            ) from None
        return q, np.zeros_like(q), np.zeros_like(q)


class SolvedMotion(PeriodicMotion):
    """Periodic motion given by the curve of a solution, with the quasi-static solution for comparison."""

    certified: Certified
    steps: Any

    @stored_property
    def curve(self) -> PeriodicCurve:
        """Continuous solution with its nodes and coefficients."""
        curve = self.certified.solutions.curve
        assert curve is not None
        return curve[0]

    @property
    def samples(self) -> int:
        """Number of samples per period, a multiple of the number of steps."""
        return self.steps * samples_a_step(self.steps)

    @matches_annotations
    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return q, q̇ and q̈ (n, k) at phases (k,). Raises ValueOutOfBoundsError for NaN or infinite
        phases, and for an array with several dimensions."""
        phases = finite_phases(phase)
        q, v, a = (self.curve(phases, derivative) for derivative in range(3))
        return q, self.speed * v, self.speed**2 * a

    @matches_annotations
    def signal(self, name: str) -> Signal:
        """Coordinate or output as a function of the phase; see `PeriodicMotion.signal`.

        An output of an orbit from a file is exact at the stored samples, and interpolated between them by a
        cubic spline.
        """
        if self.system.labels.solvable or name not in self.system.outputs:
            return super().signal(name)
        from scipy.interpolate import CubicSpline

        values = self.output_samples[name]
        phases = np.arange(len(values)) * (self.system.period / (len(values) - 1))
        return CubicSpline(phases, values, bc_type="periodic", extrapolate="periodic")

    @property
    def quasi_static(self) -> QuasiStatic:
        """Quasi-static solution at the same speed."""
        return QuasiStatic(self.system, self.speed)

    @stored_property
    def _figures(self) -> Array:
        """Fields of `Statistics` (n, 7) of the coordinates."""
        return coordinate_figures(self.curve, self.certified.request.engine)

    @property
    def _output_figures(self) -> Array:
        """Fields of `Statistics` (o, 7) of the outputs, evaluated by compiled code if the model's outputs
        have C code."""
        engine = self.certified.request.engine
        compiled = compiled_output_figures(self.system, self.curve, self.speed, engine)
        return super()._output_figures if compiled is None else compiled
