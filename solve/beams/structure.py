"""Model of a beam structure from a generated module, with numerically assembled matrices."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol, Self

import numpy as np

from solve.arguments import SMALL
from solve.arrays import Array, LazyMapping, Plane, Recent, uniform_phases
from solve.beams.assembly import POSITIONS, Beams, Kinematics, Positions
from solve.beams.element import EXACT
from solve.beams.frequencies import lowest, shapes
from solve.beams.links import Freedoms, Member, drawn_links, freedoms
from solve.beams.motion import Motion, State
from solve.beams.observations import LINEAR, Contributions, Point, contributions, joint_force, quantity
from solve.capabilities import Capabilities, Outputs
from solve.contracts import Matrices, ModeShape
from solve.equations import entries_one_by_one
from solve.errors import ValueOutOfBoundsError, require_name
from solve.labels import Labels, require_motion
from solve.model.bounds import REDUCE
from solve.model.model import Model
from solve.model.modes import beyond_critical
from solve.model.setup import Setup, samples_of, stated_lines

MOST = 200
"""Largest number of frequencies with exact elements, which have infinitely many. Chosen by judgement."""

_CHUNK_ENTRIES = 2**22
"""Number of matrix entries, over all positions, that are processed in one chunk. Chosen by judgement."""

_CACHE_BYTES = 2**26
"""Memory limit, in bytes, of tables that are cached for solutions at other speeds. It suffices for about ten
grids of 384 steps with 9 coordinates, or two with 27."""

_SPEED_NODES = 3
"""Number of speeds from which the matrices at any speed are interpolated: Ω²M, ΩC, K and d are quadratic in
Ω."""

_AT_REST = {"terms": "full", "stiffening": "off", "damping": "modal"}
"""Values of the options of the motion for structures at rest. Their modules do not declare these options."""


class Response(Protocol):
    """Protocol of an orbit or a quasi-static solution."""

    @property
    def speed(self) -> float:
        """Speed in rad/s."""
        ...

    def state(self, phase: Array) -> tuple[Array, Array, Array]:
        """Return q, q̇, q̈ (n, k) at phases (k,). Derivatives are with respect to time."""
        ...


class StructureModel(Model, Outputs):
    """Model from the links and joints of a generated module. The options select the elements."""

    def __init__(
        self,
        setup: Setup,
        motion: Motion,
        matrices: Callable[[Array, float], Matrices] | None = None,
        coordinates: Sequence[tuple[str, str, str]] | None = None,
    ):
        """Assemble the model.

        matrices: reduced matrices that replace those of `motion`, if any. coordinates: name, unit and meaning
        of each reduced coordinate. If they are given, `expanded` returns all degrees of freedom."""
        chosen = motion.beams.freedoms
        units = zip(chosen.names, chosen.units, strict=True)
        default = [(name, unit, "displacement from the rigid motion") for name, unit in units]
        super().__init__(setup, matrices or motion, coordinates or default)
        self.motion, self.beams = motion, motion.beams
        self.labels = self._of_both_surfaces(
            replace(
                self.labels,
                outputs_apart=True,
                moves=setup.module.MOVES,
                links=drawn_links(chosen),
                no_motion=_reason_without_motion(setup, chosen),
            )
        )

    def _of_both_surfaces(self, labels: Labels) -> Labels:
        """Labels with an additional quantity for each place: PLACE_stress, the larger of PLACE_stress_plus
        and PLACE_stress_minus."""
        largest_of, units, meanings = {}, dict(labels.units), dict(labels.meanings)
        for plus in (name for name, (kind, *_) in self.observed.items() if kind == "stress_plus"):
            both = plus.removesuffix("_plus")
            largest_of[both] = plus, f"{both}_minus"
            units[both] = units[plus]
            meanings[both] = meanings[plus].removesuffix("plus surface") + "either surface"
        return replace(labels, largest_of=largest_of, units=units, meanings=meanings)

    @classmethod
    def from_setup(cls, setup: Setup) -> Self:
        """Model from a setup. Raises StructureError if the links cannot be assembled at all phases."""
        if REDUCE in setup.options:
            raise ValueOutOfBoundsError(
                f"{setup.module.NAME} was loaded with all coordinates; to reduce it, load it again with "
                "reduce"
            )
        return cls(setup, cls._motion(setup))

    @staticmethod
    def _motion(setup: Setup) -> Motion:
        module, kinematics = setup.module, Kinematics(setup)
        counts = list(map(int, _of_each_link(setup, "elements")))
        elastic = (getattr(module, name, ()) for name in ("SPRINGS", "DASHPOTS"))
        chosen = freedoms(module.LINKS, module.JOINTS, _of_each_link(setup, "element"), counts, *elastic)
        beams = Beams(chosen, kinematics.properties, kinematics.angle)
        if module.MOVES:
            Positions(beams, uniform_phases(POSITIONS, module.PERIOD))
        terms = {name: setup.options.get(name, default) for name, default in _AT_REST.items()}
        return Motion(beams, kinematics.rates, module.PERIOD, **terms)

    def expanded(self, phase: Array, speed: Array | float, *state: Array, acceleration: float = 0.0) -> State:
        """State with all degrees of freedom at phases (k,). `state` is q, q̇, q̈ (n, k), or q alone for beams
        at rest."""
        q, qd, qdd = with_rates(state)
        return State(self.motion, phase, speed, q, qd, qdd, acceleration)

    def at(self, phase: Array, speed: float) -> Matrices:
        require_motion(self)
        return super().at(phase, speed)

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(structure=self, outputs=self if self.outputs else None)

    def _varying_at(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        require_motion(self)
        return self.motion(phase, speed[:, None], acceleration)

    def entries_over(self, phase: Array, speeds: Array) -> Array | None:
        """Entries at speeds (P,). For more than three speeds, they are interpolated from three speeds
        (Lagrange), which is exact."""
        low, high = speeds.min(), speeds.max()
        if len(speeds) <= _SPEED_NODES or high - low < 1e-3 * high:
            return None
        x = (speeds - low) / (high - low)
        weights = np.stack(((1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)), axis=1)
        nodes = np.linspace(low, high, _SPEED_NODES)
        return np.tensordot(weights, entries_one_by_one(self, phase, nodes), axes=1)

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        """Terms that are multiplied by powers of the speed. None for large systems, whose points are solved
        one at a time to save memory."""
        if self.n > SMALL:
            return None
        require_motion(self)
        entry, power = self.motion.speed_powers
        return self._speed_terms(phase), speeds[:, None] ** power, entry

    @cached_property
    def _speed_terms(self) -> Recent:
        return Recent(self.motion.speed_terms, _CACHE_BYTES)

    @property
    def assembled(self) -> bool:
        return True

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom that remain after inextensible links have removed some."""
        return self.at_positions(np.zeros(1)).n

    @property
    def most_frequencies(self) -> int:
        return MOST if self.beams.exact_links else self.freedoms

    def frequencies(self, positions: Array, count: int) -> Array:
        chunks = max(1, math.ceil(len(positions) * self.freedoms**2 / _CHUNK_ENTRIES))
        return np.concatenate(
            [lowest(self.at_positions(chunk), count) for chunk in np.array_split(positions, chunks)]
        )

    def mode_shapes(self, position: float, frequencies: Array) -> list[ModeShape]:
        return shapes(self.beams, position, frequencies)

    def pinned_frequencies(self) -> dict[str, float]:
        """Mapping from links to the lowest bending frequency (π/L)² √(EI/µ) in rad/s of the link with pinned
        ends."""
        p = self.beams.properties
        frequencies = (np.pi / p.length) ** 2 * np.sqrt(p.EI / p.mu)
        return dict(zip((link.name for link in self.labels.links), frequencies.tolist(), strict=True))

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        state = self.expanded(phase, speed, q, qd, qdd, acceleration=acceleration)

        def value(name: str) -> Array:
            kind, link, place = self.observed[name]
            # Outputs of the entire structure belong to no link.
            return quantity(state, kind, self._member(link or self.labels.links[0].name), place)

        return LazyMapping(self.outputs, value)

    @cached_property
    def observed(self) -> dict[str, tuple[str, str, float]]:
        """Mapping from names of outputs to kind, link and position. The position is a fraction of the length
        of the link."""
        return dict(zip(self.outputs, self.module.OBSERVED, strict=True))

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        if not self.module.MOVES:
            return []
        warnings, ratio = [], self.beams.properties.damping_ratio
        damped = ratio > 0 or self.beams.properties.dashpot.any()
        if not damped and self.labels.options["terms"] == "instantaneous":
            warnings.append(
                "terms=instantaneous neglects M'q', the change of M with the phase: without damping this "
                "adds energy, and |ρ| > 1 at every speed does not imply instability; use --option terms=full"
            )
        if ratio > 1 and self.labels.options["damping"] == "modal":
            warnings.append(beyond_critical(ratio))
        if self.labels.options["stiffening"] == "on":
            warnings += self.motion.buckling_warnings(speed)
        return warnings

    def joint_force(self, link: str, joint: str, orbit: Response, phase: Array) -> tuple[Array, Array, Array]:
        """Compute the force and the moment that a joint exerts on a link.

        Parameters
        ----------
        link, joint : str
            Names of the link and of a joint at one of its ends.
        orbit : Orbit
            Orbit or quasi-static solution.
        phase : (k,) array
            Phases.

        Returns
        -------
        tuple of (k,) arrays
            Force along x and y in N, and moment in N m.

        Raises
        ------
        UnknownNameError
        """
        member = self._member(link)
        ends = member.link[1:3]
        require_name(f"joint of link {link}", joint, ends)
        state = self.expanded(phase, orbit.speed, *orbit.state(phase))
        return joint_force(state, member, ends.index(joint))

    def deflection(self, link: str, fraction: float, phase: Array, q: Array) -> Array:
        """Compute the transverse displacement of a point of a link from its position in the rigid motion.

        Parameters
        ----------
        link : str
            Name of the link.
        fraction : float
            Position of the point, as a fraction 0 … 1 of the length of the link.
        phase : (k,) array
            Phases.
        q : (n, k) array
            Coordinates.

        Returns
        -------
        (k,) array
            Displacement in m.

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        q = self.expanded(phase, 0.0, q).q
        return self.point(link, fraction).displacement(self.beams.angle(phase), q)[1]

    def stress(self, link: str, fraction: float, surface: str, phase: Array, q: Array) -> Array:
        """Compute the axial stress E (u′ ∓ (h/2) v″) on a surface of a link.

        Parameters
        ----------
        link, fraction, phase, q
            As in `deflection`.
        surface : {"plus", "minus"}
            Surface at +h/2 or −h/2.

        Returns
        -------
        (k,) array
            Stress in Pa.

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        q = self.expanded(phase, 0.0, q).q
        return self.point(link, fraction).stress(self.beams.angle(phase), q, surface)

    def _sketched(self, phase: Array, speed: float, q: Array, fineness: float) -> Mapping[str, Plane]:
        """Mapping from names to the deflected links and the other lines of the sketch."""
        fractions = np.linspace(0.0, 1.0, samples_of("beam", fineness)).tolist()
        links = {
            link.name: np.array([self.path(link.name, at, 0.0, phase, q)[1] for at in fractions])
            for link in self.labels.links
        }
        return {**links, **stated_lines(self.setup, phase, speed, q[:0], fineness)}

    def path(self, link: str, along: float, across: float, phase: Array, q: Array) -> tuple[Array, Array]:
        """Return two positions x + iy (k,) in m of a point of a link: in the rigid motion, and with the
        deflections q (n, k).

        along: fraction of the length, 0 … 1. across: distance from the axis in m. The first fixed joint is at
        0. Raises UnknownNameError and ValueOutOfBoundsError."""
        point, positions = self.point(link, along), self.at_positions(phase)
        q = self.expanded(phase, 0.0, q).q
        number = point.member.number
        direction = np.exp(1j * positions.angle[:, number])
        rigid = along * self.beams.properties.length[number] + 1j * across
        u, v = point.displacement(positions.angle, q)
        deflection = u + 1j * v - across * point.rotation(positions.angle, q)
        rigid_positions = positions.joints[:, point.member.start] + rigid * direction
        return rigid_positions, rigid_positions + deflection * direction

    def modal_contributions(
        self, orbit: Response, output: str, count: int = 4, samples: int = 720
    ) -> Contributions:
        """Contributions of the lowest modes to a deflection or stress of an orbit or quasi-static solution.

        The modes are tracked over the revolution, at `samples` positions. Raises UnknownNameError,
        ValueOutOfBoundsError."""
        kind, link, place = self.require_part_of_modes(output)
        most = self.beams.freedoms.n
        if not 1 <= count <= most:
            raise ValueOutOfBoundsError(f"{count} modes requested; allowed: 1 to {most}")
        phase = np.linspace(0.0, self.period, samples + 1)
        state = self.expanded(phase, orbit.speed, *orbit.state(phase))
        member = self._member(link)
        return contributions(state, output, lambda modal: quantity(modal, kind, member, place), count)

    def require_part_of_modes(self, output: str) -> tuple[str, str, float]:
        """Return the kind, the link and the position of an output that is linear in the deflections. Raises
        UnknownNameError for other outputs."""
        linear = {name: entry for name, entry in self.observed.items() if entry[0] in LINEAR}
        require_name(f"deflection or stress of {self.labels.name}", output, linear)
        return linear[output]

    def _member(self, link: str) -> Member:
        members = {member.link.name: member for member in self.beams.members}
        require_name(f"link of {self.labels.name}", link, members)
        return members[link]

    def point(self, link: str, fraction: float) -> Point:
        """Point at a fraction 0 … 1 of the length of a link. Raises UnknownNameError and
        ValueOutOfBoundsError."""
        if not 0 <= fraction <= 1:
            raise ValueOutOfBoundsError(
                f"position on link {link} is {fraction}; allowed: 0 to 1, as a fraction of the length"
            )
        return Point(self._member(link), fraction)

    def at_positions(self, phase: Array) -> Positions:
        """Structure at rest at the positions with phases (m,)."""
        return Positions(self.beams, phase)


def _reason_without_motion(setup: Setup, freedoms: Freedoms) -> str:
    """Reason why a structure has no equations of motion: it is at rest, or its elements do not permit them.
    Empty if it has equations of motion."""
    name = setup.module.NAME
    if not setup.module.MOVES:
        return (
            f"{name} is a structure at rest, which has natural frequencies only; "
            f"run: python -m solve frequencies {name}"
        )
    if EXACT in freedoms.kinds:
        return (
            f"{name} with element {EXACT} has natural frequencies only, without equations of "
            "motion; choose another element"
        )
    if any(link.inextensible for link in freedoms.links):
        return (
            f"{name} has inextensible links, for which only natural frequencies are "
            "available; make the links extensible"
        )
    return ""


def with_rates(state: Sequence[Array]) -> tuple[Array, Array, Array]:
    """States q, q̇, q̈ (n, k). If only q is given, its derivatives are zero."""
    if len(state) == 3:
        return state[0], state[1], state[2]
    (q,) = state
    return q, np.zeros_like(q), np.zeros_like(q)


def _of_each_link(setup: Setup, option: str) -> list[str]:
    values = str(setup.options[option]).split(",")
    return values if len(values) > 1 else values * len(setup.module.LINKS)
