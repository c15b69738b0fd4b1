"""Statement of a mechanism by its user: energies, forces and motions."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import sympy
from sympy.core.relational import StrictGreaterThan, StrictLessThan

from derive.declarations import (
    AROUND,
    METRE,
    Condition,
    Option,
    Sketch,
    highest_mode,
    note,
    require_result,
    scalar,
    sketch_of,
)
from derive.errors import DeclarationError
from derive.field import Field
from derive.functions import Loop, four_bar, full_turn
from derive.quantities import Quantities
from derive.symbols import PHASE, SPEED, Moving
from derive.units import require_coherent, short

_ENERGIES = ("kinetic", "potential", "dissipation")


@dataclass(slots=True)
class MechanismStatement(Quantities):
    """Statement of a mechanism; `derive.Mechanism` describes it and adds the generated code."""

    energy: str = "J"
    kinetic: sympy.Expr = sympy.S.Zero
    potential: sympy.Expr = sympy.S.Zero
    dissipation: sympy.Expr = sympy.S.Zero
    period: sympy.Expr = 2 * sympy.pi
    damping_ratio: Any = sympy.S.Zero
    forces: list[tuple[sympy.Expr, sympy.Expr]] = field(default_factory=list, init=False)
    fundamental_motion: dict[Moving, sympy.Expr] = field(default_factory=dict, init=False)
    limits: list[tuple[str, str, str]] = field(default_factory=list, init=False)
    validity: dict[str, float] = field(default_factory=dict, init=False)
    declared_sketches: list[Sketch] = field(default_factory=list, init=False)
    conditions: list[Condition] = field(default_factory=list, init=False)
    no_drive_torque: str = field(default="", init=False)

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute. An energy may also be a matrix with a single entry. The source line of the
        assignment of an energy or of the damping ratio is recorded."""
        object.__setattr__(self, name, scalar(name, value) if name in _ENERGIES else value)
        if name in (*_ENERGIES, "damping_ratio") and hasattr(self, "lines"):
            for each in value if isinstance(value, tuple | list) else [getattr(self, name)]:
                note(self.lines, each)

    @property
    def phase(self) -> sympy.Symbol:
        """Angle φ = Ωt of the drive, rad."""
        return PHASE

    @property
    def speed(self) -> sympy.Symbol:
        """Constant speed Ω of the drive, rad/s."""
        return SPEED

    @property
    def around(self) -> sympy.Symbol:
        """Angle from 0 to 2π along a closed curve of a `sketch`."""
        return AROUND

    @property
    def metre(self) -> sympy.Symbol:
        """Unit 1 m, for lengths that occur only in a `sketch`: `0.2 * metre`."""
        return METRE

    def require(self, condition: Any, meaning: str) -> None:
        """State an inequality that the parameters must satisfy.

        Parameters
        ----------
        condition : sympy relation
            `left < right` or `left > right`, where both sides are expressions of parameters.
        meaning : str
            Error message if the condition does not hold.

        Raises
        ------
        DeclarationError
            If the condition is of another form, or never holds.
        """
        if condition in (sympy.true, sympy.false):
            if not condition:
                raise DeclarationError(f"{self.name}: {meaning}")
            return
        if not isinstance(condition, StrictLessThan | StrictGreaterThan) or not meaning:
            raise DeclarationError(
                f"require({condition}, {meaning!r}): give an inequality with < or > between expressions of "
                "parameters, and a string that states what is wrong if it does not hold"
            )
        text = re.sub(r"Abs\(([^()]*)\)", r"|\1|", str(condition))
        greater: Any = condition.gts
        self._condition(text, meaning, greater - condition.lts, condition.free_symbols)

    def four_bar(
        self,
        coupler_angle: str,
        follower_angle: str,
        *,
        crank: Any,
        coupler: Any,
        follower: Any,
        ground: Any,
        tilt: Any = 0,
        angle: Any = PHASE,
        side: Any = 1,
    ) -> tuple[Any, Any]:
        """Return the directions of coupler and follower of a planar four-bar linkage.

        Lengths and angle may vary with time. If the crank cannot make a full turn with the values of the
        parameters, loading the model raises an error.

        Parameters
        ----------
        coupler_angle, follower_angle : str
            Names of the directions: from crank pin to joint, and from the follower's pivot to the joint.
        crank, coupler, follower, ground : expression
            Lengths, m.
        tilt : expression, default 0
            Inclination of the ground line, rad.
        angle : expression, default phase
            Rotation of the crank about the origin, rad.
        side : expression, default 1
            +1 if the joint lies on the left of the line from crank pin to pivot, −1 if it lies on the right.

        Returns
        -------
        tuple of two expressions
            Directions of coupler and follower, rad.
        """
        links = {
            "angle": angle, "crank": crank, "coupler": coupler, "follower": follower,
            "ground": ground, "tilt": tilt,
        }  # fmt: skip
        for condition in full_turn(crank, coupler, follower, ground):
            self.require(condition, "the crank cannot turn fully")
        phi3, phi4 = self._loop(four_bar((coupler_angle, follower_angle), links, side))
        return phi3, phi4

    def loop(
        self,
        unknowns: Mapping[str, str],
        driven_by: Sequence[Any],
        closure: Callable[..., Sequence[Any]],
        start: Callable[..., Sequence[Any]],
        iterations: int = 8,
    ) -> tuple[Any, ...]:
        """Return the unknowns of a closed loop, to be computed by Newton's method.

        The initial guess selects the assembly configuration. If the loop is not closed after `iterations`
        steps at some phase, loading the model with values of the parameters raises an error.

        Parameters
        ----------
        unknowns : dict of str to str
            Names and units.
        driven_by : sequence of expressions
            Arguments of the loop, such as the phase.
        closure : callable
            `closure(*driven_by, *unknowns)` returns one expression per unknown, all of which vanish in a
            closed loop.
        start : callable
            `start(*driven_by)` returns an initial guess for each unknown.
        iterations : int, default 8
            Steps of Newton's method.

        Returns
        -------
        tuple of expressions
            The unknowns as functions of `driven_by`.

        Raises
        ------
        DeclarationError
            If the numbers of equations, guesses and unknowns differ.
        """
        given = tuple(sympy.Dummy(f"given{k}", real=True) for k in range(1, len(driven_by) + 1))
        symbols = tuple(sympy.Symbol(name, real=True) for name in unknowns)
        equations, guess = (
            tuple(map(sympy.sympify, each)) for each in (closure(*given, *symbols), start(*given))
        )
        if not len(equations) == len(guess) == len(symbols) > 0 or not given or iterations < 1:
            raise DeclarationError(
                f"loop of {', '.join(unknowns) or 'nothing'}: equations {len(equations)}, guesses "
                f"{len(guess)}, arguments {len(given)}, iterations {iterations}; give one equation and one "
                "guess per unknown, and at least one unknown, one argument and one iteration"
            )
        arguments = tuple(map(sympy.sympify, driven_by))
        loop = Loop(symbols, tuple(unknowns.values()), given, arguments, equations, guess, iterations)
        functions = self._loop(loop)
        meaning = f"the loop of {loop} does not close at every phase"
        for margin in loop.margins:
            self._condition(f"gap of {loop} < 1e-9", meaning, margin, set(loop.parameters))
        return functions

    def field(
        self,
        name: str,
        unit: str,
        meaning: str,
        *,
        length: Any,
        shape: Callable[[Any, Any], Any],
        modes: Option,
        coordinates: str = "q",
    ) -> Field:
        """Declare a deflection along an elastic link as a sum of mode functions.

        The amplitudes of the modes become the coordinates q1, q2, ….

        Parameters
        ----------
        name, unit, meaning : str
            Name, unit and meaning of the deflection.
        length : expression
            Length of the link, m.
        shape : callable
            `shape(k, xi)` returns mode function k = 1, 2, … at xi = x/length: a sum of powers of xi times
            sines and cosines of π(ak + c) xi with an integer a.
        modes : Option
            Option whose value is the number of modes.
        coordinates : str, default "q"
            Prefix of the names of the coordinates.

        Returns
        -------
        Field

        Raises
        ------
        DeclarationError
        """
        if self.declared_field or self.declared_coordinates:
            raise DeclarationError(
                f"{name}: a mechanism with a field has no other coordinates and no second field"
            )
        numbers = range(1, highest_mode(name, shape, modes) + 1)
        self._described(name, (unit, meaning))
        declared = Field(name, unit, meaning, sympy.sympify(length), shape, modes.name)
        for symbol in declared.symbols:
            self._require_unused_moving(symbol)
        amplitudes = {f"{coordinates}{k}": (unit, f"{meaning}: amplitude of mode {k}") for k in numbers}
        self.coordinates(**amplitudes)
        self.declared_field = declared
        return declared

    def force(self, force: Any, along: Any) -> None:
        """Add a force by its virtual work, `force` times the virtual displacement δ`along`.

        Parameters
        ----------
        force, along : expression or matrix
            A force and a displacement, or a torque and an angle. Two matrices have the same shape and are
            multiplied entry by entry.

        Raises
        ------
        DeclarationError
            If only one argument is a matrix, or if the shapes of two matrices differ.
        """
        F, y = sympy.sympify(force), sympy.sympify(along)
        vectors = [isinstance(each, sympy.MatrixBase) for each in (F, y)]
        if any(vectors) and not (all(vectors) and F.shape == y.shape):
            raise DeclarationError(
                f"force {short(F)} along {short(y)}: give two numbers, or two vectors of one shape"
            )
        for force, along in zip(F, y, strict=True) if all(vectors) else [(F, y)]:
            self.forces.append((force, along))
            note(self.lines, force * along)
            note(self.lines, along)

    def fundamental(self, **motions: sympy.Expr) -> None:
        """State the fundamental motion of coordinates as functions of the phase: `q1=expression`.

        In generated functions these coordinates are relative to the fundamental motion.
        """
        symbols = {coordinate.symbol.name: coordinate.symbol for coordinate in self.declared_coordinates}
        for name, motion in motions.items():
            self._require_coordinate(name, "fundamental motion")
            self.fundamental_motion[symbols[name]] = sympy.sympify(motion)

    def sketch(self, name: str, points: Sequence[Sequence[Any]], unit: str = "m") -> None:
        """Declare a line of the figure of the mechanism; it has no effect on the equations.

        Parameters
        ----------
        name : str
            Name of the line.
        points : sequence of pairs
            Points (x, y) in the plane of motion, as expressions in the phase, the speed, the coordinates and
            the parameters. Write a length that is not a parameter as a number times `metre`. A single point
            that contains `around` describes a closed curve, such as the profile of a cam. The result of
            `Field.line` describes a beam.
        unit : str, default "m"
            Unit of the points.

        Raises
        ------
        DeclarationError
        """
        require_result(name)
        require_coherent(f"sketch {name}", unit)
        if name in {declared.name for declared in self.declared_sketches}:
            raise DeclarationError(f"sketch {name} is declared twice")
        other_units = {declared.unit for declared in self.declared_sketches} - {unit}
        if other_units:
            raise DeclarationError(
                f'sketch {name} is in "{unit}", other sketches in "{other_units.pop()}"; give all sketches '
                "the same unit"
            )
        local = self.declared_field.local if self.declared_field else set()
        self.declared_sketches.append(sketch_of(name, points, unit, local))
        for number in self.declared_sketches[-1].numbers:
            note(self.lines, number)

    def limit(self, output: str, bound: str, beyond: str) -> None:
        """State a bound on an output; the model is valid only within it.

        Parameters
        ----------
        output : str
            Name of a declared output, or "drive_torque".
        bound : str
            Bound, such as ">= 0" or "> -1, < 1".
        beyond : str
            Consequence of a violated bound, as text for the warning.

        Raises
        ------
        DeclarationError
        """
        *_, bound = self._described(output, ("1", beyond, bound))
        if not bound or "integer" in bound:
            raise DeclarationError(f'limit: {output} requires a bound such as ">= 0" or "> -1, < 1"')
        names = ["drive_torque", *(declared.name for declared in self.declared_outputs)]
        if output not in names:
            raise DeclarationError(f"limit: {output} is not an output; declared: {', '.join(names)}")
        self.limits.append((output, bound, beyond))

    def trust(self, **bounds: float) -> None:
        """Declare the largest |coordinate| up to which the linear model is valid, such as `q1=0.05`. Raises
        DeclarationError."""
        for name, bound in bounds.items():
            self._require_coordinate(name, "trust")
            if not (isinstance(bound, Real | sympy.Expr) and 0 < bound < float("inf")):
                raise DeclarationError(f"trust: {name}={bound!r}; the bound must be a positive number")
            self.validity[name] = float(bound)

    @property
    def damping_ratios(self) -> tuple[sympy.Expr, ...]:
        """Damping ratios of the modes in order of increasing frequency; empty if all are 0.

        The last one applies to all higher modes.

        Raises DeclarationError.
        """
        stated: Any = self.damping_ratio
        ratios = stated if isinstance(stated, tuple | list) else (stated,)
        try:
            expressions = tuple(sympy.sympify(ratio, strict=True) for ratio in ratios)
        except sympy.SympifyError:
            expressions = ()
        if not expressions or not all(isinstance(expression, sympy.Expr) for expression in expressions):
            raise DeclarationError(
                f"damping_ratio is {stated!r}; give a number or an expression, or a list with one per mode"
            )
        return expressions if any(expression != 0 for expression in expressions) else ()

    def decline_drive_torque(self, reason: str) -> None:
        """Remove the drive torque from the outputs.

        reason: text that states why the energies do not determine the drive torque.
        """
        self.no_drive_torque = reason

    def _loop(self, loop: Loop) -> tuple[Any, ...]:
        for unknown in loop.unknowns:
            self._require_unused(unknown.name)
        self.declared_loops.append(loop)
        return loop.at(loop.arguments)

    def _condition(self, text: str, meaning: str, margin: Any, symbols: set[Any]) -> None:
        concerned = [
            parameter.symbol.name for parameter in self.declared_parameters if parameter.symbol in symbols
        ]
        self.conditions.append(Condition(text, meaning, margin, tuple(concerned)))
