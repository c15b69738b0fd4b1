"""The problem statement that a user fills in: what a mechanism is, and nothing about methods."""

import keyword
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import sympy

from derive.errors import DeclarationError
from derive.symbols import PHASE, SPEED, Moving
from derive.transmission import PeriodicFunction, Series
from derive.units import parse

RESERVED = ("phase", "speed", "coordinates", "rates", "accelerations", "parameters", "casadi", "math")
CLAUSE = r"(integer|[<>]=? *-?[\d.]+(e-?\d+)?)"
BOUND = rf"({CLAUSE}(, *{CLAUSE})*)?"


@dataclass(frozen=True)
class Coordinate:
    symbol: Moving
    unit: str
    meaning: str


@dataclass(frozen=True)
class Parameter:
    symbol: sympy.Symbol
    unit: str
    meaning: str
    bound: str


@dataclass(frozen=True)
class Output:
    name: str
    expression: sympy.Expr
    unit: str
    meaning: str


@dataclass(frozen=True)
class Option:
    """A choice that the user of the generated module makes by name."""

    name: str
    values: tuple[str, ...]

    @property
    def indicators(self) -> tuple[sympy.Symbol, ...]:
        """One symbol a value, 1 where it is chosen and 0 elsewhere."""
        return tuple(sympy.Symbol(f"{self.name}_{value}", real=True) for value in self.values)

    def choose(self, **expressions: sympy.Expr | float) -> sympy.Expr:
        """The expression of the chosen value; DeclarationError unless each value has one."""
        if set(expressions) != set(self.values):
            raise DeclarationError(
                f"option {self.name} needs one expression for each of {', '.join(self.values)}; "
                f"given: {', '.join(expressions) or 'none'}"
            )
        chosen = zip(self.indicators, self.values, strict=True)
        return sympy.Add(*(indicator * expressions[value] for indicator, value in chosen))


@dataclass(slots=True)
class Mechanism:
    """A mechanism driven at constant speed Ω, stated by its energies.

    Everything is in coherent SI units. `kinetic` T, `potential` V and `dissipation` R
    (Rayleigh's function, half the power lost) are SymPy expressions in the coordinates, their
    rates (`derive.rate`), the parameters and `phase` φ = Ωt. `energy` is the unit of T and V,
    to be changed only for an equation without physical units.
    """

    name: str
    title: str
    energy: str = "J"
    kinetic: sympy.Expr = sympy.S.Zero
    potential: sympy.Expr = sympy.S.Zero
    dissipation: sympy.Expr = sympy.S.Zero
    period: sympy.Expr = 2 * sympy.pi
    declared_coordinates: list[Coordinate] = field(default_factory=list, init=False)
    declared_parameters: list[Parameter] = field(default_factory=list, init=False)
    declared_options: list[Option] = field(default_factory=list, init=False)
    declared_outputs: list[Output] = field(default_factory=list, init=False)
    declared_series: list[type[PeriodicFunction]] = field(default_factory=list, init=False)
    forces: list[tuple[sympy.Expr, sympy.Expr]] = field(default_factory=list, init=False)
    fundamental_motion: dict[Moving, sympy.Expr] = field(default_factory=dict, init=False)
    limits: list[tuple[str, str, str]] = field(default_factory=list, init=False)
    validity: dict[str, float] = field(default_factory=dict, init=False)
    no_drive_torque: str = field(default="", init=False)

    @property
    def phase(self) -> sympy.Symbol:
        """Angle φ = Ωt of the drive, rad."""
        return PHASE

    @property
    def speed(self) -> sympy.Symbol:
        """Constant speed Ω of the drive, rad/s."""
        return SPEED

    def coordinates(self, **declared: tuple[str, str]) -> tuple[Moving, ...]:
        """Declare coordinates as `q1=(unit, meaning)`; they vanish in the desired motion.

        Returns their symbols in the same order. Raises DeclarationError.
        """
        symbols = tuple(Moving(name) for name in declared)
        for symbol, described in zip(symbols, declared.values(), strict=True):
            unit, meaning, _ = self._described(symbol.name, described)
            for moving in (symbol, symbol.rate, symbol.rate.rate):
                self._claim(moving.name)
            self.declared_coordinates.append(Coordinate(symbol, unit, meaning))
        return symbols

    def parameters(self, **declared: tuple[str, ...]) -> tuple[sympy.Symbol, ...]:
        """Declare parameters as `k1=(unit, meaning)` or `k1=(unit, meaning, bound)`.

        A bound is text such as "> 0", ">= 0", "< 1" or "integer, >= 1"; without one any
        finite number is allowed. Returns the symbols in the same order. Raises DeclarationError.
        """
        return tuple(self._parameter(name, described) for name, described in declared.items())

    def family(
        self, name: str, indices: Iterable[int], unit: str, meaning: str, bound: str = ""
    ) -> tuple[sympy.Symbol, ...]:
        """Declare numbered parameters: `family("k", range(1, 4), …)` gives k1, k2, k3."""
        return tuple(self._parameter(f"{name}{i}", (unit, f"{meaning}, order {i}", bound)) for i in indices)

    def transmission(
        self,
        name: str,
        harmonics: int,
        unit: str,
        meaning: str = "",
        coefficients: tuple[str, str] = ("a", "b"),
    ) -> Series:
        """Declare a transmission function U by the Fourier coefficients of its derivative.

        U′(φ) = Σ aₖ cos kφ + bₖ sin kφ, chapter Eq. (65); U is the integral of zero mean.
        Declares the parameters a1, …, b1, … and returns U, to be called with an angle.
        """
        meaning = meaning or f"derivative of the transmission function {name}"
        cosine, sine = coefficients
        orders = range(1, harmonics + 1)
        return self._series(
            name,
            unit,
            first=self.family(cosine, orders, unit, f"{meaning}: cosine coefficient"),
            second=self.family(sine, orders, unit, f"{meaning}: sine coefficient"),
            form="cosine-sine",
            integrated=True,
        )

    def series(self, name: str, harmonics: int, unit: str, meaning: str, bound: str = "") -> Series:
        """Declare F(x) = F + Σ Faₖ cos kx + Fbₖ sin kx, to be called with any angle x.

        Declares the parameters F (the mean, with `bound`), Fa1, … and Fb1, ….
        """
        orders = range(1, harmonics + 1)
        return self._series(
            name,
            unit,
            mean=self._parameter(name, (unit, f"{meaning}: mean", bound)),
            first=self.family(f"{name}a", orders, unit, f"{meaning}: cosine coefficient"),
            second=self.family(f"{name}b", orders, unit, f"{meaning}: sine coefficient"),
            form="cosine-sine",
        )

    def harmonic_series(
        self,
        name: str,
        harmonics: int,
        unit: str,
        meaning: str,
        angles: str,
        mean: bool = True,
        bound: str = "",
    ) -> Series:
        """Declare k(x) = k0 + Σ kₙ cos(n x + γₙ), chapter Eq. (73), to be called with any angle x.

        Declares k1, … and the angles γ1, … (named by `angles`); with `mean` also k0, with
        `bound`, which is then `k.mean`.
        """
        orders = range(1, harmonics + 1)
        return self._series(
            name,
            unit,
            mean=self._parameter(f"{name}0", (unit, f"{meaning}: mean", bound)) if mean else None,
            first=self.family(name, orders, unit, f"{meaning}: amplitude"),
            second=self.family(angles, orders, "rad", f"{meaning}: phase angle"),
            form="amplitude-phase",
        )

    def option(self, name: str, values: tuple[str, ...]) -> Option:
        """Declare an option; the first value is its default. `Option.choose` picks expressions."""
        self._claim(name)
        if len(values) < 2 or not all(value.isidentifier() for value in values):
            raise DeclarationError(
                f"option {name} needs two or more values that are plain words; given: {values}"
            )
        option = Option(name, tuple(values))
        for indicator in option.indicators:
            self._claim(indicator.name)
        self.declared_options.append(option)
        return option

    def force(self, force: sympy.Expr | float, along: sympy.Expr) -> None:
        """Add the virtual work `force` δ`along` (a force and a displacement, or a torque and an angle)."""
        self.forces.append((sympy.sympify(force), sympy.sympify(along)))

    def fundamental(self, **motions: sympy.Expr) -> None:
        """State the desired motion of coordinates as functions of the phase: `q1=expression`.

        Generated functions then count these coordinates from the desired motion.
        """
        symbols = {each.symbol.name: each.symbol for each in self.declared_coordinates}
        for name, motion in motions.items():
            self._require_coordinate(name, "fundamental motion")
            self.fundamental_motion[symbols[name]] = sympy.sympify(motion)

    def output(self, name: str, expression: sympy.Expr, unit: str, meaning: str) -> None:
        """Declare a quantity to be computed beside the coordinates."""
        self._described(name, (unit, meaning))
        self._claim(name)
        self.declared_outputs.append(Output(name, sympy.sympify(expression), unit, meaning))

    def limit(self, output: str, bound: str, beyond: str) -> None:
        """Bound an output, such as ">= 0", and say in `beyond` what is true where it leaves the bound."""
        self._described(output, ("1", beyond, bound))
        names = ["drive_torque", *(each.name for each in self.declared_outputs)]
        if output not in names:
            raise DeclarationError(f"limit: {output} is no output; declared: {', '.join(names)}")
        self.limits.append((output, bound, beyond))

    def trust(self, **bounds: float) -> None:
        """Bound |coordinate| within which the linear model is to be believed: `q1=0.05`."""
        for name, bound in bounds.items():
            self._require_coordinate(name, "trust")
            if not 0 < bound < float("inf"):
                raise DeclarationError(f"trust: {name}={bound}; the bound must be a positive number")
            self.validity[name] = float(bound)

    def decline_drive_torque(self, reason: str) -> None:
        """State why the drive torque does not follow from the energies; it is then no output."""
        self.no_drive_torque = reason

    def _series(self, name: str, unit: str, **contents) -> Series:
        if not contents["first"]:
            raise DeclarationError(f"{name} has no harmonics; give one or more")
        series: Any = type(name, (PeriodicFunction,), {"dimension": parse(unit), **contents})
        self.declared_series.append(series)
        return series

    def _parameter(self, name: str, described: tuple[str, ...]) -> sympy.Symbol:
        unit, meaning, bound = self._described(name, described)
        self._claim(name)
        symbol = sympy.Symbol(name, real=True)
        self.declared_parameters.append(Parameter(symbol, unit, meaning, bound))
        return symbol

    def _described(self, name: str, described: tuple[str, ...]) -> tuple[str, str, str]:
        if not isinstance(described, tuple) or not 2 <= len(described) <= 3 or not all(described[:2]):
            raise DeclarationError(
                f'{name} needs a unit and a meaning, such as ("N/m", "shaft"); given: {described!r}'
            )
        unit, meaning, bound = (*described, "")[:3]
        parse(unit)
        if not re.fullmatch(BOUND, bound):
            raise DeclarationError(
                f'{name}: the bound "{bound}" is not understood; give "> 0", ">= 0", "< 1" or "integer, >= 1"'
            )
        return unit, meaning, bound

    def _claim(self, name: str) -> None:
        """Refuse a name that is reserved or taken."""
        if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name) or keyword.iskeyword(name) or name in RESERVED:
            raise DeclarationError(
                f'"{name}" cannot be a name: it is reserved, or no plain word of letters and digits'
            )
        if name in self.names():
            raise DeclarationError(
                f'"{name}" is declared twice (q, qd and qdd are a coordinate and its derivatives)'
            )

    def names(self) -> set[str]:
        """Every name that is taken, derivatives of coordinates and option values included."""
        moving = [each.symbol for each in self.declared_coordinates]
        taken = {symbol.name for q in moving for symbol in (q, q.rate, q.rate.rate)}
        taken |= {each.symbol.name for each in self.declared_parameters}
        taken |= {each.name for each in self.declared_outputs}
        for option in self.declared_options:
            taken |= {option.name, *(indicator.name for indicator in option.indicators)}
        return taken

    def _require_coordinate(self, name: str, what: str) -> None:
        names = [each.symbol.name for each in self.declared_coordinates]
        if name not in names:
            raise DeclarationError(f"{what}: {name} is no coordinate; declared: {', '.join(names) or 'none'}")
