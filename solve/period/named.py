"""Quantities selected by name. All commands use the same syntax.

The name is NAME.FIGURE for a coordinate or output, such as q3.max_abs or contact_force.harmonic5. Other names
are spectral_radius, rho1 and exponent1. The real and imaginary parts of the last two are also available, for
example as rho1.re."""

import re
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from solve.arrays import Array
from solve.contracts import Statistics
from solve.errors import UnknownNameError, ValueOutOfBoundsError, require_name
from solve.period.signals import FIGURES
from solve.system import PeriodicSystem, multiplier_count

HARMONIC, PHASE = "harmonic", "phase"
"""Prefixes of the figures for the amplitude and for the phase angle of a harmonic. The number of the harmonic
follows, as in harmonic3."""

RHO, EXPONENT, RADIUS = "rho", "exponent", "spectral_radius"
_PARTS = {RHO: ("re", "im", "abs"), EXPONENT: ("re", "im")}
_NUMBERED = re.compile(r"([a-z_]+?)([0-9]+)")


class OneByOne(Protocol):
    """Protocol of a source of Floquet multipliers and their logarithms, computed one at a time."""

    def multiplier(self, at: int) -> complex: ...

    def logarithm(self, at: int) -> complex: ...


class Solved(Protocol):
    """Protocol of a solution from which quantities are computed. It is an orbit or, for quantities of
    multipliers, a stability result."""

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

    subject: name of a coordinate or output, or RHO, EXPONENT or RADIUS. figure, for coordinates and outputs:
    a field of `Statistics`, HARMONIC or PHASE. figure, for multipliers and exponents: "re", "im" or "abs", or
    "" for the complex number. number: number of the harmonic, or index of the multiplier, counted from 1."""

    text: str
    unit: str
    subject: str
    figure: str = ""
    number: int = 0

    @classmethod
    def parse(cls, system: PeriodicSystem, text: str) -> "Named":
        """Parse the name `text` of a quantity of a system. Raises UnknownNameError, ValueOutOfBoundsError."""
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
                "order of decreasing modulus"
            )
        return cls(text, "1" if kind == RHO else "1/s", kind, figure, number)

    @classmethod
    def _of_turn(cls, system: PeriodicSystem, text: str, subject: str, figure: str) -> "Named":
        unit = system.labels.units.get(subject, "")
        if not figure:
            raise ValueOutOfBoundsError(f"'{text}' contains no statistic; add one, such as {text}.max_abs")
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
        """Selected part, such as the real part, of a complex number or of each element of an array."""
        return {"": np.asarray, "re": np.real, "im": np.imag, "abs": np.abs}[self.figure](number)[()]
