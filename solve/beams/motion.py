"""Equations of motion of a beam structure with moving links (thesis, Eqs. (4.32), (6.15)).

Coordinates are displacements from the rigid positions, in ground axes. The matrix R, with R′ = J R,
transforms from ground axes to link axes. The angular velocity and acceleration of the link are ω and ω̇. In
link axes, the terms of an element are M δ̈ + 2ωP δ̇ + (K + ω̇P − ω²M) δ with the skew-symmetric P (thesis,
Eq. (4.22)). Substitution of δ = R q adds these terms to the damping and the stiffness in ground axes:

    damping:    2ω Rᵀ(M J + P) R
    stiffness:  Rᵀ[ω̇(M J + P) + ω²(M J² + 2 P J − M)] R

The load is the inertia force of the rigid motion, −M q̈_r. Damping consists of modal or Rayleigh damping with
a single ratio ζ (section 6.2 of the thesis), and of dashpots to the ground."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from solve.approximation import interpolated
from solve.arrays import Array, Latest, uniform_phases
from solve.beams.assembly import POSITIONS, Beams, Positions
from solve.beams.element import AXIAL
from solve.beams.links import HELD, Member
from solve.model.modes import lowest_frequencies, modal_damping


def rigid_accelerations(positions: Positions, rate: Array, second: Array) -> tuple[list[Array], Array]:
    """Return the accelerations q̈_r of the rigid motion of the links and of the joints.

    For each link, there is an array (m, elements, k) for its degrees of freedom in link axes. For the joints,
    there is one array (m, joints) of x + iy. rate, second (m, links): first and second derivatives of the
    angles with respect to time. If derivatives with respect to the phase are given instead, the results are
    q̈_r/Ω² at constant Ω. The accelerations of fixed degrees of freedom are included.
    """
    spans = positions.beams.properties.length * (1j * second - rate**2)
    joints, accelerations = positions.placed(spans * np.exp(1j * positions.angle)), []
    for number, member in enumerate(positions.beams.members):
        start, span = joints[:, member.start, None], spans[:, number, None]
        backwards = np.exp(-1j * positions.angle[:, number, None])
        local = np.zeros((len(positions.phase), *member.indices.shape))
        for i, freedom in enumerate(member.element.freedoms):
            if freedom.order == 0:
                fraction = (np.arange(member.count) + freedom.xi) / member.count
                acceleration = start * backwards + fraction * span
                axial = freedom.direction == AXIAL
                local[:, :, i] = np.real(acceleration) if axial else np.imag(acceleration)
            elif freedom.order == 1:
                local[:, :, i] = second[:, number, None]
        accelerations.append(local)
    return accelerations, joints


def inertia_load(positions: Positions, rate: Array, second: Array) -> Array:
    """Inertia load −M q̈_r (m, n) of elements and joint masses. rate, second: see `rigid_accelerations`."""
    beams, freedoms = positions.beams, positions.beams.freedoms
    load = np.zeros((len(positions.phase), freedoms.n + 1))
    accelerations, joints = rigid_accelerations(positions, rate, second)
    for member, local in zip(beams.members, accelerations, strict=True):
        ground = local @ member.mass.T @ member.rotations(positions.angle)
        for row, force in zip(member.indices, np.swapaxes(ground, 0, 1), strict=True):
            load[:, row] -= force
    for xy, mass, acceleration in zip(freedoms.joint_indices, beams.properties.mass, joints.T, strict=True):
        load[:, xy] -= mass * np.stack((acceleration.real, acceleration.imag), axis=1)
    return load[:, :HELD]


def _rayleigh(beams: Beams, period: float) -> Callable[[Array], Array]:
    """Function that returns the Rayleigh damping matrix C = αM + βK (m, n, n) at phases (m,). At their mean
    frequencies over a revolution, the two lowest modes have the damping ratio ζ."""
    phase = uniform_phases(POSITIONS, period)
    first, second = lowest_frequencies(*Positions(beams, phase).matrices(), 2).mean(axis=0)
    ratio = 2 * beams.properties.damping_ratio / (first + second)

    def damping(phase: Array) -> Array:
        M, K = Positions(beams, phase).matrices()
        return ratio * first * second * M + ratio * K

    return damping


def _modal(beams: Beams, _: float) -> Callable[[Array], Array]:
    """Function that returns the modal damping matrix C = MΦ diag(2ζω) ΦᵀM (m, n, n) at phases (m,). C is 2ζ
    times the geometric mean of M and K. As a function of the phase, it is as smooth as M and K."""
    ratio, n = beams.properties.damping_ratio, beams.freedoms.n
    if ratio == 0:
        return lambda phase: np.zeros((len(phase), n, n))
    return lambda phase: modal_damping(*Positions(beams, phase).matrices(), ratio)


_DAMPING = {"modal": _modal, "rayleigh": _rayleigh}


_CHUNK_BYTES = 2**23
"""Memory, in bytes, of the matrices that `Motion.speed_terms` computes in one chunk of phases. Without
chunks, the allocation of arrays for a whole grid would take a third of the time (measured with 27 coordinates
and 3840 phases). Half and twice this size are equally fast."""

_BUCKLING_POSITIONS = 180
"""Number of positions per revolution at which axial forces are checked for buckling. Chosen by judgement."""

_HALF_WAVES = {0: 1.0, 1: 0.5, 2: 2.0}
"""Number of half waves of a buckled link, for 0, 1 and 2 clamped ends. Without clamped ends, both ends are
pinned; with one, the other end is free."""


@dataclass(frozen=True)
class Motion:
    """Matrices M, C, K and load d of moving beams at many phases.

    rates: function that returns the first and second derivatives (m, links) of the angles of the links with
    respect to the phase."""

    beams: Beams
    rates: Callable[[Array], tuple[Array, Array]]
    period: float
    terms: str
    stiffening: str
    damping: str

    def __call__(
        self, phase: Array, speed: Array | float, acceleration: float = 0.0
    ) -> tuple[Array, Array, Array, Array]:
        """Return M, C, K (m, n, n) and d (m, n) at phases (m,). `speed` is Ω in rad/s, a number or (m, 1);
        `acceleration` is Ω̇ in rad/s²."""
        positions = self._positions(phase)
        rate, second = self.rates_in_time(phase, speed, acceleration)
        M, K = positions.matrices()
        d = speed**2 * self._unit_load(phase)
        if acceleration:
            d += acceleration * inertia_load(positions, np.zeros_like(rate), self.rates(phase)[0])
        C = self._damping(phase) + self.beams.dashpots
        axial = self.axial_forces(positions, K, d) if self.stiffening == "on" else None
        if self.terms == "full":
            gyroscopic, stiffness = self._of_rotation(positions, rate, second)
            C, K = C + gyroscopic, K + stiffness
        if axial is not None:
            K = K + self._of_axial_forces(positions, axial)
        return M, C, K, d

    def speed_terms(self, phase: Array) -> Array:
        """At constant speed, the entries of Ω²M, ΩC and K in row order, and then of d, are polynomials in the
        speed. Return their coefficients (m, R) at phases (m,). Derivatives of q are with respect to the
        phase. `speed_powers` returns the entry and the power of each coefficient."""
        coefficients = np.empty((len(phase), len(self._nonzero[0])))
        size = max(1, _CHUNK_BYTES // (8 * 5 * self.beams.freedoms.n**2))
        for first in range(0, len(phase), size):
            self._write_speed_terms(phase[first : first + size], coefficients[first : first + size])
        return coefficients

    def _write_speed_terms(self, phase: Array, coefficients: Array) -> None:
        """Write the coefficients at phases (m,) into `coefficients` (m, R)."""
        positions, (rate, second) = self._positions(phase), self.rates(phase)
        M, K = positions.matrices()
        d = self._unit_load(phase)
        gyroscopic = stiffness = np.zeros_like(K)
        if self.terms == "full":
            gyroscopic, stiffness = self._of_rotation(positions, rate, second)
        if self.stiffening == "on":
            axial = self.axial_forces(positions, K, d)
            stiffness = stiffness + self._of_axial_forces(positions, axial)
        parts = M, self._damping(phase) + self.beams.dashpots, gyroscopic, K, stiffness, d
        entries = np.concatenate([coefficient.reshape(len(coefficient), -1) for coefficient in parts], axis=1)
        # The mode "clip", unlike "raise", writes into the output without a copy.
        np.take(entries, self._nonzero[0], axis=1, out=coefficients, mode="clip")

    @property
    def speed_powers(self) -> tuple[Array, Array]:
        """For each coefficient of `speed_terms`, return the index (R,) of its entry, in ascending order, and
        its power (R,) of the speed."""
        return self._nonzero[1:]

    @cached_property
    def _nonzero(self) -> tuple[Array, Array, Array]:
        """For the coefficients that are nonzero at some phase, return their positions in a list of all
        coefficients, the indices of their entries (ascending), and their powers of the speed.

        The list contains the entries of M, damping, gyroscopic matrix, stiffness, rotational stiffness and
        load."""
        n, damped = self.beams.freedoms.n, self.beams.properties.damping_ratio != 0
        tables = self.beams.mass, self.beams.stiffness, *self._rotary
        mass, elastic, turning, centrifugal = (np.any(table != 0, axis=(0, 1)) for table in tables)
        full = np.full((n, n), self.terms == "full")
        geometric = np.any([np.any(table != 0, axis=(0, 1)) for table in self._geometric], axis=0)
        stiffness = full & (turning | centrifugal) | (self.stiffening == "on") & geometric
        # Modal damping couples all coordinates.
        damping = damped & (mass | elastic | (self.damping == "modal")) | (self.beams.dashpots != 0)
        masks = mass, damping, full & turning, elastic, stiffness, np.ones(n, dtype=bool)
        of_matrices = [np.arange(n * n) + part * n * n for part in (0, 1, 1, 2, 2)]
        entry = np.concatenate([*of_matrices, np.arange(n) + 3 * n * n])
        power = np.repeat([2, 1, 2, 0, 2, 2], [n * n] * 5 + [n])
        present = np.flatnonzero(np.concatenate([mask.ravel() for mask in masks]))
        present = present[np.argsort(entry[present], kind="stable")]
        return present, entry[present], power[present]

    def _of_rotation(self, positions: Positions, rate: Array, second: Array) -> tuple[Array, Array]:
        """Contributions (m, n, n) of the rotation of the links to C and to K. rate, second (m, links): first
        and second derivatives of the angles."""
        first, turned, squared = (factor[..., None] * positions.terms for factor in (rate, second, rate**2))
        turning, centrifugal = self._rotary
        stiffness = np.tensordot(turned, turning, 2) + np.tensordot(squared, centrifugal, 2)
        return 2 * np.tensordot(first, turning, 2), stiffness

    def _of_axial_forces(self, positions: Positions, axial: list[Array]) -> Array:
        """Contribution (m, n, n) of the axial forces to K. `axial` contains the axial forces (m, elements)
        for each link."""
        by_link = zip(axial, self._geometric, strict=True)
        stiffness = [
            np.tensordot(forces[..., None] * positions.terms[:, number, None], table, 2)
            for number, (forces, table) in enumerate(by_link)
        ]
        return np.sum(stiffness, axis=0)

    def rates_in_time(self, phase: Array, speed: Array | float, acceleration: float) -> tuple[Array, Array]:
        """Angular velocities ω and angular accelerations ω̇ of the links, (m, links) each. For the arguments,
        see `__call__`."""
        rate, second = self.rates(phase)
        return speed * rate, speed**2 * second + acceleration * rate

    def axial_forces(self, positions: Positions, K: Array, d: Array) -> list[Array]:
        """For each link, the mean quasi-static axial force (m, elements) in its elements, tension
        positive."""
        q = np.linalg.solve(K, d[..., None])[..., 0].T
        forces = []
        for member in self.beams.members:
            ends = member.shapes(np.array([0.0, 1.0]))[0]
            forces.append(member.local(positions.angle, q) @ (ends[1] - ends[0]) * (member.EA / member.L))
        return forces

    def unit_axial_forces(self, positions: Positions) -> list[Array]:
        """Result of `axial_forces` at 1 rad/s. Multiply it by the square of the speed."""
        load = self._unit_load(positions.phase)
        return self.axial_forces(positions, positions.matrices()[1], load)

    def buckling_warnings(self, speed: float) -> list[str]:
        """Warnings about links whose compression at a speed (rad/s) exceeds the Euler load."""
        phase, forces = self._compression
        warnings = []
        for member, force in zip(self.beams.members, forces.T, strict=True):
            clamped = member.link[3:5].count("")
            euler = (_HALF_WAVES[clamped] * np.pi / (member.count * member.L)) ** 2 * member.EI
            worst = int(np.argmax(force))
            compression = speed**2 * force[worst]
            if compression > euler:
                warnings.append(
                    f"stiffening: at {np.degrees(phase[worst]):.4g} deg the compression of link "
                    f"{member.link.name} is {compression:.4g} N, above its Euler load of {euler:.4g} "
                    "N; the link may buckle, which a linear model does not describe: lower the speed, "
                    "or give the link a stiffer section"
                )
        return warnings

    @cached_property
    def _compression(self) -> tuple[Array, Array]:
        """Return phases (m,), and for each link the largest compression among its elements at 1 rad/s, as an
        array (m, links)."""
        phase = uniform_phases(_BUCKLING_POSITIONS, self.period)
        forces = self.unit_axial_forces(Positions(self.beams, phase))
        return phase, np.stack([-by_element.min(axis=1) for by_element in forces], axis=1)

    @cached_property
    def _positions(self) -> "Latest[Positions]":
        return Latest(partial(Positions, self.beams))

    @cached_property
    def _unit_load(self) -> "Latest[Array]":
        """Load d (m, n) at a constant speed of 1 rad/s. Multiply it by the square of the speed."""
        return Latest(lambda phase: inertia_load(self._positions(phase), *self.rates(phase)))

    @cached_property
    def damping_at(self) -> Callable[[Array], Array]:
        """Function that returns the damping matrix C (m, n, n) of the links at phases (m,)."""
        return _DAMPING[self.damping](self.beams, self.period)

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        """Function that returns the damping matrix. Modal damping is computed once, at a few hundred
        positions, and interpolated for all speeds."""
        if self.damping == "modal" and self.beams.properties.damping_ratio:
            return Latest(interpolated(self.damping_at, self.period))
        return Latest(self.damping_at)

    @cached_property
    def _rotary(self) -> tuple[Array, Array]:
        """Tables (links, 5, n, n) of the two matrices of `Member.rotary`: for each link, the coefficients of
        1, c, s, c², cs."""
        beams = self.beams
        tables = [[beams.spread(member, local) for local in member.rotary] for member in beams.members]
        turning, centrifugal = np.swapaxes(tables, 0, 1)
        return turning, centrifugal

    @cached_property
    def _geometric(self) -> list[Array]:
        """For each link, tables (elements, 5, n, n) of the geometric stiffness per unit axial force of each
        element."""
        return [self.beams.spread_singly(member, member.geometric) for member in self.beams.members]


@dataclass(frozen=True)
class State:
    """State of the beams at phases (k,): q, q̇, q̈ (n, k), with derivatives with respect to time. speed: a
    number or (k,), in rad/s. acceleration: acceleration of the drive in rad/s²."""

    motion: Motion
    phase: Array
    speed: Array | float
    q: Array
    qd: Array
    qdd: Array
    acceleration: float = 0.0

    @cached_property
    def positions(self) -> Positions:
        """Rigid positions of the links."""
        return Positions(self.motion.beams, self.phase)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """Angular velocities ω and accelerations ω̇ (k, links) of the links."""
        return self.motion.rates_in_time(self.phase, np.reshape(self.speed, (-1, 1)), self.acceleration)

    @cached_property
    def axial_forces(self) -> list[Array]:
        """For each link, the quasi-static axial force (k, elements) in its elements, tension positive."""
        load = inertia_load(self.positions, *self.rates)
        return self.motion.axial_forces(self.positions, self.positions.matrices()[1], load)

    @cached_property
    def rigid_accelerations(self) -> list[Array]:
        """For each link, the accelerations (k, elements, freedoms) of the rigid motion in link axes."""
        return rigid_accelerations(self.positions, *self.rates)[0]

    def local(self, member: Member, element: int, order: int = 0) -> Array:
        """Degrees of freedom (k, freedoms) of an element in link axes, or their time derivatives of order
        `order` (1 or 2). Results are cached, because several outputs use them."""
        first = element % member.count
        key = member.number, first, order
        if key not in self._local:
            q = (self.q, self.qd, self.qdd)[order]
            self._local[key] = member.local(self.positions.angle, q, slice(first, first + 1))[:, 0]
        return self._local[key]

    @cached_property
    def _local(self) -> dict[tuple[int, int, int], Array]:
        return {}

    @cached_property
    def joint_forces(self) -> dict[tuple[int, int], tuple[Array, Array, Array]]:
        """Mapping from the index and the end of a link to the result of `joint_force`. Results are cached,
        because several outputs use them."""
        return {}

    def strain_energy(self) -> Array:
        """Elastic strain energy ½ qᵀ K q (k,) of the links, in J."""
        energy = np.zeros(len(self.phase))
        for member in self.motion.beams.members:
            for element in range(member.count):
                local = self.local(member, element)
                energy += ((local @ member.stiffness) * local).sum(axis=1) / 2
        return energy
