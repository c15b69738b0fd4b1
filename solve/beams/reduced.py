"""Structure of beams in reduced coordinates p of a basis, q = T(φ) p: equations of motion, and the model.

The equations are those of `solve.beams.motion` premultiplied by Tᵀ, so that a basis of all modes yields the
same motion:

    TᵀM T p̈ + (TᵀC T + 2 TᵀM Ṫ) ṗ + (TᵀK T + TᵀC Ṫ + TᵀM T̈) p = Tᵀd

In link axes, the terms of a link are constant, except those of damping and axial forces. The terms of damping
and axial forces are interpolated in the phase."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Self

import numpy as np

from solve.approximation import interpolated
from solve.arrays import Array, Latest, uniform_phases
from solve.beams.assembly import POSITIONS, Positions
from solve.beams.element import EXACT
from solve.beams.frequencies import shape
from solve.beams.motion import Motion, State, inertia_load
from solve.beams.reduction import Basis, basis
from solve.beams.structure import StructureModel, with_rates
from solve.capabilities import Capabilities
from solve.contracts import ModeShape
from solve.errors import ValueOutOfBoundsError
from solve.labels import require_motion
from solve.model.bounds import REDUCE
from solve.model.modes import lowest_frequencies, modes
from solve.model.setup import Setup


@dataclass(frozen=True)
class ReducedMotion:
    """Matrices M, C, K and load d of moving beams in reduced coordinates, at many phases."""

    full: Motion
    basis: Basis

    def __call__(
        self, phase: Array, speed: Array | float, acceleration: float = 0.0
    ) -> tuple[Array, Array, Array, Array]:
        """Return M, C, K (m, r, r) and d (m, r) at phases (m,). `speed` is Ω in rad/s, a number or (m, 1);
        `acceleration` is Ω̇ in rad/s²."""
        positions = self._positions(phase)
        rate, second = self.full.rates_in_time(phase, speed, acceleration)
        M, K = self.matrices(positions)
        d = np.einsum("mnr,mn->mr", self.basis.at(positions), inertia_load(positions, rate, second))
        turning, centrifugal = self._rotary
        first, turned, squared = (factor[..., None] * positions.terms for factor in (rate, second, rate**2))
        damping, carried = np.split(self._damping(phase), 2, axis=1)
        C = damping + self._dashpots + 2 * np.tensordot(first, turning, 2)
        K = K + np.tensordot(turned, turning, 2) + np.tensordot(squared, centrifugal, 2)
        K = K + np.reshape(speed, (-1, 1, 1)) * carried
        if self.full.stiffening == "on":
            K = K + self._geometric_stiffness(positions, speed, acceleration)
        return M, C, K, d

    def matrices(self, positions: Positions) -> tuple[Array, Array]:
        """Reduced matrices TᵀM T and TᵀK T (m, r, r) of links at rest."""
        M, K = (np.tensordot(positions.terms, table, 2) for table in self._elastic)
        return M, K

    @cached_property
    def _positions(self) -> Latest[Positions]:
        return Latest(partial(Positions, self.full.beams))

    @cached_property
    def _elastic(self) -> tuple[Array, Array]:
        """Tables of the mass and the stiffness, which include point masses and springs."""
        basis, beams = self.basis, self.full.beams
        by_link = [
            (
                link.reduced(link.body.assembled(member.mass)),
                link.reduced(link.body.assembled(member.stiffness)),
            )
            for link, member in zip(basis.links, beams.members, strict=True)
        ]
        M, K = (basis.spread(tables) for tables in zip(*by_link, strict=True))
        retained = np.ix_(basis.retained, basis.retained)
        b = len(basis.retained)
        M[0, 0, :b, :b] += beams.point_masses[retained]
        K[0, 0, :b, :b] += beams.springs[retained]
        return M, K

    @cached_property
    def _dashpots(self) -> Array:
        matrix, b = np.zeros((self.basis.r, self.basis.r)), len(self.basis.retained)
        matrix[:b, :b] = self.full.beams.dashpots[np.ix_(self.basis.retained, self.basis.retained)]
        return matrix

    @cached_property
    def _rotary(self) -> tuple[Array, Array]:
        """Return two tables: the coefficients of the terms 2ω ṗ and ω̇ p, and the coefficients of the term ω²
        p. The tables include the effects of the moving basis and, with terms=full, of the accelerations of
        the deflections."""
        turning, centrifugal = [], []
        for link in self.basis.links:
            body, (B, B2) = link.body, link.turned
            M = body.assembled(body.member.mass)
            N, Z = (body.assembled(local) for local in body.member.rotary)
            if self.full.terms != "full":
                N, Z = np.zeros_like(N), np.zeros_like(Z)
            turning.append(link.reduced(N) + link.reduced(M, right=B))
            centrifugal.append(link.reduced(Z) + 2 * link.reduced(N, right=B) + link.reduced(M, right=B2))
        return self.basis.spread(turning), self.basis.spread(centrifugal)

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        """Function that returns the reduced damping TᵀC T and TᵀC T′, concatenated to (m, 2r, r), where C is
        modal or Rayleigh damping."""
        damping = self.full.damping_at

        def projected(phase: Array) -> Array:
            positions = Positions(self.full.beams, phase)
            T, (carried, _) = self.basis.at(positions), self.basis.rates(positions, *self.full.rates(phase))
            product = np.swapaxes(T, 1, 2) @ damping(phase)
            return np.concatenate((product @ T, product @ carried), axis=1)

        return Latest(interpolated(projected, self.full.period))

    def _geometric_stiffness(self, positions: Positions, speed: Array | float, acceleration: float) -> Array:
        """Reduced geometric stiffness TᵀG T (m, r, r) of the axial forces."""
        at_speed, by_acceleration = np.split(self._axial(positions.phase), 2, axis=1)
        forces = np.asarray(speed) ** 2 * at_speed + acceleration * by_acceleration
        ends = np.cumsum([link.body.member.count for link in self.basis.links])[:-1]
        columns = self.basis.links, np.split(forces, ends, axis=1), self._geometric
        stiffness = np.zeros((len(positions.phase), self.basis.r, self.basis.r))
        for number, (link, by_element, table) in enumerate(zip(*columns, strict=True)):
            terms = by_element[..., None] * positions.terms[:, number, None]
            stiffness[:, link.at[:, None], link.at] += np.tensordot(terms, table, 2)
        return stiffness

    @cached_property
    def _axial(self) -> Callable[[Array], Array]:
        """Function that returns axial forces (m, 2 elements). The first half contains the forces in all
        elements at a constant speed of 1 rad/s. The second half contains the forces at speed 0 with an
        acceleration of 1 rad/s²."""

        def forces(phase: Array) -> Array:
            positions = Positions(self.full.beams, phase)
            rate, second = self.full.rates(phase)
            _, K = positions.matrices()
            loads = ((rate, second), (np.zeros_like(rate), rate))
            return np.concatenate(
                [
                    force
                    for load in loads
                    for force in self.full.axial_forces(positions, K, inertia_load(positions, *load))
                ],
                axis=1,
            )

        return Latest(interpolated(forces, self.full.period))

    @cached_property
    def _geometric(self) -> list[Array]:
        """For each link, the geometric stiffness (elements, 5, r, r) per unit axial force of each element."""
        return [
            np.stack([link.reduced(A) for A in link.body.assembled_singly(link.body.member.geometric)])
            for link in self.basis.links
        ]


_TRUSTED = 0.5
"""Largest frequency up to which natural frequencies are compared, as a fraction of the lowest discarded
frequency. By the usual rule of component mode synthesis, modes up to twice the highest frequency of interest
are retained."""


class ReducedStructure(StructureModel):
    """Beam structure with reduced coordinates: displacements of the joints and shared rotations of links in
    ground axes, followed by the modal amplitudes of each link.

    Outputs, deflections, stresses and forces are computed from all degrees of freedom, q = T(φ) p."""

    static = False
    """Whether the basis also contains the static shapes of the discarded modes."""

    def __init__(self, setup: Setup, reduced: ReducedMotion):
        super().__init__(setup, reduced.full, reduced, reduced.basis.declared)
        self.reduced = reduced
        self.modes_a_link: int = setup.options[REDUCE]
        if not self.static:
            sentences = (*self.labels.equation_warnings, self.sentence)
            self.labels = replace(self.labels, equation_warnings=sentences)

    @classmethod
    def from_setup(cls, setup: Setup) -> Self:
        """Reduced structure from a setup. Raises ValueOutOfBoundsError if the reduction error cannot be
        estimated, or if more modes are requested than the links have. Raises StructureError as the full
        structure does."""
        motion = cls._motion(setup)
        freedoms = motion.beams.freedoms
        if EXACT in freedoms.kinds:
            raise ValueOutOfBoundsError(
                f"'reduce' requires elements with finitely many modes, and the element '{EXACT}' has "
                "infinitely many; omit 'reduce', or choose another element"
            )
        if any(link.inextensible for link in freedoms.links):
            raise ValueOutOfBoundsError(
                f"'reduce' requires extensible links, and {setup.module.NAME} has inextensible ones, which "
                "constrain several joints together, so that no link has a basis of its own; omit 'reduce'"
            )
        return cls(setup, ReducedMotion(motion, basis(motion.beams, setup.options[REDUCE], cls.static)))

    @cached_property
    def enriched(self) -> "EnrichedStructure":
        """Structure with additional coordinates, the amplitudes of the static shapes of the discarded
        modes."""
        return EnrichedStructure.from_setup(self.setup)

    @property
    def full_coordinates(self) -> int:
        """Number of degrees of freedom before the reduction."""
        return self.beams.freedoms.n

    @property
    def discarded(self) -> float:
        """Lowest frequency in rad/s of the discarded modes. They are modes of links with fixed ends."""
        return min(link.discarded for link in self.reduced.basis.links)

    @cached_property
    def frequency_error(self) -> float:
        """Estimated relative error of the natural frequencies below half of the lowest discarded frequency.
        It is the largest difference from the frequencies of the enriched structure at 36 positions of a
        period."""
        phase = uniform_phases(POSITIONS, self.period)
        reduced, enriched = self.frequencies(phase, self.n), self.enriched.frequencies(phase, self.n)
        compared = (enriched < _TRUSTED * self.discarded) & (enriched > 0)
        relative = np.abs(reduced / np.where(compared, enriched, 1.0) - 1)
        return float((relative * compared).max(initial=0.0))

    @property
    def sentence(self) -> str:
        """Sentence about the error of the natural frequencies."""
        option = f"reduce={self.modes_a_link}"
        if self.n == self.full_coordinates:
            return f"{option} retains all {self.n} coordinates; the result is unchanged"
        return (
            f"{option}: natural frequencies below {_TRUSTED * self.discarded:.4g} rad/s, half of the lowest "
            f"discarded frequency, have relative errors of up to {self.frequency_error:.1e}"
        )

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        return [*self.labels.equation_warnings, *super().warnings(speed, linear)]

    def expanded(self, phase: Array, speed: Array | float, *state: Array, acceleration: float = 0.0) -> State:
        positions = Positions(self.beams, phase)
        rates = self.motion.rates_in_time(phase, np.reshape(speed, (-1, 1)), acceleration)
        T, (first, second) = self.reduced.basis.at(positions), self.reduced.basis.rates(positions, *rates)
        p, pd, pdd = with_rates(state)

        def product(A: Array, x: Array) -> Array:
            return np.einsum("knr,rk->nk", A, x)

        q, qd = product(T, p), product(T, pd) + product(first, p)
        qdd = product(T, pdd) + 2 * product(first, pd) + product(second, p)
        return State(self.motion, phase, speed, q, qd, qdd, acceleration)

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(reduction=self)

    def _varying_at(
        self, phase: Array, speed: Array, acceleration: float
    ) -> tuple[Array, Array, Array, Array]:
        require_motion(self)
        return self.reduced(phase, speed[:, None], acceleration)

    def terms(self, phase: Array, speeds: Array) -> None:
        """Return None, because the terms of the motion belong to all degrees of freedom, not to reduced
        coordinates."""
        return

    @property
    def freedoms(self) -> int:
        return self.n

    def frequencies(self, positions: Array, count: int) -> Array:
        return lowest_frequencies(*self.reduced.matrices(Positions(self.beams, positions)), count)

    def mode_shapes(self, position: float, frequencies: Array) -> list[ModeShape]:
        positions = Positions(self.beams, np.array([position]))
        T, vectors = self.reduced.basis.at(positions)[0], modes(*self.reduced.matrices(positions)).vectors[0]
        deflections = (T @ vectors[:, : len(frequencies)]).T
        return [
            shape(positions, vector, 1.0, float(omega))
            for vector, omega in zip(deflections, frequencies, strict=True)
        ]


class EnrichedStructure(ReducedStructure):
    """Reduced structure with the static shapes of the discarded modes. It is used to estimate the reduction
    error."""

    static = True
