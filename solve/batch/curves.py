"""Periodic solutions of many points on the same uniform grid."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array


@dataclass(frozen=True)
class Curves:
    """q as powers of θ = (phase - node)/h: coefficients (P, n, m, D), lowest first, on m steps."""

    coefficients: Array
    period: float

    @property
    def steps(self) -> int:
        return self.coefficients.shape[2]

    @property
    def h(self) -> float:
        return self.period / self.steps

    def __getitem__(self, points: Array) -> "Curves":
        return Curves(self.coefficients[points], self.period)

    def sampled(self, a_step: int, derivative: int = 0) -> Array:
        """q or a derivative by the phase at `a_step` phases from the start of every step on:
        (P, n, m · a_step)."""
        P, n, m = self.coefficients.shape[:3]
        theta = np.arange(a_step) / a_step
        values = self.coefficients[..., derivative:] @ self._powers(theta, derivative)
        return values.reshape(P, n, m * a_step)

    def through(self, phase: Array) -> Array:
        """q at phases (k,) that all points share: (P, n, k)."""
        place = phase / self.h
        step = np.minimum(place.astype(int), self.steps - 1)
        powers = (place - step)[:, None] ** np.arange(self.coefficients.shape[-1])
        return np.einsum("pnkd,kd->pnk", self.coefficients[:, :, step], powers)

    def at(self, phase: Array, derivative: int = 0) -> Array:
        """The same at phases (P, n, k) of their own."""
        place = np.mod(phase, self.period) / self.h
        step = np.minimum(place.astype(int), self.steps - 1)
        theta = place - step
        pieces = np.take_along_axis(self.coefficients, step[..., None], axis=2)
        value = np.zeros_like(theta)
        for power in range(pieces.shape[-1] - 1, derivative - 1, -1):
            value = value * theta + _falling(power, derivative) * pieces[..., power]
        return value / self.h**derivative

    def _powers(self, theta: Array, derivative: int) -> Array:
        powers = np.arange(derivative, self.coefficients.shape[-1])
        factors = np.array([_falling(power, derivative) for power in powers])
        return factors[:, None] * theta ** (powers - derivative)[:, None] / self.h**derivative


def _falling(power: int, count: int) -> float:
    """power (power - 1) … of `count` factors."""
    return float(np.prod(np.arange(power - count + 1, power + 1)))
