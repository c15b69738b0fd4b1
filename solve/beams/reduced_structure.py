"""Beam structure whose links are reduced to their interface coordinates and lowest modes."""

from collections.abc import Sequence
from functools import cached_property
from typing import Self

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import Positions
from solve.beams.elements import EXACT
from solve.beams.frozen import shape
from solve.beams.motion import State
from solve.beams.reduced_motion import ReducedMotion
from solve.beams.reduction import basis
from solve.beams.structure import StructureModel, with_rates
from solve.contracts import ModeShape
from solve.errors import ValueOutOfBoundsError
from solve.model.modes import lowest_frequencies, modes
from solve.model.options import REDUCE
from solve.model.setup import Setup

_POSITIONS = 36
"""Positions of a period at which natural frequencies are compared."""

_TRUSTED = 0.5
"""Fraction of the lowest discarded frequency up to which natural frequencies are compared. The usual rule of
component mode synthesis retains modes up to twice the highest frequency of interest."""


class ReducedStructure(StructureModel):
    """Beam structure with reduced coordinates: displacements of the joints and rotations that links share, in
    ground axes, then the amplitudes of the modes of each link. Outputs, deflections, stresses and forces are
    computed from all degrees of freedom, q = T(φ) p."""

    static = False
    """Whether the basis also contains the static shapes of the discarded modes."""

    def __init__(self, setup: Setup, reduced: ReducedMotion):
        super().__init__(setup, reduced.full, reduced, reduced.basis.declared)
        self.reduced, self.reduction = reduced, self
        self.modes_a_link: int = setup.options[REDUCE]
        if not self.static:
            self.equation_warnings = (*self.equation_warnings, self.sentence)

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """Raises ValueOutOfBoundsError for a structure whose reduction error cannot be estimated, or for more
        modes than its links have; StructureError as the full structure does."""
        motion = cls._motion(setup)
        freedoms = motion.beams.freedoms
        if EXACT in freedoms.kinds:
            raise ValueOutOfBoundsError(
                f"reduce requires elements with finitely many modes, and {EXACT} has infinitely many; omit "
                "reduce, or choose another element"
            )
        if any(link.inextensible for link in freedoms.links):
            raise ValueOutOfBoundsError(
                f"reduce requires extensible links, and {setup.module.NAME} has inextensible ones; omit "
                "reduce"
            )
        return cls(setup, ReducedMotion(motion, basis(motion.beams, setup.options[REDUCE], cls.static)))

    @cached_property
    def enriched(self) -> "EnrichedStructure":
        """Structure with the static shapes of the discarded modes as additional coordinates."""
        return EnrichedStructure.of(self.setup)

    @property
    def full_coordinates(self) -> int:
        """Number of degrees of freedom before the reduction."""
        return self.beams.freedoms.n

    @property
    def discarded(self) -> float:
        """Lowest frequency in rad/s of the discarded modes, with the ends of the links fixed."""
        return min(link.discarded for link in self.reduced.basis.links)

    @cached_property
    def frequency_error(self) -> float:
        """Estimated relative error of the natural frequencies below half the lowest discarded one: the
        largest at 36 positions of a period, relative to those of the enriched structure."""
        phase = np.linspace(0.0, self.period, _POSITIONS, endpoint=False)
        own, better = self.frequencies(phase, self.n), self.enriched.frequencies(phase, self.n)
        compared = (better < _TRUSTED * self.discarded) & (better > 0)
        return float((np.abs(own / np.where(compared, better, 1.0) - 1) * compared).max(initial=0.0))

    @property
    def sentence(self) -> str:
        """Sentence on the error of the natural frequencies."""
        given = f"reduce={self.modes_a_link}"
        if self.n == self.full_coordinates:
            return f"{given} retains all {self.n} coordinates; the result is unchanged"
        return (
            f"{given}: natural frequencies below {_TRUSTED * self.discarded:.4g} rad/s, half of the lowest "
            f"discarded one, have relative errors of up to {self.frequency_error:.1e}"
        )

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        return [*self.equation_warnings, *super().warnings(speed, linear)]

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

    def varying(self, phase: Array, speed: Array, acceleration: float) -> tuple[Array, Array, Array, Array]:
        self.require_motion()
        return self.reduced(phase, speed[:, None], acceleration)

    def terms(self, phase: Array, speeds: Array) -> None:
        """None, since those of the motion are for all degrees of freedom."""
        return

    @property
    def freedoms(self) -> int:
        return self.n

    def frequencies(self, positions: Array, count: int) -> Array:
        return lowest_frequencies(*self.reduced.matrices(Positions(self.beams, positions)), count)

    def mode_shapes(self, position: float, frequencies: Array) -> list[ModeShape]:
        positions = Positions(self.beams, np.array([position]))
        T, vectors = self.reduced.basis.at(positions)[0], modes(*self.reduced.matrices(positions)).vectors[0]
        found: Sequence[Array] = (T @ vectors[:, : len(frequencies)]).T
        return [
            shape(positions, vector, 1.0, float(omega))
            for vector, omega in zip(found, frequencies, strict=True)
        ]


class EnrichedStructure(ReducedStructure):
    """Reduced structure with the static shapes of the discarded modes, for the error estimate."""

    static = True
