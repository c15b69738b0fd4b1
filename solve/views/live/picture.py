"""Solution for the current positions of the sliders, converted to data for the page."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.certify.coefficients import require_load
from solve.errors import NoLoadError
from solve.model.model import Model
from solve.newton.orbits import nonlinear
from solve.newton.transients import transient
from solve.results.contents import DEGREES
from solve.results.formatting import greek, measured, prefixed
from solve.results.orbit import Orbit
from solve.results.special_orbits import RigidOrbit
from solve.results.transient import Transient
from solve.single import periodic
from solve.views.animation import FREE_TURNS
from solve.views.orbit import VISIBLE
from solve.views.panels import DRAWN_RTOL

_HARMONICS = 60
_DIGITS = 5
"""Number of significant digits of points of curves, sufficient because a panel has fewer than 1e4 pixels."""


@dataclass(frozen=True)
class Solution:
    """Orbit for the current positions of the sliders and, if there is no load, the free vibration from q =
    1."""

    orbit: Orbit
    free: Transient | None = None

    @property
    def span(self) -> float:
        """Last phase of the curves in rad; the first phase is 0."""
        period = self.orbit.system.period
        return period if self.free is None else FREE_TURNS * period

    def vibration(self, phase: Array) -> Array:
        """Coordinates (n, k) at phases (k,)."""
        if self.free is None:
            return self.orbit.at(phase) if self.orbit.system.labels.vibrates else np.zeros((0, len(phase)))
        return self._free_curve(phase)

    @property
    def _free_curve(self) -> Callable[[Array], Array]:
        from scipy.interpolate import CubicHermiteSpline

        free, speed = self.free, self.orbit.speed
        assert free is not None
        return CubicHermiteSpline(free.phase, free.q, free.qd / speed, axis=1)

    def curve(self, name: str, phase: Array) -> Array:
        """Values (k,) of a coordinate or output at phases (k,)."""
        if self.free is None:
            return self.orbit.signal(name)(phase)
        if name in self.orbit.coordinates:
            return self.vibration(phase)[self.orbit.coordinates.index(name)]
        return np.interp(phase, self.free.phase, self.free.outputs[name])


def solved(model: Model, speed: float, rtol: float, is_nonlinear: bool) -> Solution:
    """Solve for the orbit of a model at a speed in rad/s, and for the free vibration if there is no load.
    Raises SolveError subclasses."""
    find = nonlinear if is_nonlinear else periodic
    orbit = find(model, speed, rtol=rtol)
    if not model.labels.vibrates:
        return Solution(orbit)
    try:
        require_load(model, speed)
    except NoLoadError:
        start = np.ones(model.n), np.zeros(model.n)
        return Solution(orbit, transient(model, speed, FREE_TURNS, start, rtol=DRAWN_RTOL))
    return Solution(orbit)


def record(solution: Solution, shown: Sequence[str]) -> dict[str, Any]:
    """Return the data that are recomputed whenever a slider moves: curves and spectra of the quantities
    shown, multipliers, verdict, errors and warnings."""
    orbit = solution.orbit
    values: dict[str, Any] = {
        "span": math.degrees(solution.span),
        "period": math.degrees(orbit.system.period),
        "curves": [_curve(solution, name) for name in shown],
        "warnings": orbit.warnings,
        "free": solution.free is not None,
    }
    if isinstance(orbit, RigidOrbit):
        return {**values, "verdict": "", "errors": "", "multipliers": [], "small": 0}
    errors, multipliers = orbit.error_estimate, orbit.spectrum.leading.tolist()
    texts = [f"orbit {errors.orbit:.1e}", f"multipliers {errors.multipliers:.1e}"]
    return {
        **values,
        "verdict": orbit.verdict,
        "errors": ", ".join(texts),
        "radius": _finite(orbit.spectral_radius),
        "multipliers": [[_finite(rho.real), _finite(rho.imag)] for rho in multipliers],
        "small": 2 * orbit.system.n - len(multipliers),
    }


def details(solution: Solution) -> dict[str, Any]:
    """Return the data that take longer to compute: the sentence on the verdict and the linearisation, and the
    notes."""
    orbit = solution.orbit
    if isinstance(orbit, RigidOrbit):
        return {"summary": orbit.summary, "method": "", "notes": []}
    method = f"{orbit.described}, {orbit.steps} steps per period"
    return {"summary": orbit.summary, "method": method, "notes": orbit.notes}


def _curve(solution: Solution, name: str) -> dict[str, Any]:
    """Return the curve of a quantity and its spectrum, in a unit with a prefix."""
    orbit = solution.orbit
    phase = np.linspace(0.0, solution.span, DEGREES)
    values = solution.curve(name, phase)
    finite = values[np.isfinite(values)]
    largest = float(np.abs(finite).max()) if len(finite) else 0.0
    factor, unit = prefixed(orbit.system.labels.units.get(name, ""), largest)
    amplitudes: list[float | None] = []
    if solution.free is None:
        largest = float(orbit.statistics(name).max_abs)
        spectrum = orbit.harmonics(name, _HARMONICS)[0]
        visible = np.flatnonzero(spectrum[1:] > VISIBLE * np.nan_to_num(spectrum[1:]).max(initial=0.0))
        last = max(10, int(visible[-1]) + 2) if len(visible) else 10
        amplitudes = shortened(factor * spectrum[: last + 1])
    return {
        "name": name,
        "label": greek(name),
        "unit": unit,
        "meaning": orbit.system.labels.meanings.get(name, ""),
        "largest": measured(largest, orbit.system.labels.units.get(name, "")).removesuffix(" 1"),
        "values": shortened(factor * values),
        "spectrum": amplitudes,
    }


def shortened(values: Array) -> list[float | None]:
    """Return numbers with few digits for the page; None for NaN and infinity."""
    return [float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
