"""Continuous curves of solutions over the phase: piecewise polynomials or Fourier series.

Arrays may have a leading axis of points, here `…`. Each point has its own curve; all curves have the same
nodes."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar, Self

import numpy as np

from solve.arrays import Array, uniform_phases

_QUINTIC = np.linalg.inv(
    # Rows: q, q', q'' at the step's start, then at its end; columns: powers 0 … 5 of θ.
    np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 2, 0, 0, 0],
            [1, 1, 1, 1, 1, 1],
            [0, 1, 2, 3, 4, 5],
            [0, 0, 2, 6, 12, 20],
        ],
        dtype=float,
    )
)


_CUBIC = np.zeros((6, 4))
_CUBIC[:4] = np.linalg.inv(
    # Rows: q, q' at the step's start, then at its end; columns: powers 0 … 3 of θ.
    np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 1, 2, 3]], dtype=float)
)

_ALIKE = 4e-13
"""Tolerance per step of the grid: on m steps, two fractions of a step count as equal if they differ by at
most m times this value. The tolerance exceeds round-off and the small displacement of phases at jumps."""


@dataclass(frozen=True)
class PeriodicCurve(ABC):
    """Periodic curves. `nodes` (m+1,) are phases from 0 to the period.

    The curves are linear in `coefficients`, whose axis of the n coordinates is followed by `_AXES` axes.
    drift (…, n): steady velocity of a free machine with respect to the phase. It is contained in the first
    derivative but not in q."""

    nodes: Array
    coefficients: Array
    drift: Array | None = None

    _AXES: ClassVar[int]

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.coefficients.shape[-1 - self._AXES]

    @cached_property
    def finite(self) -> Array:
        """Whether each curve (…) is finite."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.coefficients.sum(axis=tuple(range(-1 - self._AXES, 0))))

    @property
    @abstractmethod
    def mean(self) -> Array:
        """Mean over the period (…, n)."""

    @abstractmethod
    def antiderivative(self) -> Self:
        """Return the periodic antiderivative of q minus its mean. The mean of the antiderivative is zero."""

    def __getitem__(self, points: Any) -> Self:
        """Curves of a selection of points, or of one point."""
        drift = None if self.drift is None else self.drift[points]
        return type(self)(self.nodes, self.coefficients[points], drift)

    @abstractmethod
    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        """Return q, or a derivative of q with respect to the phase, as (…, n, k) at phases (k,) in any
        period."""

    @abstractmethod
    def sampled(self, a_step: int, derivative: int = 0) -> Array:
        """Return q, or a derivative of q, as (…, n, m · a_step). The phases divide each step into `a_step`
        equal intervals and include its start."""

    @abstractmethod
    def each(self, phase: Array, derivative: int = 0) -> Array:
        """Return q, or a derivative of q, as (…, n, k) at phases (…, n, k) that differ between
        coordinates."""

    def combined(self, rows: Array) -> Self:
        """Return the products of rows (P, r, n) and the coordinates of P curves, as r new coordinates without
        drift."""
        points, n, *others = self.coefficients.shape
        products = rows @ self.coefficients.reshape(points, n, -1)
        return type(self)(self.nodes, products.reshape(points, -1, *others))

    def plus(self, other: Self) -> Self:
        """Return the sum of these curves and `other`, without drift. The curves `other` have the same kind
        and nodes; their number of coefficients may differ."""
        fewer, more = sorted((self.coefficients, other.coefficients), key=lambda each: each.shape[-1])
        total = more.copy()
        total[..., : fewer.shape[-1]] += fewer
        return type(self)(self.nodes, total)

    def shifted(self, level: Array, drift: Array | None = None) -> Self:
        """Return the sum with constants `level` (…, n). The result has the given drift."""
        coefficients = self.coefficients.copy()
        coefficients[..., 0] += level.reshape(*level.shape, *[1] * (self._AXES - 1))
        return type(self)(self.nodes, coefficients, drift)


@dataclass(frozen=True)
class Curve(PeriodicCurve):
    """Piecewise polynomial q(phase), in powers of θ = (phase - node)/h on each step.

    coefficients: (…, n, m, degree+1), lowest power first. known_finite (…): whether the coefficients are
    finite; None if not yet determined."""

    known_finite: Array | None = None

    _AXES = 2

    @classmethod
    def quintic(cls, nodes: Array, q: Array, v: Array, a_start: Array, a_end: Array) -> "Curve":
        """Quintic Hermite interpolant with error O(h^6), from q and v = dq/dphase at the nodes (…, m+1, n)
        and second derivatives at both ends of each step (…, m, n)."""
        h = np.diff(nodes)[:, None]
        starts, ends = np.s_[..., :-1, :], np.s_[..., 1:, :]
        data = (q[starts], h * v[starts], h**2 * a_start, q[ends], h * v[ends], h**2 * a_end)
        return cls.from_steps(nodes, np.stack(data, axis=-1), _QUINTIC)

    @classmethod
    def cubic(cls, nodes: Array, q: Array, v_start: Array, v_end: Array) -> "Curve":
        """Cubic Hermite interpolant with error O(h^4), from q at the nodes (…, m+1, n) and first derivatives
        at both ends of each step (…, m, n). It is stored with six coefficients per step, like the result of
        `quintic`."""
        h = np.diff(nodes)[:, None]
        data = (q[..., :-1, :], h * v_start, q[..., 1:, :], h * v_end)
        return cls.from_steps(nodes, np.stack(data, axis=-1), _CUBIC)

    @classmethod
    def from_steps(cls, nodes: Array, data: Array, powers: Array) -> "Curve":
        """Curve from r numbers per step and coordinate, `data` (…, m, n, r). The matrix `powers` (D, r)
        converts these numbers to coefficients of powers of θ."""
        return cls(nodes, np.swapaxes(data, -3, -2) @ powers.T)

    def joined(self, other: "Curve") -> "Curve":
        """Curve of the coordinates of this curve, followed by the coordinates of `other`, which has the same
        nodes."""
        return Curve(self.nodes, np.concatenate((self.coefficients, other.coefficients), axis=-3))

    @cached_property
    def h(self) -> Array:
        """Lengths of the steps (m,)."""
        return np.diff(self.nodes)

    @cached_property
    def finite(self) -> Array:
        return super().finite if self.known_finite is None else self.known_finite

    @property
    def mean(self) -> Array:
        powers = 1 / np.arange(1, self.coefficients.shape[-1] + 1)
        return np.asarray((self.coefficients @ powers) @ self.h / self.nodes[-1])

    def antiderivative(self) -> "Curve":
        powers = np.arange(1, self.coefficients.shape[-1] + 1)
        coefficients = np.zeros((*self.coefficients.shape[:-1], len(powers) + 1))
        coefficients[..., 1:] = self.shifted(-self.mean).coefficients * self.h[:, None] / powers
        gained = coefficients.sum(axis=-1)
        coefficients[..., 0] = np.cumsum(gained, axis=-1) - gained
        found = Curve(self.nodes, coefficients)
        return found.shifted(-found.mean)

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        return self.states(phase, (derivative,))[0]

    def states(
        self, phase: Array, derivatives: Sequence[int] = (0, 1, 2), beside_nodes: bool = False
    ) -> list[Array]:
        """Return q and its derivatives with respect to the phase, each (…, n, k), at phases (k,) in any
        period.

        beside_nodes: whether phases that differ from a node only by round-off are distinguished from it."""
        phase, h = np.asarray(phase, dtype=float), self.h
        theta = None if beside_nodes else self._fractions(phase, h)
        if theta is not None:
            shape = *self.coefficients.shape[:-2], phase.size
            found = [self._within(theta, h, each).reshape(shape) for each in derivatives]
        else:
            step, theta = self._places(phase)
            pieces, h = np.take(self.coefficients, step, axis=-2), h[step]
            found = [_horner(pieces, theta, each) / h**each for each in derivatives]
        return [with_drift(values, self.drift, each) for values, each in zip(found, derivatives, strict=True)]

    def _fractions(self, phase: Array, h: Array) -> Array | None:
        """Return the positions (s,) of the phases within a step, as fractions of the step. Return None if the
        fractions differ between steps. They are the same, for example, for the stages of a method."""
        m = len(h)
        if phase.ndim != 1 or not phase.size or phase.size % m:
            return None
        theta = (phase.reshape(m, -1) - self.nodes[:-1, None]) / h[:, None]
        same = theta[m // 2]
        alike = np.abs(theta - same).max() <= _ALIKE * m and np.abs(2 * same - 1).max() <= 1 + _ALIKE * m
        return same if alike else None

    def basis(self, phase: Array, derivative: int = 0) -> tuple[Array, Array]:
        """Return the index (k,) of the step that contains each phase, and the derivatives (k, degree+1) of
        the powers of θ at each phase."""
        step, theta = self._places(np.asarray(phase, dtype=float))
        D, h = self.coefficients.shape[-1], self.h[step]
        powers = theta[:, None] ** np.maximum(np.arange(D) - derivative, 0)
        return step, _falling(D, derivative) * powers / h[:, None] ** derivative

    def sampled(self, a_step: int, derivative: int = 0) -> Array:
        values = self._within(np.arange(a_step) / a_step, self.h, derivative)
        values = values.reshape(*values.shape[:-2], values.shape[-2] * a_step)
        return with_drift(values, self.drift, derivative)

    def within(self, theta: Array, derivative: int = 0) -> Array:
        """Return a derivative of the curve, without drift, as (…, n, m, s) at the fractions `theta` (s,) of
        each step."""
        return self._within(theta, self.h, derivative)

    def _within(self, theta: Array, h: Array, derivative: int) -> Array:
        """Return a derivative as (…, n, m, s) at the fractions `theta` (s,) of each step, for step lengths h
        (m,)."""
        D = self.coefficients.shape[-1]
        powers = theta ** np.arange(max(D - derivative, 0))[:, None]
        values = self.coefficients[..., derivative:] @ (_falling(D, derivative)[derivative:, None] * powers)
        if derivative:
            values /= h[:, None] ** derivative
        return values

    def each(self, phase: Array, derivative: int = 0) -> Array:
        step, theta = self._places(phase)
        *_, m, D = self.coefficients.shape
        curves = np.arange(math.prod(step.shape[:-1])).reshape(*step.shape[:-1], 1)
        pieces = np.take(self.coefficients.reshape(-1, D), m * curves + step, axis=0)
        value = _horner(pieces, theta, derivative)
        return with_drift(value / self.h[step] ** derivative, self.drift, derivative) if derivative else value

    def _places(self, phase: Array) -> tuple[Array, Array]:
        """Return the index of the step that contains each phase, and the fraction of that step. Phases may
        lie in any period."""
        nodes, last = self.nodes, len(self.nodes) - 2
        wrapped = np.mod(phase, nodes[-1])
        if self._uniform:
            step = np.minimum((wrapped * ((last + 1) / nodes[-1])).astype(int), last)
            step += (wrapped >= nodes[step + 1]).astype(int) - (wrapped < nodes[step])
        else:
            step = np.searchsorted(nodes, wrapped, side="right") - 1
        step = np.clip(step, 0, last)
        return step, (wrapped - nodes[step]) / (nodes[step + 1] - nodes[step])

    @cached_property
    def _uniform(self) -> bool:
        return bool(np.ptp(self.h) <= 1e-12 * self.nodes[-1])


def with_drift(values: Array, drift: Array | None, derivative: int) -> Array:
    """Add the contribution of a steady velocity `drift` (…, n) to a derivative of q, `values` (…, n, k).
    `derivative` is its order."""
    return values if drift is None or derivative != 1 else values + drift[..., None]


def _horner(pieces: Array, theta: Array, derivative: int) -> Array:
    """Derivative with respect to θ of polynomials (…, D) at θ (…)."""
    factors = _falling(pieces.shape[-1], derivative)
    value = factors[-1] * pieces[..., -1]
    for power in range(pieces.shape[-1] - 2, derivative - 1, -1):
        value *= theta
        value += factors[power] * pieces[..., power] if derivative else pieces[..., power]
    return value


@cache
def _falling(powers: int, count: int) -> Array:
    """Falling factorials p (p - 1) … with `count` factors, for the powers p = 0, 1, … below `powers`."""
    return np.array([math.perm(power, count) for power in range(powers)], dtype=float)


@dataclass(frozen=True)
class FourierCurve(PeriodicCurve):
    """Fourier series q(phase) = Re Σ_k coefficients[…, k] exp(ik 2π phase/period), with complex coefficients
    (…, n, N+1)."""

    _AXES = 1

    @classmethod
    def through(cls, nodes: Array, q: Array) -> "FourierCurve":
        """Trigonometric interpolant of q (m, n) at m uniform nodes, m odd. `nodes` also contains the end of
        the period."""
        coefficients = 2.0 * np.fft.rfft(q, axis=0).T / len(q)
        coefficients[:, 0] /= 2.0
        return cls(nodes, coefficients)

    @property
    def mean(self) -> Array:
        return np.real(self.coefficients[..., 0])

    def antiderivative(self) -> "FourierCurve":
        rates = self._rates
        rates[0] = np.inf
        return FourierCurve(self.nodes, self.coefficients / rates)

    def __call__(self, phase: Array, derivative: int = 0) -> Array:
        rates = self._rates
        waves = np.exp(np.outer(rates, np.asarray(phase, dtype=float))) * rates[:, None] ** derivative
        return with_drift(np.real(self.coefficients @ waves), self.drift, derivative)

    def sampled(self, a_step: int, derivative: int = 0) -> Array:
        count = (len(self.nodes) - 1) * a_step
        return self(uniform_phases(count, self.nodes[-1]), derivative)

    def each(self, phase: Array, derivative: int = 0) -> Array:
        rates = self._rates
        waves = np.exp(phase[..., None] * rates) * rates**derivative
        values = np.real(np.squeeze(waves @ self.coefficients[..., None], -1))
        return with_drift(values, self.drift, derivative)

    @property
    def _rates(self) -> Array:
        return 2j * np.pi / self.nodes[-1] * np.arange(self.coefficients.shape[-1])


_FEWEST = 256
"""Minimum number of states per revolution for interpolation. Chosen by judgement."""


def curves_through(nodes: Array, motions: Array) -> Curve:
    """Return one interpolating curve per revolution. `motions` (turns, 3, n, k) contains q and its first and
    second derivatives at the nodes (k,)."""
    q, v, a = np.moveaxis(motions, 1, 0).swapaxes(-1, -2)
    return Curve.quintic(nodes, q, v, a[:, :-1], a[:, 1:])


def interpolation_tolerance(rtol: float) -> float:
    """Allowed error of the interpolation between given states: rtol/10, but at least 1e-9 and at most
    1e-3."""
    return min(max(rtol / 10, 1e-9), 1e-3)


def interpolation_error(nodes: Array, motions: Array, jumps: bool) -> Array:
    """Estimate the interpolation error (turns,) of the curves through `motions` (turns, 3, n, k). It is
    relative to the maximum of each coordinate and of each derivative.

    Curves through every second state are compared with the states between. The differences are extrapolated
    to curves through all states: the errors of q and its first and second derivatives are proportional to the
    sixth, fifth and fourth power of the step length. Only a tenth of the error of the second derivative is
    counted. If the equations have jumps (`jumps`), all errors are assumed proportional to the second power,
    and second derivatives are not compared."""
    coarse, off = curves_through(nodes[::2], motions[..., ::2]), np.zeros(len(motions))
    for order in range(2 if jumps else 3):
        size = np.abs(motions[:, order]).max(axis=(0, 2), initial=0.0)[:, None]
        missed = np.abs(coarse(nodes[1::2], order) - motions[:, order, :, 1::2])
        part = (missed / np.where(size > 0, size, 1.0)).max(axis=(1, 2)) / 2 ** (2 if jumps else 6 - order)
        off = np.maximum(off, part / 10 if order == 2 else part)
    return off


def sufficient_strides(nodes: Array, motions: Array, jumps: bool, allowed: float) -> Array:
    """Return the largest sufficient stride of each revolution (turns,), a power of 2. With a sufficient
    stride s, the interpolation error of the curve through every s-th state is at most `allowed`."""
    strides, stride = np.ones(len(motions), dtype=int), 2
    while stride * _FEWEST <= len(nodes) - 1:
        error = interpolation_error(nodes[::stride], motions[..., ::stride], jumps)
        strides[(error <= allowed) & (strides == stride // 2)] = stride
        stride *= 2
    return strides
