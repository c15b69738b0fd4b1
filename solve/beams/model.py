"""A structure of beams from a generated module: a model whose matrices are assembled, not printed."""

from collections.abc import Callable, Sequence
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array
from solve.beams.beams import Beams, Properties
from solve.beams.buckling import Compression
from solve.beams.contributions import LINEAR, Contributions, contributions
from solve.beams.elements import EXACT
from solve.beams.freedoms import freedoms
from solve.beams.joint_forces import joint_force
from solve.beams.motion import Motion
from solve.beams.points import SURFACES, Point
from solve.beams.positions import Positions
from solve.beams.quantities import quantity
from solve.beams.state import State
from solve.errors import NoMotionError, UnknownNameError, ValueOutOfBoundsError
from solve.loading import Model

if TYPE_CHECKING:
    import casadi

    from solve.results.orbit import Turn


class StructureModel(Model):
    """Links and joints of a generated module, with the elements that the options choose.

    Raises StructureError where the links cannot be assembled all the way round.
    """

    beams: Beams

    def _equations(self) -> tuple[Callable[[Array, float], Sequence[Array]], Sequence[tuple[str, str, str]]]:
        module = self.module
        chosen = freedoms(
            module.LINKS,
            module.JOINTS,
            self._of_each_link("element"),
            list(map(int, self._of_each_link("elements"))),
        )
        self._properties = module.properties(**self._own_options)
        self.beams = Beams(chosen, self._numbers(), self._angle)
        if module.MOVES:
            self.at_positions(np.linspace(0.0, module.PERIOD, 36, endpoint=False))
        meanings = zip(chosen.names, chosen.units, strict=True)
        return self._motion, [(name, unit, "displacement from the rigid motion") for name, unit in meanings]

    @staticmethod
    def declared_options(module: ModuleType) -> Sequence[tuple[str, Sequence[Any], Any]]:
        return (*module.OPTIONS, *module.LINK_OPTIONS, *module.MOTION_OPTIONS)

    def output_values(self, phase: Array, speed: float, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        if not self.outputs:
            return {}
        state = State(self._equation, phase, speed, q, qd, qdd)
        numbers = {link.name: number for number, link in enumerate(self.beams.freedoms.links)}
        return {
            name: quantity(state, kind, numbers.get(link, 0), place)
            for name, (kind, link, place) in zip(self.outputs, self.module.OBSERVED, strict=True)
        }

    def doubts(self, speed: float) -> list[str]:
        if not self.module.MOVES:
            return []
        found, ratio = [], self.beams.properties.damping_ratio
        if ratio == 0 and self.options["terms"] == "instantaneous":
            found.append(
                "terms=instantaneous leaves out M'q', what M changes as the links turn: without damping that "
                "feeds energy, and |ρ| > 1 at every speed says nothing of stability; use --option terms=full"
            )
        if ratio > 1 and self.options["damping"] == "modal":
            found.append(
                f"damping ratio {ratio:g}: beyond 1 no mode vibrates; a ratio is 0.02, not 2 (percent)"
            )
        if self.options["stiffening"] == "on":
            found += self._compression.doubts(speed)
        return found

    @cached_property
    def _compression(self) -> Compression:
        return Compression(self._equation)

    def joint_force(self, link: str, joint: str, turn: "Turn", phase: Array) -> tuple[Array, Array, Array]:
        """Force along x and y (N) and moment (N m), (k,) each, of a joint on a link that ends there, at
        phases (k,) of an orbit, or of its quasi-static solution. Raises UnknownNameError."""
        number = self._number(link)
        ends = self.beams.freedoms.links[number][1:3]
        if joint not in ends:
            raise UnknownNameError(f"joint of link {link}", joint, ends)
        state = State(self._equation, phase, turn.speed, *turn.state(phase))
        return joint_force(state, number, ends.index(joint))

    def deflection(self, link: str, fraction: float, phase: Array, q: Array) -> Array:
        """Transverse displacement (k,) in m from the rigid motion, at a fraction (0 … 1) of a link's length,
        for q (n, k) at phases (k,). Raises UnknownNameError and ValueOutOfBoundsError."""
        return self.point(link, fraction).displacement(self._angle(phase), q)[1]

    def stress(self, link: str, fraction: float, surface: str, phase: Array, q: Array) -> Array:
        """Axial stress (k,) in Pa, E (u′ ∓ (h/2) v″), on the surface "plus" or "minus" of a link at a
        fraction (0 … 1) of its length, for q (n, k) at phases (k,).

        Raises UnknownNameError and ValueOutOfBoundsError.
        """
        if surface not in SURFACES:
            raise UnknownNameError("surface", surface, SURFACES)
        return self.point(link, fraction).stress(self._angle(phase), q, surface)

    def path(self, link: str, along: float, across: float, phase: Array, q: Array) -> tuple[Array, Array]:
        """Places x + iy (k,) in m, rigid and with deflections q (n, k), of a point that a section carries
        at the fraction `along` (0 … 1) of a link, `across` m beside its axis; the first held joint is at 0.

        Raises UnknownNameError and ValueOutOfBoundsError.
        """
        point, positions = self.point(link, along), self.at_positions(phase)
        start = [name for name, _ in self.beams.freedoms.joints].index(self.module.LINKS[point.number][1])
        direction = np.exp(1j * positions.angle[:, point.number])
        rigid = along * self.beams.properties.length[point.number] + 1j * across
        u, v = point.displacement(positions.angle, q)
        moved = u + 1j * v - across * point.rotation(positions.angle, q)
        places = positions.joints[:, start] + rigid * direction
        return places, places + moved * direction

    def modal_contributions(
        self, turn: "Turn", output: str, count: int = 4, samples: int = 720
    ) -> Contributions:
        """What the lowest modes of each position, followed along the turn, give to a deflection or stress
        of an orbit, or of its quasi-static solution. Raises UnknownNameError, ValueOutOfBoundsError."""
        kind, link, place = self.require_part_of_modes(output)
        if not 1 <= count <= self.n:
            raise ValueOutOfBoundsError(f"{count} modes asked for; allowed: 1 to {self.n}")
        phase = np.linspace(0.0, self.period, samples + 1)
        state = State(self._equation, phase, turn.speed, *turn.state(phase))
        return contributions(state, output, kind, self._number(link), place, count)

    def require_part_of_modes(self, output: str) -> tuple[str, str, float]:
        """Kind, link and place of an output that is linear in the deflections. Raises UnknownNameError."""
        observed = zip(self.outputs, self.module.OBSERVED, strict=True)
        linear = {name: each for name, each in observed if each[0] in LINEAR}
        if output not in linear:
            raise UnknownNameError(f"deflection or stress of {self.name}", output, linear)
        return linear[output]

    def _number(self, link: str) -> int:
        names = [each.name for each in self.beams.freedoms.links]
        if link not in names:
            raise UnknownNameError(f"link of {self.name}", link, names)
        return names.index(link)

    def point(self, link: str, fraction: float) -> Point:
        """The place at a fraction (0 … 1) of a link's length. Raises UnknownNameError and
        ValueOutOfBoundsError."""
        if not 0 <= fraction <= 1:
            raise ValueOutOfBoundsError(f"place on link {link} is {fraction}; allowed: 0 to 1 of its length")
        return Point(self.beams, self._number(link), fraction)

    def at_positions(self, phase: Array) -> Positions:
        """The structure frozen at phases (m,)."""
        return Positions(self.beams, phase)

    def pinned_frequencies(self) -> dict[str, float]:
        """Lowest bending frequency (rad/s) of each link by itself, pinned at both ends: (π/L)² √(EI/µ)."""
        p = self.beams.properties
        alone = (np.pi / p.length) ** 2 * np.sqrt(p.EI / p.mu)
        return dict(zip((link.name for link in self.beams.freedoms.links), alone.tolist(), strict=True))

    def _of_each_link(self, option: str) -> list[str]:
        parts = str(self.options[option]).split(",")
        return parts if len(parts) > 1 else parts * len(self.module.LINKS)

    def _numbers(self) -> Properties:
        values = self._properties.call({"phase": 0.0, "p": self._p})
        columns = {name: value.full().ravel() for name, value in values.items() if name != "angle"}
        return Properties(**{**columns, "damping_ratio": float(columns["damping_ratio"][0])})

    def _angle(self, phase: Array) -> Array:
        return self._properties(phase=phase[None], p=self._p)["angle"].full().T

    @cached_property
    def _angle_rates(self) -> "casadi.Function":
        import casadi

        phase = casadi.SX.sym("phase")  # pyright: ignore[reportAttributeAccessIssue]
        angle = self._properties(phase=phase, p=self._p)["angle"]
        rate = casadi.jacobian(angle, phase)
        return casadi.Function("rates", [phase], [rate, casadi.jacobian(rate, phase)])

    def _rates(self, phase: Array) -> tuple[Array, Array]:
        """First and second derivative (m, links) of the links' angles by the phase."""
        rate, second = (each.full().T for each in self._angle_rates(phase[None]))
        return rate, second

    def require_motion(self) -> None:
        """Raise NoMotionError where the links stand still, or their elements have frequencies only."""
        if not self.module.MOVES:
            raise NoMotionError(
                f"{self.name} is a structure of which only the frequencies are known; "
                f"run: python -m solve frequencies {self.name}"
            )
        if EXACT in self.beams.freedoms.kinds:
            raise NoMotionError(
                f"element {EXACT} of {self.name} has frequencies, but no equations of motion; "
                "choose another element"
            )
        if any(link.inextensible for link in self.beams.freedoms.links):
            raise NoMotionError(
                f"{self.name} has inextensible links, of which only the frequencies are known; "
                "let them stretch"
            )

    @cached_property
    def _equation(self) -> Motion:
        chosen = {name: self.options[name] for name, *_ in self.module.MOTION_OPTIONS}
        return Motion(self.beams, self._rates, self.period, **chosen)

    def _motion(self, phase: Array, speed: float) -> Sequence[Array]:
        self.require_motion()
        return self._equation(phase, speed)
