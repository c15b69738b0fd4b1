"""Declared quantities of a mechanism: coordinates, parameters, series, options and outputs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy

from derive.body import ReducedBody, declared_body
from derive.declarations import (
    Coordinate,
    Input,
    Option,
    Output,
    Parameter,
    bound_of,
    note,
    require_plain,
    require_result,
)
from derive.errors import DeclarationError
from derive.field import Field
from derive.functions import Loop, PeriodicFunction, Series
from derive.symbols import Moving
from derive.units import parse, require_coherent


@dataclass(slots=True)
class Quantities:
    """Quantities that a mechanism declares by name."""

    name: str
    title: str
    declared_coordinates: list[Coordinate] = field(default_factory=list, init=False)
    declared_parameters: list[Parameter] = field(default_factory=list, init=False)
    declared_options: list[Option] = field(default_factory=list, init=False)
    declared_outputs: list[Output] = field(default_factory=list, init=False)
    declared_inputs: list[Input] = field(default_factory=list, init=False, repr=False)
    declared_series: list[type[PeriodicFunction]] = field(default_factory=list, init=False)
    declared_field: Field | None = field(default=None, init=False)
    declared_loops: list[Loop] = field(default_factory=list, init=False)
    declared_bodies: list[ReducedBody] = field(default_factory=list, init=False)
    lines: dict[Any, int] = field(init=False, repr=False, compare=False)
    """Mapping from expressions to the line of the mechanism file at which they are stated."""

    def __post_init__(self) -> None:
        # Lines are recorded from now on; default values of the fields have no lines.
        self.lines = {}

    def coordinates(self, **declared: tuple[str, str]) -> tuple[Moving, ...]:
        """Declare coordinates.

        A coordinate is zero in the fundamental motion, unless `fundamental` states its fundamental motion.

        Parameters
        ----------
        **declared : tuple of str
            `q1=(unit, meaning)`, with a coherent SI unit.

        Returns
        -------
        tuple of symbols
            Symbols of the coordinates, in the order of the arguments.

        Raises
        ------
        DeclarationError, UnitError
        """
        symbols = tuple(Moving(name) for name in declared)
        for symbol, described in zip(symbols, declared.values(), strict=True):
            unit, meaning, bound = self._described(symbol.name, described)
            if bound:
                raise DeclarationError(f"{symbol.name}: a coordinate has no bound; use trust(...)")
            require_coherent(symbol.name, unit)
            self._require_unused_moving(symbol)
            self.declared_coordinates.append(Coordinate(symbol, unit, meaning))
        return symbols

    def coordinate(self, name: str, unit: str, meaning: str) -> Moving:
        """Declare one coordinate and return its symbol. Raises DeclarationError."""
        (symbol,) = self.coordinates(**{name: (unit, meaning)})
        return symbol

    def parameter(self, name: str, unit: str, meaning: str, bound: str = "") -> sympy.Symbol:
        """Declare one parameter and return its symbol. Raises DeclarationError."""
        return self._parameter(name, (unit, meaning, bound))

    def parameters(self, **declared: tuple[str, ...]) -> tuple[sympy.Symbol, ...]:
        """Declare parameters.

        Parameters
        ----------
        **declared : tuple of str
            `k1=(unit, meaning)` or `k1=(unit, meaning, bound)`. The unit, which may be any unit known to
            pint, is that of the values; the generated equations convert values to SI. A bound is text such as
            "> 0", ">= 0", "< 1" or "integer, >= 1"; without a bound, any finite number is allowed.

        Returns
        -------
        tuple of symbols
            Symbols of the parameters, in the order of the arguments.

        Raises
        ------
        DeclarationError, UnitError
        """
        return tuple(self._parameter(name, described) for name, described in declared.items())

    def family(
        self, name: str, indices: Iterable[int], unit: str, meaning: str, bound: str = ""
    ) -> tuple[sympy.Symbol, ...]:
        """Declare numbered parameters: `family("k", range(1, 4), …)` returns k1, k2, k3."""
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

        Parameters
        ----------
        name, unit : str
            Name and unit of U.
        harmonics : int
            Number of harmonics.
        meaning : str, optional
            Meaning of the coefficients.
        coefficients : tuple of two str, default ("a", "b")
            Prefixes of the cosine and sine coefficients: parameters a1, …, b1, ….

        Returns
        -------
        Series
            U, to be called with an angle.

        Notes
        -----
        U′(φ) = Σ aₖ cos kφ + bₖ sin kφ, chapter Eq. (65); U is the integral with zero mean.
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
        """Declare a Fourier series with cosine and sine coefficients.

        Parameters
        ----------
        name, unit, meaning : str
            Name, unit and meaning of the series.
        harmonics : int
            Number of harmonics.
        bound : str, optional
            Bound of the mean.

        Returns
        -------
        Series
            F, to be called with an angle.

        Notes
        -----
        F(x) = F + Σ Faₖ cos kx + Fbₖ sin kx with the parameters F, Fa1, … and Fb1, ….
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
        """Declare a Fourier series with amplitudes and phase angles.

        Parameters
        ----------
        name, unit, meaning : str
            Name, unit and meaning of the series.
        harmonics : int
            Number of harmonics.
        angles : str
            Prefix of the phase angles.
        mean : bool, default True
            Whether the series k has a mean, the parameter k0; its symbol is `k.mean`.
        bound : str, optional
            Bound of the mean.

        Returns
        -------
        Series
            k, to be called with an angle.

        Notes
        -----
        k(x) = k0 + Σ kₙ cos(n x + γₙ), chapter Eq. (73), with the parameters k0, k1, … and γ1, ….
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

    def option(self, name: str, values: tuple[str, ...] | range, default: str | int | None = None) -> Option:
        """Declare an option, whose values are words or the integers of a range.

        Parameters
        ----------
        name : str
            Name of the option.
        values : tuple of str, or range
            Allowed values.
        default : str or int, optional
            Default value; by default, the first one.

        Returns
        -------
        Option
            The method `choose` of the option returns the expression that belongs to the selected word.

        Raises
        ------
        DeclarationError
        """
        require_result(name)
        self._require_unused(name)
        words = isinstance(values, tuple) and all(value.isidentifier() for value in values)
        if len(values) < 2 or not (words or isinstance(values, range)):
            raise DeclarationError(
                f"option {name} has the values {values}; give two or more words of letters, digits and "
                "_, or a range"
            )
        if default is not None and default not in values:
            raise DeclarationError(f"option {name} has no value {default}; declared: {values}")
        option = Option(name, values, values[0] if default is None else default)
        for indicator in option.indicators:
            self._require_unused(indicator.name)
        self.declared_options.append(option)
        return option

    def output(self, name: str, expression: sympy.Expr, unit: str, meaning: str) -> None:
        """Declare an output: a quantity to be computed in addition to the coordinates. Raises
        DeclarationError."""
        require_result(name)
        self._described(name, (unit, meaning))
        self._require_unused(name)
        self.declared_outputs.append(Output(name, sympy.sympify(expression), unit, meaning))
        note(self.lines, self.declared_outputs[-1].expression)

    def reduced_body(
        self,
        name: str,
        interface: Mapping[str, tuple[Any, str]],
        modes: int,
        damping: bool = False,
    ) -> ReducedBody:
        """Declare an elastic body whose matrices are computed by a finite-element program.

        The modes of the body become the coordinates `{name}1`, `{name}2`, …, and the entries of its matrices
        become parameters. The case states the file of the matrices, for example
        `blade = { file = "blade.mat", unit = "m kg s", source = "…" }`.

        Parameters
        ----------
        name : str
            Name of the body.
        interface : dict of str to (expression, str)
            Absolute displacements and small rotations of the retained degrees of freedom, in the order of the
            file, each with the unit "m" or "rad". The axes of the body must not rotate.
        modes : int
            Number of modes with the interface fixed.
        damping : bool, default False
            Whether the file has a damping matrix.

        Returns
        -------
        ReducedBody
            Its `kinetic`, `potential` and `dissipation` are to be added to the energies of the mechanism.

        Raises
        ------
        DeclarationError
        """
        body = declared_body(self, name, interface, modes, damping)
        self.declared_bodies.append(body)
        return body

    def input(self, name: str, unit: str, *, along: Any, meaning: str = "input of a controller") -> None:
        """Declare an input: a force that a controller determines and that is zero without a controller.

        Parameters
        ----------
        name : str
            Name of the input.
        unit : str
            Coherent SI unit of the force, such as "N" or "N m".
        along : expression
            Displacement or angle along which the force does work.
        meaning : str, optional
            Meaning of the force.

        Raises
        ------
        DeclarationError, UnitError
        """
        require_result(name)
        require_coherent(name, unit)
        self._described(name, (unit, meaning))
        self._require_unused(name)
        self.declared_inputs.append(Input(name, sympy.sympify(along), unit, meaning))
        note(self.lines, self.declared_inputs[-1].along)

    def names(self) -> set[str]:
        """Names in use, including those of the derivatives of coordinates and of the option indicators."""
        moving = [coordinate.symbol for coordinate in self.declared_coordinates]
        moving += self.declared_field.symbols if self.declared_field else []
        taken = {unknown.name for loop in self.declared_loops for unknown in loop.unknowns}
        taken |= {symbol.name for q in moving for symbol in q.motion}
        taken |= {parameter.symbol.name for parameter in self.declared_parameters}
        taken |= {declared.name for declared in (*self.declared_outputs, *self.declared_inputs)}
        for option in self.declared_options:
            taken |= {option.name, *(indicator.name for indicator in option.indicators)}
        return taken

    def _series(self, name: str, unit: str, **contents) -> Series:
        if not contents["first"]:
            raise DeclarationError(f"{name} has no harmonics; declare at least one")
        series: Any = type(name, (PeriodicFunction,), {"dimension": parse(unit), **contents})
        self.declared_series.append(series)
        return series

    def _parameter(self, name: str, described: tuple[str, ...]) -> sympy.Symbol:
        unit, meaning, bound = self._described(name, described)
        self._require_unused(name)
        symbol = sympy.Symbol(name, real=True)
        self.declared_parameters.append(Parameter(symbol, unit, meaning, bound))
        note(self.lines, symbol)
        return symbol

    def _described(self, name: str, described: tuple[str, ...]) -> tuple[str, str, str]:
        if not isinstance(described, tuple) or not 2 <= len(described) <= 3 or not all(described[:2]):
            raise DeclarationError(
                f'{name} requires a unit and a meaning, such as ("N/m", "shaft"); given: {described!r}'
            )
        unit, meaning, bound = (*described, "")[:3]
        parse(unit)
        return unit, meaning, bound_of(name, bound)

    def _require_unused_moving(self, symbol: Moving) -> None:
        for moving in symbol.motion:
            self._require_unused(moving.name)

    def _require_unused(self, name: str) -> None:
        """Raise DeclarationError for a name that is reserved or in use."""
        require_plain(name)
        if name in self.names():
            raise DeclarationError(
                f'"{name}" is declared twice; a coordinate q also uses the names qd and qdd'
            )

    def _require_coordinate(self, name: str, what: str) -> None:
        names = [coordinate.symbol.name for coordinate in self.declared_coordinates]
        if name not in names:
            raise DeclarationError(
                f"{what}: {name} is not a coordinate; declared: {', '.join(names) or 'none'}"
            )
