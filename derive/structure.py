"""Statement of a plane structure of slender beams, whose links may rotate as functions of the phase."""

import difflib
from collections.abc import Iterator, Set
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import sympy

from derive.beam import ELEMENTS
from derive.errors import DeclarationError
from derive.mechanism import MechanismStatement
from derive.symbols import PHASE, SPEED

EXACT = "dynamic"
"""Name of the element whose shape functions are exact solutions of the equation of vibration."""


@dataclass(frozen=True)
class Section:
    """Cross section and material of a link.

    Parameters
    ----------
    E : expression
        Modulus of elasticity, Pa.
    A : expression
        Area, m².
    I : expression
        Second moment of area, m⁴.
    rho : expression
        Density, kg/m³.
    height : expression, default 0
        Height in the plane of motion for the computation of stresses, m.
    """

    E: sympy.Expr
    A: sympy.Expr
    I: sympy.Expr  # noqa: E741 - the field's symbol
    rho: sympy.Expr
    height: sympy.Expr | float = 0


@dataclass(frozen=True)
class Link:
    """Straight uniform beam from joint `start` to joint `end`, at an `angle` to the x axis."""

    name: str
    start: str
    end: str
    length: sympy.Expr
    angle: sympy.Expr
    section: Section
    inextensible: bool

    @property
    def properties(self) -> dict[str, tuple[sympy.Expr, str]]:
        """Mapping from the names of the link's properties in the generated module to (expression, unit)."""
        section = self.section
        return {
            "angle": (self.angle, "rad"),
            "length": (self.length, "m"),
            "E": (sympy.sympify(section.E), "Pa"),
            "EA": (section.E * section.A, "N"),
            "EI": (section.E * section.I, "N m^2"),
            "mu": (section.rho * section.A, "kg/m"),
            "height": (sympy.sympify(section.height), "m"),
        }


@dataclass(frozen=True)
class Elastic:
    """Springs, or dashpots, between a joint and the ground.

    x, y: coefficients along the axes. turn: coefficient for the rotation of each of the `links`.
    """

    joint: str
    links: tuple[str, ...]
    x: sympy.Expr
    y: sympy.Expr
    turn: sympy.Expr


SPRING = {"x": "N/m", "y": "N/m", "turn": "N m/rad"}
DASHPOT = {"x": "N s/m", "y": "N s/m", "turn": "N m s/rad"}
"""Mappings from the axes to the units of the coefficients of springs and dashpots."""


@dataclass(slots=True)
class StructureStatement(MechanismStatement):
    """Statement of a structure; `derive.Structure` describes it and adds the generated code."""

    declared_links: list[Link] = field(default_factory=list, init=False)
    declared_masses: list[tuple[str, sympy.Expr]] = field(default_factory=list, init=False)
    supported: list[str] = field(default_factory=list, init=False)
    clamped: list[tuple[str, str]] = field(default_factory=list, init=False)
    welded: list[tuple[str, tuple[str, ...]]] = field(default_factory=list, init=False)
    declared_springs: list[Elastic] = field(default_factory=list, init=False)
    declared_dashpots: list[Elastic] = field(default_factory=list, init=False)

    def link(
        self,
        name: str,
        start: str,
        end: str,
        length: sympy.Expr,
        angle: sympy.Expr | float,
        section: Section,
        inextensible: bool = False,
    ) -> None:
        """Declare a link between two joints.

        Parameters
        ----------
        name, start, end : str
            Names of the link and of its joints.
        length : expression
            Length, m; constant.
        angle : expression
            Angle from the x axis, rad; it may be a function of the phase.
        section : Section
            Cross section and material.
        inextensible : bool, default False
            Whether the link bends but does not extend.

        Raises
        ------
        DeclarationError
        """
        for text in (name, start, end):
            if not text.isidentifier():
                raise DeclarationError(
                    f'"{text}" cannot be the name of a link or joint; give a word such as "crank" or "A"'
                )
        if start == end:
            raise DeclarationError(f'link {name} starts and ends at "{start}"; give two joints')
        if name in self.links:
            raise DeclarationError(f"link {name} is declared twice")
        stated = Link(
            name, start, end, sympy.sympify(length), sympy.sympify(angle), section, bool(inextensible)
        )
        self.declared_links.append(stated)

    @property
    def links(self) -> dict[str, Link]:
        """Mapping from names to links, in the order of declaration."""
        return {link.name: link for link in self.declared_links}

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in the order in which the links mention them."""
        return list(dict.fromkeys(joint for link in self.declared_links for joint in (link.start, link.end)))

    def support(self, joint: str) -> None:
        """Fix the position of a joint; its links rotate freely about it."""
        self._require_joint(joint)
        self.supported.append(joint)

    def clamp(self, joint: str, *links: str) -> None:
        """Fix the position of a joint and the directions of its links (all, or the named links)."""
        self.support(joint)
        self.clamped += [(joint, name) for name in self._links_at(joint, links)]

    def weld(self, joint: str, *links: str) -> None:
        """Connect the links of a joint (all, or the named links) rigidly to one another."""
        self.welded.append((joint, self._links_at(joint, links)))

    def spring(self, joint: str, *links: str, x: Any = 0, y: Any = 0, turn: Any = 0) -> None:
        """Support a joint elastically.

        Parameters
        ----------
        joint : str
            Name of the joint.
        *links : str
            Links whose rotation the spring `turn` restrains; by default all links of the joint.
        x, y : expression, default 0
            Stiffness along x and y, N/m.
        turn : expression, default 0
            Rotational stiffness, N m/rad.
        """
        self.declared_springs.append(self._elastic(joint, links, x, y, turn))

    def dashpot(self, joint: str, *links: str, x: Any = 0, y: Any = 0, turn: Any = 0) -> None:
        """Add dashpots between a joint and the ground. The arguments are those of `spring`, with x and y in
        N s/m and turn in N m s/rad."""
        self.declared_dashpots.append(self._elastic(joint, links, x, y, turn))

    def to_ground(self, declared: list[Elastic]) -> dict[str, sympy.Expr]:
        """Return a mapping from degrees of freedom to the coefficients of springs or dashpots to ground.

        Raises DeclarationError for a degree of freedom that is also supported rigidly.
        """
        by_freedom: dict[str, Any] = {}
        for elastic in declared:
            links = {name: self.rotation(self.links[name], elastic.joint) for name in elastic.links}
            turns = dict.fromkeys(links.values(), elastic.turn)
            freedoms = dict.fromkeys("xy", "" if elastic.joint in self.supported else elastic.joint)
            acting = [(freedoms[axis], axis, value) for axis, value in (("x", elastic.x), ("y", elastic.y))]
            acting += [(name, "turn", value) for name, value in turns.items()]
            for freedom, axis, value in (part for part in acting if part[2] != 0):
                if not freedom:
                    raise DeclarationError(
                        f"joint {elastic.joint} is supported rigidly and elastically ({axis}); remove one "
                        "of the supports"
                    )
                by_freedom[f"{freedom}_{axis}"] = by_freedom.get(f"{freedom}_{axis}", 0) + value
        return by_freedom

    def mass(self, joint: str, mass: sympy.Expr) -> None:
        """Add a point mass (kg) to a joint."""
        self._require_joint(joint)
        self.declared_masses.append((joint, sympy.sympify(mass)))

    def mass_at(self, joint: str) -> sympy.Expr:
        """Sum of the point masses of a joint."""
        return sympy.Add(*(mass for at, mass in self.declared_masses if at == joint))

    def rotation(self, link: Link, joint: str) -> str:
        """Name of the rotational degree of freedom at the end of a link; "" if the end is clamped.

        Links that are welded to one another have the same one.
        """
        welded = next(
            (names for at, names in self.welded if at == joint and link.name in names), (link.name,)
        )
        return "" if any((joint, name) in self.clamped for name in welded) else f"{welded[0]}_{joint}"

    @property
    def moves(self) -> bool:
        """Whether any link rotates with the phase."""
        return any(PHASE in link.angle.free_symbols for link in self.declared_links)

    def numbers(self) -> Iterator[tuple[str, sympy.Expr, str, Set[sympy.Symbol]]]:
        """Yield a description, the expression, its unit and its forbidden symbols, for all expressions in the
        statement."""
        fixed = {PHASE, SPEED}
        for link in self.declared_links:
            for name, (expression, unit) in link.properties.items():
                forbidden = {SPEED} if name == "angle" else fixed
                yield f"{name} of link {link.name}", expression, unit, forbidden
        for joint, mass in self.declared_masses:
            yield f"mass of joint {joint}", mass, "kg", fixed
        for what, declared, units in (
            ("spring", self.declared_springs, SPRING),
            ("dashpot", self.declared_dashpots, DASHPOT),
        ):
            for elastic, (axis, unit) in product(declared, units.items()):
                value = getattr(elastic, axis)
                if value != 0:
                    yield f"{what} of joint {elastic.joint} ({axis})", value, unit, fixed
        for ratio in self.damping_ratios:
            yield "damping ratio", ratio, "1", fixed

    def require_complete(self) -> None:
        """Raise DeclarationError for a structure without links, without support, or with stated energies."""
        if not self.declared_links:
            raise DeclarationError(f"{self.name} has no links; declare one with link(...)")
        stated = (self.kinetic, self.potential, self.dissipation, self.declared_coordinates, self.forces)
        if any(stated):
            raise DeclarationError(
                f"{self.name} is a structure: its coordinates and energies follow from its links; "
                "specify them in a Mechanism instead"
            )
        if len(self.damping_ratios) > 1:
            raise DeclarationError(
                f"{self.name} has {len(self.damping_ratios)} damping ratios; give a structure one "
                "ratio for all modes"
            )
        self._require_own_freedoms()
        springs = self.to_ground(self.declared_springs)
        self.to_ground(self.declared_dashpots)
        if not self.supported and not springs:
            raise DeclarationError(
                f"{self.name} has no support; use support(joint), clamp(joint) or spring(joint, ...)"
            )

    def _require_own_freedoms(self) -> None:
        """Raise DeclarationError if two degrees of freedom have the same name.

        Examples of names are "knee" for a joint, "arm_knee" for the end of a link, and "arm_1" for a node
        within a link.
        """
        ends = [f"{link.name}_{joint}" for link in self.declared_links for joint in (link.start, link.end)]
        for name in (*self.joints, *ends):
            link, _, number = name.rpartition("_")
            if link in self.links and number.isdigit():
                first = "a joint" if name in self.joints else "the end of a link"
                raise DeclarationError(
                    f'"{name}" names both {first} and a node within link {link}; rename a link or a joint'
                )
            if ends.count(name) > 1:
                raise DeclarationError(f'the ends of two links are named "{name}"; rename a link or a joint')

    def _elastic(self, joint: str, links: tuple[str, ...], x: Any, y: Any, turn: Any) -> Elastic:
        return Elastic(joint, self._links_at(joint, links), *map(sympy.sympify, (x, y, turn)))

    def _links_at(self, joint: str, chosen: tuple[str, ...]) -> tuple[str, ...]:
        self._require_joint(joint)
        there = [link.name for link in self.declared_links if joint in (link.start, link.end)]
        for name in chosen:
            if name not in there:
                raise DeclarationError(f"joint {joint} has no link {name}; its links: {', '.join(there)}")
        return tuple(chosen or there)

    def _require_joint(self, joint: str) -> None:
        if joint not in self.joints:
            nearest = difflib.get_close_matches(joint, self.joints, 1)
            hint = f'; did you mean "{nearest[0]}"?' if nearest else ""
            raise DeclarationError(
                f'no link ends at a joint "{joint}"{hint} (joints: {", ".join(self.joints) or "none yet"})'
            )


ELEMENT_NAMES = (*(element.name for element in ELEMENTS), EXACT)
