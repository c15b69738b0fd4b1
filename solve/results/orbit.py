"""Periodic solution of the linearised equations: continuous curve, stability and warnings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import ROUND_OFF, Array
from solve.certify.correction import equation_residual, linearisation_error
from solve.equations import exceeded_limits, is_nonlinear, judged_quantities, output_values
from solve.matrices import finite_phases
from solve.results.contents import (
    MOST_SHOWN,
    Column,
    FileContents,
    HeaderRows,
    columns_by_name,
    curves_of,
    to_json,
)
from solve.results.formatting import greek, linearisation, measured
from solve.results.periodic_motion import SolvedMotion
from solve.results.result import Figure
from solve.results.serialization import stored_property
from solve.results.stability import Stability

_EQUAL_CHANGES = 1e-6
"""Relative difference up to which the changes of an output over different periods count as equal, and
relative change up to which a change counts as zero. Chosen by judgement."""


@dataclass(frozen=True)
class Orbit(Stability, SolvedMotion):
    """T-periodic solution of M q̈ + C q̇ + K q = d at one speed, from `solve.periodic`.

    It has the attributes of `Stability`, and the methods `signal`, `statistics` and `harmonics` of
    `PeriodicMotion`.

    Attributes
    ----------
    coordinates : tuple of str
        Names of the n coordinates.
    phase, time : (m + 1,) array
        Phases in rad and times in s of the nodes, including both ends of the period.
    q, qd, qdd : (n, m + 1) array
        Coordinates, velocities and accelerations at the nodes, in SI units. Derivatives are with respect to
        time.
    outputs : mapping of str to (m + 1,) array
        Mapping from the names of outputs to their values at the nodes.
    states : tuple of str
        Names of the N first-order states, which are the last coordinates; empty for systems of second order.
    x, xd : (N, m + 1) array
        First-order states and their rates at the nodes; rows of `q` and `qd`.
    residual : float
        Largest residual of the equation of motion, relative to its largest term.
    linearisation_error : mapping of str to float, or None
        Estimated distance of each coordinate from the nonlinear orbit, relative to the coordinate's scale.
    """

    _subject: ClassVar[str] = "periodic motion"

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.system.coordinates

    @property
    def phase(self) -> Array:
        """Phases (m+1,) of the nodes in rad, including both ends of the period."""
        return self.curve.nodes

    @property
    def time(self) -> Array:
        """Times (m+1,) of the nodes in s."""
        return self.phase / self.speed

    @property
    def q(self) -> Array:
        """Coordinates (n, m+1) at the nodes."""
        return self._nodal[0]

    @property
    def qd(self) -> Array:
        """Velocities (n, m+1) at the nodes (derivatives with respect to time)."""
        return self._nodal[1]

    @property
    def qdd(self) -> Array:
        """Accelerations (n, m+1) at the nodes (derivatives with respect to time). At a jump of the matrices,
        the array contains the accelerations just after the jump."""
        return self._nodal[2]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the first-order states, which are the last coordinates."""
        return tuple(self.system.states)

    @property
    def x(self) -> Array:
        """First-order states (N, m+1) at the nodes."""
        return self.q[len(self.coordinates) - len(self.states) :]

    @property
    def xd(self) -> Array:
        """Rates (N, m+1) of the first-order states at the nodes (derivatives with respect to time)."""
        return self.qd[len(self.coordinates) - len(self.states) :]

    @cached_property
    def _nodal(self) -> tuple[Array, Array, Array]:
        states = self.state(self.phase[:-1])
        q, qd, qdd = (np.concatenate((values, values[:, :1]), axis=1) for values in states)
        return q, qd, qdd

    @matches_annotations
    def at(self, phase: float | Array) -> Array:
        """Coordinates (n, k) at phases (k,).

        Parameters
        ----------
        phase : float or (k,) array
            Phases in rad, also outside one period.

        Returns
        -------
        (n, k) array
            Coordinates in SI units.

        Raises
        ------
        ValueOutOfBoundsError
            If a phase is NaN or infinite, or the array has several dimensions.
        """
        return self.curve(finite_phases(phase))

    @stored_property
    def outputs(self) -> Mapping[str, Array]:
        """Mapping from the names of outputs to their values (m+1,) at the nodes."""
        return dict(output_values(self.system, self.phase, self.speed, self.q, self.qd, self.qdd))

    @stored_property
    def residual(self) -> float:
        """Largest residual of the equation of motion at the midpoints of the steps, relative to the largest
        term of the same equation over the period."""
        phase = (self.phase[:-1] + self.phase[1:]) / 2
        return equation_residual(self.system, self.speed, phase, self.state(phase))

    @stored_property
    def linearisation_error(self) -> Mapping[str, float] | None:
        """Estimated maximum difference between the linear and the nonlinear orbit for each coordinate,
        relative to the coordinate's scale.

        The scale (see `solve.certify.correction`) is max|q| unless the forces on the coordinate cancel. The
        estimate is the size of one correction of Newton's method on the same grid. A small estimate is
        accurate. The estimate is NaN if the correction has no solution. The result is None for linear
        systems.
        """
        if not is_nonlinear(self.system):
            return None
        certified = self.certified
        grid, engine = certified.solutions.grid, certified.request.engine
        sizes = linearisation_error(self.system, self.curve, self.speed, certified.method, grid, engine)
        return dict(zip(self.coordinates, sizes.tolist(), strict=True))

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the accuracy, and about quantities that violate the bounds of the model, one
        sentence each."""
        system = self.system
        names = {*judged_quantities(system), *(() if system.labels.outputs_apart else system.outputs)}
        figures = {name: self.statistics(name) for name in sorted(names)}
        return [*super().warnings, *exceeded_limits(system, figures), *self._non_periodic_outputs]

    @property
    def _non_periodic_outputs(self) -> list[str]:
        """Warnings about outputs that change by a constant per period, such as unlimited angles."""
        system, phase = self.system, self.system.period * np.array([0.137, 0.281, 0.618])
        if system.labels.outputs_apart or not system.labels.solvable:
            return []
        state, texts = self.state(phase), []
        now, later = (
            output_values(system, start, self.speed, *state) for start in (phase, phase + system.period)
        )
        for name, values in now.items():
            change = later[name] - values
            same = np.abs(change - change[0]) <= _EQUAL_CHANGES * np.abs(change[0])
            if same.all() and abs(change[0]) > _EQUAL_CHANGES * np.abs(values).max():
                texts.append(
                    f"{name} is not periodic: it changes by {change[0]:.3g} per period, and its statistics "
                    "are meaningless; for an angle modulo 2π write wrapped(...) in the mechanism"
                )
        return texts

    @property
    def summary(self) -> str:
        """Sentence on the verdict and the largest absolute values of the coordinates."""
        units, names = self.system.labels.units, self.coordinates[:MOST_SHOWN]
        largest = ((name, abs(self.statistics(name).max_abs)) for name in names)
        maxima = [f"max|{greek(name)}| = {measured(size, units.get(name, ''))}" for name, size in largest]
        more = len(self.coordinates) - len(maxima)
        others = f" and {more} more coordinates" if more > 0 else ""
        return f"{super().summary} Over one period {', '.join(maxima)}{others}.{self._linearisation_text}"

    @property
    def _linearisation_text(self) -> str:
        """Sentence on the linearisation error; empty for linear systems."""
        errors = (self.linearisation_error or {}).values()
        if not errors:
            return ""
        return f" Estimated linearisation error: {linearisation(max(errors))}."

    @matches_annotations
    def record(self, harmonics: int = 60, quasi_static: bool = False) -> dict[str, Any]:
        """JSON object of `solve periodic --json`, with the amplitudes of `harmonics` harmonics of each
        quantity, in addition to its mean."""
        further = {"quasi_static": self.quasi_static.curve_record(harmonics)} if quasi_static else {}
        return {**super().record(), **to_json({**self.curve_record(harmonics), **further})}

    @property
    def summary_values(self) -> dict[str, Any]:
        error = self.linearisation_error
        further = {} if error is None else {"linearisation_error": error}
        return {**super().summary_values, "residual": self.residual, **further}

    def header_rows(self) -> HeaderRows:
        if self.linearisation_error is None:
            return super().header_rows()
        errors = self.linearisation_error
        if max(errors.values()) <= ROUND_OFF:
            text = "nonlinear orbit is the same up to round-off"
        else:
            texts = (f"{name} {100 * error:.2g} %" for name, error in errors.items())
            text = f"nonlinear orbit differs by about {', '.join(texts)}"
        return [*super().header_rows(), ("linearised", text)]

    def _accuracy(self) -> tuple[list[str], list[str]]:
        errors, checks = super()._accuracy()
        errors = [f"orbit {self.error_estimate.orbit:.1e}", *errors, f"residual {self.residual:.1e}"]
        return errors, [*checks, f"condition {self.condition:.0e}"]

    def file_contents(self) -> FileContents:
        """Columns of time, phase, coordinates, outputs and rates at the nodes, and of the multipliers.

        Files .npz and .mat contain phase and time (m+1,); q, qd and qdd (n, m+1), with the names
        `coordinates`; output_values (k, m+1), with the names `outputs`; complex multipliers and exponents;
        and metadata (JSON). Raises ValueOutOfBoundsError if two columns have the same name.
        """
        system, stability, outputs = self.system, super().file_contents(), self.outputs
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
                unit = system.labels.units.get(name, "")
                rate = Column(values, unit and unit + per, f"{word} of {name}", axes=("phase",))
                rates.append((name + suffix, rate))
        rates += stability.columns.items()
        columns_by_name([*curves, *rates])
        return FileContents(dict(curves), dict(rates), stability.metadata, {**arrays, **stability.arrays})

    @matches_annotations
    def plot(
        self,
        names: Sequence[str] | None = None,
        quasi_static: bool = False,
        scale: str = "linear",
        harmonics: int | None = None,
    ) -> Figure:
        """Figure with the curve over one period and the spectrum of each quantity, and with the multipliers.

        Parameters
        ----------
        names : sequence of str, optional
            Coordinates and outputs; by default the first coordinates.
        quasi_static : bool
            Whether to draw the quasi-static response for comparison.
        scale : {"linear", "dB"}
            Scale of the spectra; 0 dB is the largest amplitude.
        harmonics : int, optional
            Highest harmonic; by default the last visible one.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        return super().plot(names, quasi_static, scale, harmonics)
