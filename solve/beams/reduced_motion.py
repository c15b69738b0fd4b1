"""Equations of motion of a structure in the reduced coordinates p of a basis, q = T(φ) p.

They are the equations of `solve.beams.motion` premultiplied by Tᵀ, so that a basis of all modes gives the
same motion:

    TᵀM T p̈ + (TᵀC T + 2 TᵀM Ṫ) ṗ + (TᵀK T + TᵀC Ṫ + TᵀM T̈) p = Tᵀd

The terms of a link are constant in its axes, except damping and axial forces, which are interpolated in the
phase.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import Positions
from solve.beams.motion import Latest, Motion, inertia_load
from solve.beams.reduction import Basis
from solve.trigonometric import interpolated


@dataclass(frozen=True)
class ReducedMotion:
    """M, C, K, d of moving beams in reduced coordinates for all phases at once."""

    full: Motion
    basis: Basis

    def __call__(
        self, phase: Array, speed: Array | float, acceleration: float = 0.0
    ) -> tuple[Array, Array, Array, Array]:
        """M, C, K (m, r, r) and d (m, r) at phases (m,), Ω, one or (m, 1), in rad/s, Ω̇ in rad/s²."""
        positions = self._positions(phase)
        rate, second = self.full.rates_in_time(phase, speed, acceleration)
        M, K = self.matrices(positions)
        d = np.einsum("mnr,mn->mr", self.basis.at(positions), inertia_load(positions, rate, second))
        turning, centrifugal = self._rotary
        first, turned, squared = (each[..., None] * positions.terms for each in (rate, second, rate**2))
        damping, carried = np.split(self._damping(phase), 2, axis=1)
        C = damping + self._dashpots + 2 * np.tensordot(first, turning, 2)
        K = K + np.tensordot(turned, turning, 2) + np.tensordot(squared, centrifugal, 2)
        K = K + np.reshape(speed, (-1, 1, 1)) * carried
        if self.full.stiffening == "on":
            K = K + self._geometric_stiffness(positions, speed, acceleration)
        return M, C, K, d

    def matrices(self, positions: Positions) -> tuple[Array, Array]:
        """TᵀM T and TᵀK T (m, r, r) with the links at rest."""
        M, K = (np.tensordot(positions.terms, table, 2) for table in self._elastic)
        return M, K

    @cached_property
    def _positions(self) -> Latest[Positions]:
        return Latest(partial(Positions, self.full.beams))

    @cached_property
    def _elastic(self) -> tuple[Array, Array]:
        """Tables of mass and stiffness, with point masses and springs."""
        basis, beams = self.basis, self.full.beams
        own = [
            (
                link.reduced(link.body.assembled(member.mass)),
                link.reduced(link.body.assembled(member.stiffness)),
            )
            for link, member in zip(basis.links, beams.members, strict=True)
        ]
        M, K = (basis.spread(tables) for tables in zip(*own, strict=True))
        retained = np.ix_(basis.retained, basis.retained)
        b = len(basis.retained)
        M[0, 0, :b, :b] += beams.point_masses[retained]
        K[0, 0, :b, :b] += beams.springs[retained]
        return M, K

    @cached_property
    def _dashpots(self) -> Array:
        made, b = np.zeros((self.basis.r, self.basis.r)), len(self.basis.retained)
        made[:b, :b] = self.full.beams.dashpots[np.ix_(self.basis.retained, self.basis.retained)]
        return made

    @cached_property
    def _rotary(self) -> tuple[Array, Array]:
        """Tables multiplied by 2ω ṗ and ω̇ p, and by ω² p: contributions of the moving basis and, with
        terms=full, of the accelerations of the deflections."""
        turning, centrifugal = [], []
        for link in self.basis.links:
            body, (B, B2) = link.body, link.turned
            M = body.assembled(body.member.mass)
            N, Z = (body.assembled(each) for each in body.member.rotary)
            if self.full.terms != "full":
                N, Z = np.zeros_like(N), np.zeros_like(Z)
            turning.append(link.reduced(N) + link.reduced(M, right=B))
            centrifugal.append(link.reduced(Z) + 2 * link.reduced(N, right=B) + link.reduced(M, right=B2))
        return self.basis.spread(turning), self.basis.spread(centrifugal)

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        """TᵀC T and TᵀC T′ side by side, (m, 2r, r), of the modal or Rayleigh damping C."""
        damping = self.full.damping_at

        def projected(phase: Array) -> Array:
            positions = Positions(self.full.beams, phase)
            T, (carried, _) = self.basis.at(positions), self.basis.rates(positions, *self.full.rates(phase))
            product = np.swapaxes(T, 1, 2) @ damping(phase)
            return np.concatenate((product @ T, product @ carried), axis=1)

        return Latest(interpolated(projected, self.full.period))

    def _geometric_stiffness(self, positions: Positions, speed: Array | float, acceleration: float) -> Array:
        """TᵀG T (m, r, r) of the axial forces."""
        at_speed, by_acceleration = np.split(self._axial(positions.phase), 2, axis=1)
        forces = np.asarray(speed) ** 2 * at_speed + acceleration * by_acceleration
        each = np.split(forces, np.cumsum([link.body.member.count for link in self.basis.links])[:-1], axis=1)
        made = np.zeros((len(positions.phase), self.basis.r, self.basis.r))
        for number, (link, own, table) in enumerate(
            zip(self.basis.links, each, self._geometric, strict=True)
        ):
            terms = own[..., None] * positions.terms[:, number, None]
            made[:, link.at[:, None], link.at] += np.tensordot(terms, table, 2)
        return made

    @cached_property
    def _axial(self) -> Callable[[Array], Array]:
        """Axial forces in all elements at 1 rad/s, and at rest for 1 rad/s², (m, 2 elements)."""

        def forces(phase: Array) -> Array:
            positions = Positions(self.full.beams, phase)
            rate, second = self.full.rates(phase)
            _, K = positions.matrices()
            loads = ((rate, second), (np.zeros_like(rate), rate))
            return np.concatenate(
                [
                    each
                    for load in loads
                    for each in self.full.axial_forces(positions, K, inertia_load(positions, *load))
                ],
                axis=1,
            )

        return Latest(interpolated(forces, self.full.period))

    @cached_property
    def _geometric(self) -> list[Array]:
        """Geometric stiffness per unit axial force of each element, for each link, (elements, 5, r, r)."""
        return [
            np.stack([link.reduced(each) for each in link.body.assembled_singly(link.body.member.geometric)])
            for link in self.basis.links
        ]
