"""A plane structure of slender beams, stated by its links and joints; it may move with the phase."""

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
"""The element whose shape functions solve the equation of vibration, instead of a polynomial family."""


@dataclass(frozen=True)
class Section:
    """Modulus of elasticity E (Pa), area A (m²), second moment of area I (m⁴), density rho (kg/m³), and
    the height in the plane (m) where stresses are of interest."""

    E: sympy.Expr
    A: sympy.Expr
    I: sympy.Expr  # noqa: E741 - the field's symbol
    rho: sympy.Expr
    height: sympy.Expr | float = 0


@dataclass(frozen=True)
class Link:
    """A straight uniform beam from joint `start` to joint `end`, `angle` from the x axis."""

    name: str
    start: str
    end: str
    length: sympy.Expr
    angle: sympy.Expr
    section: Section
    inextensible: bool

    @property
    def properties(self) -> dict[str, tuple[sympy.Expr, str]]:
        """What the generated module computes for the link: expression and unit by name."""
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
    """Springs or dashpots between a joint and the ground: across x and y, and for the turn of some links."""

    joint: str
    links: tuple[str, ...]
    x: sympy.Expr
    y: sympy.Expr
    turn: sympy.Expr


SPRING = {"x": "N/m", "y": "N/m", "turn": "N m/rad"}
DASHPOT = {"x": "N s/m", "y": "N s/m", "turn": "N m s/rad"}
"""Units of springs and dashpots to the ground."""


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
        """Declare a link between two joints; its angle may be a function of the phase, its length not.

        An inextensible link bends only. Raises DeclarationError.
        """
        for each in (name, start, end):
            if not each.isidentifier():
                raise DeclarationError(
                    f'"{each}" cannot be the name of a link or joint; give a word such as "crank" or "A"'
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
        """Links by name, in the order of their declaration."""
        return {each.name: each for each in self.declared_links}

    @property
    def joints(self) -> list[str]:
        """Joints in the order in which the links name them."""
        return list(dict.fromkeys(joint for each in self.declared_links for joint in (each.start, each.end)))

    def support(self, joint: str) -> None:
        """Hold a joint's place; its links still turn about it."""
        self._require_joint(joint)
        self.supported.append(joint)

    def clamp(self, joint: str, *links: str) -> None:
        """Hold a joint's place and the directions of its links, or of those named."""
        self.support(joint)
        self.clamped += [(joint, name) for name in self._links_at(joint, links)]

    def weld(self, joint: str, *links: str) -> None:
        """Let the links of a joint, or those named, turn together there."""
        self.welded.append((joint, self._links_at(joint, links)))

    def spring(self, joint: str, *links: str, x: Any = 0, y: Any = 0, turn: Any = 0) -> None:
        """Hold a joint elastically where `support` holds it rigidly: stiffness along x and y (N/m); and the
        directions of its links, or of those named, where `clamp` does (N m/rad)."""
        self.declared_springs.append(self._elastic(joint, links, x, y, turn))

    def dashpot(self, joint: str, *links: str, x: Any = 0, y: Any = 0, turn: Any = 0) -> None:
        """Dampers beside the springs of a joint: along x and y (N s/m), of turns (N m s/rad)."""
        self.declared_dashpots.append(self._elastic(joint, links, x, y, turn))

    def to_ground(self, declared: list[Elastic]) -> dict[str, sympy.Expr]:
        """Springs or dashpots by the freedoms on which they act. Raises DeclarationError for one that is held
        rigidly."""
        found: dict[str, Any] = {}
        for each in declared:
            links = {name: self.rotation(self.links[name], each.joint) for name in each.links}
            turns = dict.fromkeys(links.values(), each.turn)
            held = dict.fromkeys("xy", "" if each.joint in self.supported else each.joint)
            acting = [(held[axis], axis, value) for axis, value in (("x", each.x), ("y", each.y))]
            acting += [(name, "turn", value) for name, value in turns.items()]
            for freedom, axis, value in (part for part in acting if part[2] != 0):
                if not freedom:
                    raise DeclarationError(
                        f"joint {each.joint} is held rigidly and elastically ({axis}); drop one of both"
                    )
                found[f"{freedom}_{axis}"] = found.get(f"{freedom}_{axis}", 0) + value
        return found

    def mass(self, joint: str, mass: sympy.Expr) -> None:
        """Put a point mass (kg) at a joint."""
        self._require_joint(joint)
        self.declared_masses.append((joint, sympy.sympify(mass)))

    def mass_at(self, joint: str) -> sympy.Expr:
        """All point masses of a joint together."""
        return sympy.Add(*(mass for at, mass in self.declared_masses if at == joint))

    def rotation(self, link: Link, joint: str) -> str:
        """Name of the freedom by which a link's end turns: shared where welded, "" where clamped."""
        together = next(
            (names for at, names in self.welded if at == joint and link.name in names), (link.name,)
        )
        return "" if any((joint, name) in self.clamped for name in together) else f"{together[0]}_{joint}"

    @property
    def moves(self) -> bool:
        """Whether any link turns with the phase."""
        return any(PHASE in each.angle.free_symbols for each in self.declared_links)

    def numbers(self) -> Iterator[tuple[str, sympy.Expr, str, Set[sympy.Symbol]]]:
        """Every expression of the statement: what it is, itself, its unit and what it must not hold."""
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
            for each, (axis, unit) in product(declared, units.items()):
                value = getattr(each, axis)
                if value != 0:
                    yield f"{what} of joint {each.joint} ({axis})", value, unit, fixed
        for ratio in self.damping_ratios:
            yield "damping ratio", ratio, "1", fixed

    def require_complete(self) -> None:
        """Raise DeclarationError for a structure without links or without support, or one that states
        what follows from its links."""
        if not self.declared_links:
            raise DeclarationError(f"{self.name} has no links; declare one with link(...)")
        stated = (self.kinetic, self.potential, self.dissipation, self.declared_coordinates, self.forces)
        if any(stated):
            raise DeclarationError(
                f"{self.name} is a structure: its coordinates and energies follow from its links; "
                "state them in a Mechanism instead"
            )
        if len(self.damping_ratios) > 1:
            raise DeclarationError(
                f"{self.name} has {len(self.damping_ratios)} damping ratios; give a structure one for all"
            )
        self._require_own_freedoms()
        springs = self.to_ground(self.declared_springs)
        self.to_ground(self.declared_dashpots)
        if not self.supported and not springs:
            raise DeclarationError(
                f"{self.name} is held nowhere; use support(joint), clamp(joint) or spring(joint, ...)"
            )

    def _require_own_freedoms(self) -> None:
        """Raise DeclarationError where two freedoms would have one name and so be one: those of joints,
        "knee", of links' ends, "arm_knee", and of nodes within links, "arm_1"."""
        ends = [f"{each.name}_{joint}" for each in self.declared_links for joint in (each.start, each.end)]
        for name in (*self.joints, *ends):
            link, _, number = name.rpartition("_")
            within = f"a node within link {link}" if link in self.links and number.isdigit() else ""
            twice = "the ends of two links" if ends.count(name) > 1 else ""
            if within or twice:
                raise DeclarationError(
                    f'"{name}" would name the freedoms of {within or twice} too; rename a link or a joint'
                )

    def _elastic(self, joint: str, links: tuple[str, ...], x: Any, y: Any, turn: Any) -> Elastic:
        return Elastic(joint, self._links_at(joint, links), *map(sympy.sympify, (x, y, turn)))

    def _links_at(self, joint: str, chosen: tuple[str, ...]) -> tuple[str, ...]:
        self._require_joint(joint)
        there = [each.name for each in self.declared_links if joint in (each.start, each.end)]
        for name in chosen:
            if name not in there:
                raise DeclarationError(f"no link {name} at joint {joint}; there: {', '.join(there)}")
        return tuple(chosen or there)

    def _require_joint(self, joint: str) -> None:
        if joint not in self.joints:
            nearest = difflib.get_close_matches(joint, self.joints, 1)
            hint = f'; did you mean "{nearest[0]}"?' if nearest else ""
            raise DeclarationError(
                f'no link ends at a joint "{joint}"{hint} (joints: {", ".join(self.joints) or "none yet"})'
            )


ELEMENT_NAMES = (*(element.name for element in ELEMENTS), EXACT)
