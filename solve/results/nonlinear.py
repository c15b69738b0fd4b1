"""The periodic solution of nonlinear equations, with the linear one beside it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.certify.correction import corrected
from solve.errors import SolveError, ValueOutOfBoundsError
from solve.period.curve import Curve, PeriodicCurve
from solve.period.quantities import repeats_early
from solve.results.contents import Facts
from solve.results.orbit import Orbit, QuasiStatic


@dataclass(frozen=True)
class NonlinearOrbit(Orbit):
    """The periodic solution of r(φ, Ω, q, q̇, q̈) = 0 over `periods` periods; its system is the linearisation
    along it.

    iterations: corrections of Newton's method on the grid where it was found. found_by: "start", "linear
    orbit", "load", "speed" or "transient". failed: in words, how far other ways came before. settled: False
    where a transient from rest settles on no orbit.
    """

    _calculated: ClassVar[tuple[str, ...]] = (*Orbit._calculated, "linear")
    iterations: int = 0
    found_by: str = ""
    failed: tuple[str, ...] = ()
    periods: int = 1
    settled: bool = True

    @cached_property
    def linearisation_error(self) -> None:
        """None: this orbit is that of the nonlinear equations."""
        return None

    @cached_property
    def notes(self) -> list[str]:
        return [*super().notes, *self.failed]

    @property
    def quasi_static(self) -> QuasiStatic:
        """Refused: raises ValueOutOfBoundsError."""
        raise ValueOutOfBoundsError(
            "the quasi-static solution is one of the linear model; leave out --quasi-static or --nonlinear"
        )

    @cached_property
    def linear(self) -> PeriodicCurve | None:
        """The linear orbit on the same grid; None where there is none."""
        grid, method = self.certified.solutions.grid, self.certified.method
        rest = Curve(grid.nodes, np.zeros((self.system.n, grid.steps, 1)))
        try:
            curve = corrected(
                self.system, rest, self.speed, method, grid, self.certified.request.engine
            ).curve
        except SolveError:
            return None
        return None if curve is None else curve[0]

    @cached_property
    def warnings(self) -> list[str]:
        """What is doubtful about this result, a sentence each."""
        return [*super().warnings, *self.doubts]

    @cached_property
    def doubts(self) -> list[str]:
        """Whether this is the orbit that was asked for, a sentence each where it may not be."""
        found = []
        if self.periods > 1 and repeats_early(self.curve, self.periods):
            found.append(
                f"the orbit repeats after each of its {self.periods} periods: it is one of period T; another "
                "needs another start"
            )
        if not self.settled:
            found.append(
                "a transient from rest does not settle on an orbit of this period: there may be no stable one"
            )
        return found

    @property
    def summary(self) -> str:
        return f"By the nonlinear equations: {super().summary.replace('At', 'at', 1)}"

    @property
    def whole(self) -> dict[str, Any]:
        found = {name: getattr(self, name) for name in ("iterations", "found_by", "periods")}
        return {**super().whole, **found}

    def facts(self) -> Facts:
        found = f"by {self.found_by}, {self.iterations} corrections of Newton's method"
        return [*super().facts(), ("found", found)]

    def linear_values(self, name: str, phase: Array) -> Array | None:
        """A coordinate or output (k,) of the linear orbit at phases (k,); None where there is none."""
        if self.linear is None:
            return None
        q, v, a = (self.linear(phase, derivative) for derivative in range(3))
        if name in self.system.coordinates:
            return q[self.system.coordinates.index(name)]
        if not self.system.solvable:
            return None
        return self.system.output_values(phase, self.speed, q, self.speed * v, self.speed**2 * a)[name]
