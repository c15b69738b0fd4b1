"""What is asked of points, and their solutions with their estimated errors."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import SolveError
from solve.methods.method import Method, Solutions
from solve.period.frozen import Frozen
from solve.period.multipliers import KNOWN_ON_CIRCLE, STABLE, UNDETERMINED, verdicts
from solve.period.points import Points

NEAR_ONE = 1e-3
"""Distance of a multiplier from +1 below which the height of a response deserves a warning."""


@dataclass(frozen=True)
class Request:
    """What is asked of points: `steps`, or as many as `rtol` needs; with `orbit` the periodic solutions.

    witness: a method for any system, with which errors of a reduction are estimated. reference: from points
    to converging methods, with which approximations are compared.
    """

    orbit: bool
    rtol: float
    steps: int | None
    engine: str
    witness: Method
    reference: Callable[[Points], Iterator[tuple[Method, Array]]]


class ReductionError(NamedTuple):
    """What a reduction changes, estimated.

    modes: retained modes a link. coordinates, full: their number with and without the reduction.
    discarded: lowest frequency of the discarded modes in rad/s. orbit: the largest max|error|/max|q| of
    all coordinates of the full system, NaN without an orbit. multipliers: the largest |error| divided by
    the spectral radius. spectral_radius: that of the dominant multiplier. outputs: max|error|/max|output|
    of each. NaN where there is no estimate.
    """

    modes: int
    coordinates: int
    full: int
    discarded: float
    orbit: float
    multipliers: float
    spectral_radius: float
    outputs: Mapping[str, float]

    @property
    def parts(self) -> list[str]:
        """The errors in words, of the outputs the largest."""
        parts = [] if math.isnan(self.orbit) else [f"orbit {self.orbit:.1e}"]
        parts.append(f"multipliers {self.multipliers:.1e}")
        if self.outputs:
            worst = max(self.outputs, key=lambda name: self.outputs[name])
            parts.append(f"outputs up to {self.outputs[worst]:.1e} ({worst})")
        return parts

    @property
    def warnings(self) -> list[str]:
        """A sentence, unless nothing is discarded."""
        count = f"reduce={self.modes} keeps {self.coordinates} of {self.full} coordinates"
        if self.coordinates == self.full:
            return []
        if math.isnan(self.multipliers):
            return [f"{count}: what that changes cannot be estimated at this speed; increase reduce"]
        return [f"{count}, which changes about: {', '.join(self.parts)} (relative)"]


@dataclass(frozen=True)
class Certified:
    """Points that the same method and grid served, with their estimated errors.

    positions (k,) among the points asked for; errors (k, 2) of orbit and multipliers, relative; absolute
    (k,): of the multipliers; modes: frozen ones; reduction (k,): a `ReductionError` each, or none.
    """

    positions: Array
    method: Method
    solutions: Solutions
    errors: Array
    absolute: Array
    request: Request
    modes: Frozen
    reduction: tuple[ReductionError, ...] = ()

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def steps(self) -> int:
        """Steps per period."""
        return self.solutions.grid.steps

    @cached_property
    def verdicts(self) -> Array:
        """Positions (k,) in VERDICTS, see `solve.period.multipliers.verdicts`."""
        return verdicts_of(self.solutions, self.absolute, self.modes)

    @property
    def _nothing_else(self) -> Array:
        """Points (k,) with no multipliers but those of rigid-body modes."""
        found = self.solutions
        if found.free is None:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(found.free.modes.multiplicity == found.Phi.shape[-1])

    @cached_property
    def _left_open(self) -> Array:
        """Points (k,) without a verdict though their multipliers are known well."""
        return (self.absolute <= KNOWN_ON_CIRCLE) & (self.verdicts == UNDETERMINED)

    @property
    def doubtful(self) -> Array:
        """Points (k,) that deserve a warning."""
        multipliers = self.solutions.multipliers
        found = (self.errors > self.request.rtol).any(axis=1) | (multipliers.distance_from_one < NEAR_ONE)
        found |= (
            ((multipliers.resolved == 0) & ~self._nothing_else) | self._left_open | bool(self.method.warnings)
        )
        if self.request.steps is not None and not self.method.l_stable:
            found |= ~self.modes.within(self.steps * self.method.follows / self.modes.period)
        return found

    def warnings(self, at: int) -> list[str]:
        """What is doubtful about one of the points, a sentence each."""
        orbit, multipliers = map(float, self.errors[at])
        method, request, rho = self.method, self.request, self.solutions.multipliers
        parts = [("orbit", orbit), ("multipliers", multipliers)]
        warnings = list(method.warnings)
        if not rho.resolved[at] and not self._nothing_else[at]:
            parts.pop()
            warnings.append(
                "no multiplier keeps a digit in the monodromy matrix: they are so small that nothing is left "
                "of a disturbance after one turn"
            )
        missed = [f"{name} to {error:.1e}" for name, error in parts if error > request.rtol]
        if request.steps is not None or multipliers > request.rtol:
            reach = float(self.modes[np.array([at])].reach[0])
            known = request.orbit and orbit <= request.rtol
            warnings += unresolved_modes(method, reach, self.steps, orbit if known else None)
        if missed:
            where = "at the precision in reach" if request.steps is None else f"with {request.steps} steps"
            where = where if method.converges else "is an approximation that"
            warnings.append(
                f"{method.name} {where} gives the {' and the '.join(missed)} only, "
                f"not to rtol {request.rtol:g}"
            )
        near = float(rho.distance_from_one[at])
        if near < NEAR_ONE:
            # Below its error a distance is rounding, another one on each engine.
            lies = "within its error" if near <= self.absolute[at] else f"only {near:.1e}"
            warnings.append(
                f"a multiplier is {lies} from +1 (resonance or a stability boundary): "
                "the height of the response means little here"
            )
        if self._left_open[at]:
            lost = rho.values.shape[-1] > rho.resolved[at]
            known = max(float(self.absolute[at]), float(rho.bound[at]) if lost else 0.0)
            warnings.append(
                f"some multipliers lie on the unit circle, or meet there, within their error ({known:.1e}): "
                "whether the motion stays bounded or grows with time is not known"
            )
        return warnings


def verdicts_of(solutions: Solutions, errors: Array, modes: Frozen) -> Array:
    """Positions (P,) in VERDICTS of the motion without rigid-body modes, see `verdicts`; "stable" where there
    is no other."""
    found = verdicts(solutions.Phi, solutions.multipliers, errors, modes)
    if solutions.free is None:
        return found
    return np.where(solutions.free.modes.multiplicity == solutions.Phi.shape[-1], STABLE, found)


@dataclass(frozen=True)
class Failed:
    """Why a point has no solution, at its position."""

    position: int
    reason: SolveError


def unresolved_modes(method: Method, reach: float, steps: int, orbit: float | None = None) -> list[str]:
    """A warning where the method keeps modes that its steps do not resolve; reach: ω_max T; orbit: its error,
    where that is known to be small."""
    if method.l_stable or reach <= steps * method.follows:
        return []
    enough = f", or at least {math.ceil(reach / method.follows)} steps" if method.converges else ""
    right = "" if orbit is None else f" though the orbit is right to {orbit:.1e}"
    return [
        f"ω_max h = {reach / steps:.2g}: {steps} steps leave stiff modes unresolved, and "
        f"{method.name} neither follows nor damps them: the multipliers may be false{right}; "
        f"use radau{enough}"
    ]
