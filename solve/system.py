"""A linear system with periodic coefficients, M(Ωt)q″ + C(Ωt)q′ + K(Ωt)q = d(Ωt) (chapter Eq. (2))."""

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError, ValueOutOfBoundsError
from solve.trigonometric import Trigonometric

if TYPE_CHECKING:
    from solve.results.orbit import Turn

Matrices = tuple[Array, Array, Array, Array]

_PERIODIC = 1e-9
"""Relative difference between the matrices at both ends of the period that counts as none."""


class PeriodicSystem:
    """Matrices over the phase φ = Ωt, and the names of the coordinates.

    matrices(phase, speed): for phases of shape (m,) and a speed Ω in rad/s returns M, C, K of shape
    (m, n, n) and d of shape (m, n), in SI units, for derivatives by time.
    coordinates: n names. period: of the matrices, in phase. breaks: phases where the matrices jump;
    they are always ends of steps, and matrices are sampled on either side only.

    >>> import numpy as np
    >>> def oscillator(phase, speed):
    ...     one = np.ones((len(phase), 1, 1))
    ...     return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]
    >>> PeriodicSystem(oscillator, ["q"]).n
    1
    """

    name = "system"
    outputs: tuple[str, ...] = ()
    """Names of the quantities that follow from the state; units and meanings hold theirs too."""
    units: Mapping[str, str] = MappingProxyType({})
    meanings: Mapping[str, str] = MappingProxyType({})

    def __init__(
        self,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[str],
        period: float = 2 * math.pi,
        breaks: Sequence[float] = (),
    ):
        if not (math.isfinite(period) and period > 0):
            raise ValueOutOfBoundsError(f"period is {period}; allowed: a finite phase > 0, such as 2π")
        if len(set(coordinates)) != len(coordinates) or len(coordinates) == 0:
            raise ValueOutOfBoundsError(
                f"coordinates are {list(coordinates)}; give each of the n coordinates a name of its own"
            )
        if not all(math.isfinite(b) for b in breaks):
            raise ValueOutOfBoundsError(f"breaks are {list(breaks)}; allowed: finite phases")
        self._matrices = matrices
        self.coordinates = tuple(coordinates)
        self.period = float(period)
        self.breaks = tuple(float(b) for b in breaks)

    @classmethod
    def from_samples(
        cls, M: Array, C: Array, K: Array, d: Array, coordinates: Sequence[str], period: float = 2 * math.pi
    ) -> "PeriodicSystem":
        """From samples (k, n, n), d (k, n) on a uniform grid over the period without its end point.

        Between the samples the matrices are their trigonometric interpolant, so that at least as many
        samples are needed as twice the highest harmonic that matters. They hold for the speed at
        which they were taken; a sweep over speeds needs a function instead.
        """
        if not (math.isfinite(period) and period > 0):
            raise ValueOutOfBoundsError(f"period is {period}; allowed: a finite phase > 0, such as 2π")
        try:
            samples = [np.asarray(part).astype(float, casting="same_kind") for part in (M, C, K, d)]
        except (TypeError, ValueError) as error:
            raise MatricesError(f"the samples are no four real arrays M, C, K, d: {error}") from None
        counts = {len(part) if part.ndim else 0 for part in samples}
        if len(counts) != 1 or 0 in counts:
            raise MatricesError(
                f"samples of M, C, K, d have shapes {[part.shape for part in samples]}; "
                "give the same number of phases, 1 or more, first in each"
            )
        curves = [Trigonometric(part, period) for part in samples]

        def matrices(phase: Array, speed: float) -> Matrices:
            M, C, K, d = (curve(phase) for curve in curves)
            return M, C, K, d

        return cls(matrices, coordinates, period)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinates)

    def at(self, phase: Array, speed: float) -> Matrices:
        """M, C, K (m, n, n) and d (m, n) at phases (m,), for derivatives by time.

        Raises MatricesError where the function gives something else, or NaN or infinite entries.
        """
        given = self._matrices(phase, speed)
        try:
            M, C, K, d = (np.asarray(part).astype(float, casting="same_kind", copy=False) for part in given)
        except (TypeError, ValueError) as error:
            raise MatricesError(f"the matrices are no four real arrays M, C, K, d: {error}") from None
        for symbol, part in zip("MCKd", (M, C, K, d), strict=True):
            if not np.isfinite(part).all():
                first = int(np.argmin(np.isfinite(part).reshape(len(part), -1).all(axis=1)))
                raise MatricesError(
                    f"{symbol} has NaN or infinite entries at phase {phase[first % len(phase)]:.6g}; "
                    "check the parameters and the function that gives the matrices"
                )
        return M, C, K, d

    def in_phase(self, phase: Array, speed: float) -> Matrices:
        """The same for derivatives by the phase: Ω²M, ΩC, K, d."""
        M, C, K, d = self.at(phase, speed)
        return speed**2 * M, speed * C, K, d

    def output_values(self, phase: Array, speed: float, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
        """Outputs (k,) by name at phases (k,) and states q, q̇, q̈ (n, k), derivatives by time."""
        return {}

    def doubts(self, speed: float) -> list[str]:
        """Warnings about the equations themselves at a speed, whatever their solution."""
        return []

    def concerns(self, turn: "Turn") -> list[str]:
        """Warnings where a solution leaves the bounds within which the model is trusted."""
        return []

    def state_rate(self, phase: Array, speed: float) -> Array:
        """(P | f) of x′ = P x + f in phase time, x = (q, dq/dphase): (m, 2n, 2n+1), chapter Eq. (5)."""
        M, C, K, d = self.in_phase(phase, speed)
        n = self.n
        rate = np.zeros((len(phase), 2 * n, 2 * n + 1))
        rate[:, range(n), range(n, 2 * n)] = 1.0
        rate[:, n:] = np.linalg.solve(M, np.concatenate((-K, -C, d[..., None]), axis=-1))
        return rate

    def acceleration(self, phase: Array, speed: float, x: Array) -> Array:
        """Second derivative by the phase (m, n) that the equation of motion gives to states x (m, 2n)."""
        rate = self.state_rate(phase, speed)[:, self.n :]
        return np.squeeze(rate[..., :-1] @ x[..., None], -1) + rate[..., -1]

    def fastest(self, phase: Array, speed: float) -> float:
        """Largest frozen angular frequency or decay rate, by phase: sqrt of the spectral radius of
        M⁻¹K, or the spectral radius of M⁻¹C, at the phases (k,)."""
        M, C, K, _ = self.in_phase(phase, speed)
        stiffness, damping = (np.abs(np.linalg.eigvals(np.linalg.solve(M, A))).max() for A in (K, C))
        return float(max(np.sqrt(stiffness), damping))

    def frozen_eigenvalues(self, speed: float, count: int = 128) -> Array:
        """Eigenvalues (count, 2n) of P, by phase, with the coefficients frozen at `count` phases."""
        phase = (np.arange(count) + 0.5) * (self.period / count)
        return np.linalg.eigvals(self.state_rate(phase, speed)[..., :-1])

    def checked(self, speed: float) -> None:
        """Raise MatricesError unless the matrices have their shapes and are periodic, and M can be
        inverted."""
        n, inset = self.n, 1e-12 * self.period
        jumps_at_zero = any(abs(math.remainder(b, self.period)) <= inset for b in self.breaks)
        phase = np.array([0.0, 0.281, 0.618, 1.0]) * self.period
        if self.breaks:
            phase[[0, -1]] += [inset, -inset]
        parts = dict(zip("MCKd", self.at(phase, speed), strict=True))
        for symbol, part in parts.items():
            expected = (4, n) if symbol == "d" else (4, n, n)
            if part.shape != expected:
                raise MatricesError(
                    f"{symbol} at 4 phases has shape {part.shape}; for {n} coordinates "
                    f"({', '.join(self.coordinates)}) it must be {expected}"
                )
            change = np.abs(part[-1] - part[0]).max()
            if not jumps_at_zero and change > _PERIODIC * np.abs(part).max():
                raise MatricesError(
                    f"{symbol} is not periodic: between phase 0 and {self.period:.6g} it changes by "
                    f"{change:.3g}; give the right period, or the jump at 0 as a break"
                )
        self._check_inertia(parts["M"])

    def _check_inertia(self, M: Array) -> None:
        diagonal = np.sqrt(np.abs(np.einsum("kii->ki", M)))
        diagonal[diagonal == 0.0] = 1.0
        scaled = M / (diagonal[:, :, None] * diagonal[:, None, :])
        if np.linalg.cond(scaled).max() > 0.1 / np.finfo(float).eps:
            raise MatricesError(
                "M is singular: some coordinate has no inertia; give every coordinate a mass, "
                "or leave a massless coordinate out"
            )
