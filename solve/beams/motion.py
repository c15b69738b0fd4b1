"""Equations of motion of a structure of beams whose links move (thesis (4.32), (6.15)).

Coordinates are displacements from the rigid positions, in ground axes. With R from ground axes to a
link's, R′ = J R, and the link's ω and ω̇, an element has in its own axes (thesis (4.22), P skew)
M δ̈ + 2ωP δ̇ + (K + ω̇P − ω²M) δ; δ = R q makes of it

    C = 2ω Rᵀ(M J + P) R        K + Rᵀ[ω̇(M J + P) + ω²(M J² + 2 P J − M)] R

The load is the inertia of the rigid motion, −M q̈_r; damping comes from one ratio ζ (thesis 6.2).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import (
    Beams,
    Positions,
    Table,
    local_values,
    rotation,
    rotations,
    spread,
    spread_singly,
)
from solve.beams.elements import AXIAL, HELD
from solve.beams.frozen import lowest_frequencies, modes
from solve.trigonometric import interpolated


def rigid_accelerations(positions: Positions, rate: Array, second: Array) -> list[Array]:
    """q̈_r/Ω² of the elements' own freedoms in the axes of their links, (m, elements, k) for each link.

    rate, second (m, links): first and second derivative of the links' angles by the phase. Held freedoms
    accelerate too where their link does.
    """
    spans = _accelerated(positions, rate, second)
    joints = positions.placed(spans)
    return [_local(positions, number, joints, spans, second) for number in range(spans.shape[1])]


def inertia_load(positions: Positions, rate: Array, second: Array) -> Array:
    """−M q̈_r/Ω² (m, n) of the elements and of the joints' masses, at constant Ω."""
    beams, freedoms = positions.beams, positions.beams.freedoms
    load = np.zeros((len(positions.phase), freedoms.n + 1))
    for number, local in enumerate(rigid_accelerations(positions, rate, second)):
        member = beams.members[number]
        forces = local @ freedoms.elements[number].mass(member.L, member.mu).T
        ground = forces @ rotations(freedoms, number, positions.angle[:, number])
        for row, each in zip(freedoms.indices[number], np.swapaxes(ground, 0, 1), strict=True):
            load[:, row] -= each
    joints = positions.placed(_accelerated(positions, rate, second))
    masses = beams.properties.mass
    for (x, y), mass, acceleration in zip(freedoms.joint_indices, masses, joints.T, strict=True):
        load[:, x] -= mass * np.real(acceleration)
        load[:, y] -= mass * np.imag(acceleration)
    return load[:, :HELD]


def _accelerated(positions: Positions, rate: Array, second: Array) -> Array:
    """Second derivative by the phase of the vectors x + iy (m, links) along the links."""
    return positions.beams.properties.length * (1j * second - rate**2) * np.exp(1j * positions.angle)


def _local(positions: Positions, number: int, joints: Array, spans: Array, second: Array) -> Array:
    """Accelerations (m, elements, k) of a link's own freedoms, from those of the joints and spans."""
    beams, link = positions.beams, positions.beams.freedoms.links[number]
    names = [name for name, _ in beams.freedoms.joints]
    start, span = joints[:, names.index(link.start)], spans[:, number]
    count = beams.members[number].count
    backwards = np.exp(-1j * positions.angle[:, number])
    local = np.zeros((len(positions.phase), *beams.freedoms.indices[number].shape))
    for i, freedom in enumerate(beams.freedoms.elements[number].freedoms):
        if freedom.order == 0:
            place = (np.arange(count) + freedom.xi) / count
            along = (start[:, None] + place * span[:, None]) * backwards[:, None]
            local[:, :, i] = np.real(along) if freedom.direction == AXIAL else np.imag(along)
        elif freedom.order == 1:
            local[:, :, i] = second[:, None, number]
    return local


_AVERAGED = 36
"""Positions over which the lowest frequencies are averaged for Rayleigh damping."""


@dataclass(frozen=True)
class Rayleigh:
    """C = αM + βK that gives the two lowest modes, averaged over a turn, the ratio ζ."""

    beams: Beams
    period: float

    def __call__(self, phase: Array) -> Array:
        """C (m, n, n) at phases (m,)."""
        M, K = Positions(self.beams, phase).matrices()
        by_mass, by_stiffness = self._factors
        return by_mass * M + by_stiffness * K

    @cached_property
    def _factors(self) -> tuple[float, float]:
        """α (1/s) and β (s)."""
        phase = np.linspace(0.0, self.period, _AVERAGED, endpoint=False)
        first, second = lowest_frequencies(*Positions(self.beams, phase).matrices(), 2).mean(axis=0)
        ratio = 2 * self.beams.properties.damping_ratio / (first + second)
        return ratio * first * second, ratio


@dataclass(frozen=True)
class Modal:
    """C = MΦ diag(2ζω) ΦᵀM at every position: 2ζ times the geometric mean of M and K, as smooth in the
    phase as these are. So a few hundred positions give it at all others, once for all speeds."""

    beams: Beams
    period: float

    def __call__(self, phase: Array) -> Array:
        """C (m, n, n) at phases (m,)."""
        if self.beams.properties.damping_ratio == 0:
            return np.zeros((len(phase), self.beams.freedoms.n, self.beams.freedoms.n))
        return self._everywhere(phase)

    @cached_property
    def _everywhere(self) -> Callable[[Array], Array]:
        return interpolated(self._at_positions, self.period)

    def _at_positions(self, phase: Array) -> Array:
        return modal_damping(*Positions(self.beams, phase).matrices(), self.beams.properties.damping_ratio)


def modal_damping(M: Array, K: Array, ratio: float) -> Array:
    """C = MΦ diag(2ζω) ΦᵀM (m, n, n) that gives every mode of M and K (m, n, n) the ratio ζ."""
    frequencies, vectors = modes(M, K)
    shapes = M @ vectors
    return (shapes * (2 * ratio * frequencies)[:, None, :]) @ np.swapaxes(shapes, 1, 2)


@dataclass(frozen=True)
class Motion:
    """M, C, K, d of moving beams for all phases at once.

    rates(phase): first and second derivative (m, links) by the phase of the links' angles.
    """

    beams: Beams
    rates: Callable[[Array], tuple[Array, Array]]
    period: float
    terms: str
    stiffening: str
    damping: str

    def __call__(self, phase: Array, speed: float) -> tuple[Array, Array, Array, Array]:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), Ω in rad/s."""
        positions = Positions(self.beams, phase)
        rate, second = self.rates(phase)
        M, K = positions.matrices()
        d = speed**2 * inertia_load(positions, rate, second)
        C = self._damping(phase)
        axial = self.axial_forces(positions, K, d) if self.stiffening == "on" else None
        if self.terms == "full":
            turning, centrifugal = self._rotary
            C = C + 2 * turning(_rows((speed * rate)[..., None] * positions.terms))
            K = K + turning(_rows((speed**2 * second)[..., None] * positions.terms))
            K = K + centrifugal(_rows((speed**2 * rate**2)[..., None] * positions.terms))
        if axial is not None:
            K = K + self._geometric(self._axial_rows(positions, axial))
        return M, C, K, d

    def axial_forces(self, positions: Positions, K: Array, d: Array) -> list[Array]:
        """Mean quasi-static axial force (m, elements) in the elements of each link, tension positive."""
        q = np.linalg.solve(K, d[..., None])[..., 0].T
        freedoms, forces = self.beams.freedoms, []
        for number, member in enumerate(self.beams.members):
            local = local_values(freedoms, number, positions.angle[:, number], q)
            ends = freedoms.elements[number].displacement(member.L, np.array([0.0, 1.0]))[0]
            forces.append(local @ (ends[1] - ends[0]) * (member.EA / member.L))
        return forces

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        return {"modal": Modal, "rayleigh": Rayleigh}[self.damping](self.beams, self.period)

    def rotary(self, number: int) -> tuple[Array, Array]:
        """M J + P and M J² + 2 P J − M of a link's elements."""
        member, element = self.beams.members[number], self.beams.freedoms.elements[number]
        M, P = element.mass(member.L, member.mu), element.coupling(member.L, member.mu)
        J = rotation(element.freedoms)[2]
        return M @ J + P, M @ J @ J + 2 * P @ J - M

    @cached_property
    def _rotary(self) -> tuple[Table, Table]:
        """The same of the whole structure, for 1, c, s, c², cs of each link."""
        numbers = range(len(self.beams.members))
        tables = [
            [spread(self.beams.freedoms, number, each) for each in self.rotary(number)] for number in numbers
        ]
        turning, centrifugal = (Table(np.concatenate(each)) for each in zip(*tables, strict=True))
        return turning, centrifugal

    @cached_property
    def _geometric(self) -> Table:
        """Stiffness by unit axial force of every element, for 1, c, s, c², cs of its link."""
        freedoms = self.beams.freedoms
        tables = [
            np.concatenate(spread_singly(freedoms, number, element.geometric(member.L)))
            for number, (member, element) in enumerate(
                zip(self.beams.members, freedoms.elements, strict=True)
            )
        ]
        return Table(np.concatenate(tables))

    def _axial_rows(self, positions: Positions, axial: list[Array]) -> Array:
        each = [
            _rows(forces[..., None] * positions.terms[:, number, None]) for number, forces in enumerate(axial)
        ]
        return np.concatenate(each, axis=1)


def _rows(weights: Array) -> Array:
    """Weights (m, a, b) as rows (m, a b)."""
    return weights.reshape(len(weights), -1)


@dataclass(frozen=True)
class State:
    """Beams at phases (k,) and a speed (rad/s), with q, q̇, q̈ (n, k), derivatives by time."""

    motion: Motion
    phase: Array
    speed: float
    q: Array
    qd: Array
    qdd: Array

    @cached_property
    def positions(self) -> Positions:
        """The rigid positions."""
        return Positions(self.motion.beams, self.phase)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """First and second derivative (k, links) of the links' angles by the phase."""
        return self.motion.rates(self.phase)

    @cached_property
    def axial_forces(self) -> list[Array]:
        """Quasi-static axial force (k, elements) in the elements of each link, tension positive."""
        load = self.speed**2 * inertia_load(self.positions, *self.rates)
        return self.motion.axial_forces(self.positions, self.positions.matrices()[1], load)

    @cached_property
    def rigid_accelerations(self) -> list[Array]:
        """q̈_r of the elements' own freedoms in the axes of their links, (k, elements, freedoms) a link."""
        found = rigid_accelerations(self.positions, *self.rates)
        return [self.speed**2 * each for each in found]

    def strain_energy(self) -> Array:
        """½ qᵀ K q (k,) of the links' elastic stiffness, in J."""
        beams = self.motion.beams
        energy = np.zeros(len(self.phase))
        for number, member in enumerate(beams.members):
            local = local_values(beams.freedoms, number, self.positions.angle[:, number], self.q)
            K = beams.freedoms.elements[number].stiffness(member.L, member.EA, member.EI)
            energy += ((local @ K) * local).sum(axis=(1, 2)) / 2
        return energy


_POSITIONS = 180
"""Positions of a turn at which the axial forces are looked at."""

_HALF_WAVES = {0: 1.0, 1: 0.5, 2: 2.0}
"""Half waves of the buckled link by how many of its ends are clamped: both pinned; the other end free; both
clamped."""


@dataclass(frozen=True)
class Compression:
    """Quasi-static axial forces of moving beams, which grow with the square of the speed."""

    motion: Motion

    def warnings(self, speed: float) -> list[str]:
        """A sentence for each link whose compression at a speed (rad/s) exceeds Euler's load."""
        phase, forces = self._unit
        found = []
        for link, euler, force in zip(self.motion.beams.freedoms.links, self._euler, forces.T, strict=True):
            at = int(np.argmax(force))
            pressure = speed**2 * force[at]
            if pressure > euler:
                found.append(
                    f"stiffening: at {np.degrees(phase[at]):.4g} deg link {link.name} bears a compression of "
                    f"{pressure:.4g} N, beyond its Euler load of {euler:.4g} N; it may buckle there, which "
                    "no linear model follows: lower the speed, or give it a stiffer section"
                )
        return found

    @cached_property
    def _unit(self) -> tuple[Array, Array]:
        """Phases (m,), and the largest compression in each link's elements there at 1 rad/s, (m, links)."""
        phase = np.linspace(0.0, self.motion.period, _POSITIONS, endpoint=False)
        positions = Positions(self.motion.beams, phase)
        load = inertia_load(positions, *self.motion.rates(phase))
        forces = self.motion.axial_forces(positions, positions.matrices()[1], load)
        return phase, np.stack([-each.min(axis=1) for each in forces], axis=1)

    @property
    def _euler(self) -> Array:
        """(kπ/L)² EI (links,) for k half waves, N."""
        p, links = self.motion.beams.properties, self.motion.beams.freedoms.links
        waves = np.array([_HALF_WAVES[each[3:5].count("")] for each in links])
        return (waves * np.pi / p.length) ** 2 * p.EI
