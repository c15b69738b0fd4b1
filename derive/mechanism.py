"""The problem statement that a user fills in: energies, forces and motions of a mechanism, no methods."""

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
        """An energy may be a product of vectors and matrices; it is then its one entry."""
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
        """Angle from 0 to 2π by which the point of a closed curve of a `sketch` runs."""
        return AROUND

    @property
    def metre(self) -> sympy.Symbol:
        """1 m, the unit of sizes that belong to a `sketch` alone: `0.2 * metre`."""
        return METRE

    def require(self, condition: Any, meaning: str) -> None:
        """State an inequality of parameters, and in `meaning` what is wrong where it does not hold."""
        if condition in (sympy.true, sympy.false):
            if not condition:
                raise DeclarationError(f"{self.name}: {meaning}")
            return
        if not isinstance(condition, StrictLessThan | StrictGreaterThan) or not meaning:
            raise DeclarationError(
                f"require({condition}, {meaning!r}): give an inequality with < or > between expressions "
                "of parameters, and what is wrong where it does not hold"
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
        """Directions of coupler and follower of a planar four-bar linkage, from their lengths (m).

        The crank turns by `angle` about the origin, the ground line is inclined by `tilt`. The coupler's
        direction is from crank pin to joint, the follower's from its pivot to the joint. side: +1 where
        the joint lies on the left of the line from crank pin to pivot, −1 on its right. Lengths and
        angle may move. A crank that cannot turn fully is refused when numbers are given.
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
        """Unknowns of any closed loop, by Newton's method from a guess that chooses the assembly.

        unknowns: names and units. driven_by: what moves the loop, such as the phase.
        closure: expressions of driven_by and unknowns, given in this order, that vanish; as many as
        unknowns. start: a guess for each unknown from driven_by. Where the loop is not closed after
        `iterations` steps at some phase, the numbers are refused.
        """
        given = tuple(sympy.Dummy(f"given{k}", real=True) for k in range(1, len(driven_by) + 1))
        symbols = tuple(sympy.Symbol(name, real=True) for name in unknowns)
        equations, guess = (
            tuple(map(sympy.sympify, each)) for each in (closure(*given, *symbols), start(*given))
        )
        if not len(equations) == len(guess) == len(symbols) > 0 or not given or iterations < 1:
            raise DeclarationError(
                f"loop of {', '.join(unknowns) or 'nothing'} has {len(equations)} equations, {len(guess)} "
                f"guesses, {len(given)} arguments and {iterations} iterations; give an equation and a guess "
                "for each unknown, and one or more of each"
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

        shape(k, xi): mode function k = 1, 2, … of xi = x/length, a sum of sines and cosines of
        π(ak + c) xi with whole a. modes: an option of numbers, how many are taken. Declares the
        coordinates q1, q2, …, the modes' amplitudes. Raises DeclarationError.
        """
        if self.declared_field or self.declared_coordinates:
            raise DeclarationError(f"{name}: a mechanism has one field and no coordinates besides")
        if not (isinstance(modes, Option) and isinstance(modes.values, range) and modes.values[0] >= 1):
            given = getattr(modes, "values", modes)
            raise DeclarationError(
                f"{name}: modes is {given}; give an option with a range from 1 on, such as "
                'modes=mechanism.option("modes", range(1, 6))'
            )
        numbers = sympy.symbols("k xi")
        if sympy.sympify(shape(*numbers)).free_symbols != set(numbers):
            raise DeclarationError(f"{name}: the shape {shape(*numbers)} must depend on k and xi alone")
        self._described(name, (unit, meaning))
        declared = Field(name, unit, meaning, sympy.sympify(length), shape, modes.name)
        for symbol in declared.symbols:
            self._require_unused_moving(symbol)
        amplitudes = {
            f"{coordinates}{k}": (unit, f"{meaning}: amplitude of mode {k}")
            for k in range(1, modes.values[-1] + 1)
        }
        self.coordinates(**amplitudes)
        self.declared_field = declared
        return declared

    def force(self, force: Any, along: Any) -> None:
        """Add the virtual work `force` δ`along` (a force and a displacement, or a torque and an angle), or
        that of each entry of two vectors. Raises DeclarationError."""
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

        Generated functions then count these coordinates from the fundamental motion.
        """
        symbols = {each.symbol.name: each.symbol for each in self.declared_coordinates}
        for name, motion in motions.items():
            self._require_coordinate(name, "fundamental motion")
            self.fundamental_motion[symbols[name]] = sympy.sympify(motion)

    def sketch(self, name: str, points: Sequence[Sequence[Any]], unit: str = "m") -> None:
        """Draw a line through points (x, y) in the plane of motion: expressions of the phase, the speed, the
        coordinates and parameters, in `unit`. It has no effect on the equations.

        Sizes without a parameter are numbers times `metre`. One point that holds `around` runs around a
        closed curve, such as a cam's profile; the one of `Field.line` runs along a beam. Raises
        DeclarationError.
        """
        require_result(name)
        require_coherent(f"sketch {name}", unit)
        if name in {each.name for each in self.declared_sketches}:
            raise DeclarationError(f"sketch {name} is declared twice")
        others = {each.unit for each in self.declared_sketches} - {unit}
        if others:
            raise DeclarationError(f'sketch {name} is in "{unit}", others in "{others.pop()}"; give them one')
        local = self.declared_field.local if self.declared_field else set()
        self.declared_sketches.append(sketch_of(name, points, unit, local))
        for number in self.declared_sketches[-1].numbers:
            note(self.lines, number)

    def limit(self, output: str, bound: str, beyond: str) -> None:
        """Bound an output, such as ">= 0", and say in `beyond` what is true where it leaves the bound."""
        *_, bound = self._described(output, ("1", beyond, bound))
        if not bound or "integer" in bound:
            raise DeclarationError(f'limit: {output} needs a bound such as ">= 0" or "> -1, < 1"')
        names = ["drive_torque", *(each.name for each in self.declared_outputs)]
        if output not in names:
            raise DeclarationError(f"limit: {output} is no output; declared: {', '.join(names)}")
        self.limits.append((output, bound, beyond))

    def trust(self, **bounds: float) -> None:
        """Bound |coordinate| within which the linear model is to be believed: `q1=0.05`."""
        for name, bound in bounds.items():
            self._require_coordinate(name, "trust")
            if not (isinstance(bound, Real | sympy.Expr) and 0 < bound < float("inf")):
                raise DeclarationError(f"trust: {name}={bound!r}; the bound must be a positive number")
            self.validity[name] = float(bound)

    @property
    def damping_ratios(self) -> tuple[sympy.Expr, ...]:
        """Those of the modes in the order of rising frequencies, the last of all that follow; none where
        they are 0. Raises DeclarationError."""
        given: Any = self.damping_ratio
        ratios = given if isinstance(given, tuple | list) else (given,)
        try:
            expressions = tuple(sympy.sympify(each, strict=True) for each in ratios)
        except sympy.SympifyError:
            expressions = ()
        if not expressions or not all(isinstance(each, sympy.Expr) for each in expressions):
            raise DeclarationError(
                f"damping_ratio is {given!r}; give a number or an expression, or one a mode in a list"
            )
        return expressions if any(each != 0 for each in expressions) else ()

    def decline_drive_torque(self, reason: str) -> None:
        """State why the drive torque does not follow from the energies; it is then no output."""
        self.no_drive_torque = reason

    def _loop(self, loop: Loop) -> tuple[Any, ...]:
        for unknown in loop.unknowns:
            self._require_unused(unknown.name)
        self.declared_loops.append(loop)
        return loop.at(loop.arguments)

    def _condition(self, text: str, meaning: str, margin: Any, symbols: set[Any]) -> None:
        concerned = [each.symbol.name for each in self.declared_parameters if each.symbol in symbols]
        self.conditions.append(Condition(text, meaning, margin, tuple(concerned)))
