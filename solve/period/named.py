"""Quantities selected by name, with the same grammar in all commands.

NAME.FIGURE of a coordinate or output, such as q3.max_abs or contact_force.harmonic5; spectral_radius; rho1,
exponent1 and their parts, such as rho1.re."""

import re
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.errors import UnknownNameError, ValueOutOfBoundsError, require_name
from solve.period.quantities import FIGURES
from solve.system import PeriodicSystem, multiplier_count

HARMONIC, PHASE = "harmonic", "phase"
"""Names for the amplitude and the phase angle of a harmonic. The number of the harmonic follows, as in
harmonic3."""

RHO, EXPONENT, RADIUS = "rho", "exponent", "spectral_radius"
_PARTS = {RHO: ("re", "im", "abs"), EXPONENT: ("re", "im")}
_NUMBERED = re.compile(r"([a-z_]+?)([0-9]+)")


class OneByOne(Protocol):
    """Protocol of Floquet multipliers that are computed one at a time."""

    def multiplier(self, at: int) -> complex: ...

    def logarithm(self, at: int) -> complex: ...


class Solved(Protocol):
    """Solution from which quantities are computed: an orbit, or a stability result for quantities of
    multipliers."""

    @property
    def spectrum(self) -> OneByOne: ...

    @property
    def period(self) -> float: ...

    @property
    def spectral_radius(self) -> float: ...

    def statistics(self, name: str) -> Statistics: ...

    def harmonics(self, name: str, count: int = 60) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class Named:
    """Quantity selected by its name.

    subject: a coordinate or output, RHO, EXPONENT or RADIUS. figure: a field of `Statistics`, HARMONIC or
    PHASE; for multipliers and exponents "re", "im" or "abs", or "" for the complex number. number: number of
    the harmonic, or position of the multiplier, counted from 1."""

    text: str
    unit: str
    subject: str
    figure: str = ""
    number: int = 0

    @classmethod
    def parse(cls, system: PeriodicSystem, text: str) -> "Named":
        """Quantity of a system from its name. Raises UnknownNameError, ValueOutOfBoundsError."""
        subject, dot, figure = text.partition(".")
        known = (*system.coordinates, *system.outputs)
        if subject in known:
            return cls._of_turn(system, text, subject, figure)
        if text == RADIUS:
            return cls(text, "1", RADIUS)
        found = _NUMBERED.fullmatch(subject)
        if found is None or found[1] not in _PARTS:
            examples = [RADIUS, f"{RHO}1.abs", f"{EXPONENT}1.re", *(f"{name}.max_abs" for name in known)]
            raise UnknownNameError(f"quantity of {system.labels.name}", text, examples)
        kind, number = found[1], int(found[2])
        if dot:
            require_name(f"part of {subject}", figure, _PARTS[kind])
        if not 1 <= number <= multiplier_count(system):
            raise ValueOutOfBoundsError(
                f"'{text}': {system.labels.name} has the multipliers 1 to {multiplier_count(system)}, in "
                "order "
                "of decreasing modulus"
            )
        return cls(text, "1" if kind == RHO else "1/s", kind, figure, number)

    @classmethod
    def _of_turn(cls, system: PeriodicSystem, text: str, subject: str, figure: str) -> "Named":
        unit = system.labels.units.get(subject, "")
        if not figure:
            raise ValueOutOfBoundsError(f"'{text}' names no statistic; add one, such as {text}.max_abs")
        found = _NUMBERED.fullmatch(figure)
        if found is not None and found[1] in (HARMONIC, PHASE):
            return cls(text, unit if found[1] == HARMONIC else "rad", subject, found[1], int(found[2]))
        require_name(f"figure of {subject}", figure, [*FIGURES, f"{HARMONIC}1", f"{PHASE}1"])
        return cls(text, "rad" if figure.endswith("_phase") else unit, subject, figure)

    @property
    def of_orbit(self) -> bool:
        """Whether the quantity requires the orbit."""
        return self.subject not in (RHO, EXPONENT, RADIUS)

    def value(self, solved: Solved) -> float | complex:
        """Value of the quantity for a solution."""
        if self.subject == RADIUS:
            return solved.spectral_radius
        if self.figure in (HARMONIC, PHASE):
            return float(solved.harmonics(self.subject, self.number)[self.figure == PHASE][self.number])
        if self.of_orbit:
            return float(getattr(solved.statistics(self.subject), self.figure))
        spectrum, at = solved.spectrum, self.number - 1
        of_rho = self.subject == RHO
        return self.part(
            np.array(spectrum.multiplier(at) if of_rho else spectrum.logarithm(at) / solved.period)
        )

    def part(self, number: Any) -> Any:
        """Requested part (such as the real part) of a complex number or of each element of an array."""
        return {"": np.asarray, "re": np.real, "im": np.imag, "abs": np.abs}[self.figure](number)[()]
