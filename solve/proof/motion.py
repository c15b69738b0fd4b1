"""A nonlinear orbit as a trigonometric polynomial, and the equations linearised about it.

The equations of motion are r(φ, Ω, q, q̇, q̈) = 0. About a motion q̄, the deviation u = q − q̄ satisfies

    ∂r/∂q̈ ü + ∂r/∂q̇ u̇ + ∂r/∂q u = −r(q̄) − N(u),    N(u) = r(q̄ + u) − r(q̄) − Dr(q̄) u.

The coefficients and r(q̄) are known functions of the phase, because q̄ is known exactly."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi
import numpy as np

from solve.arrays import EPS, Array
from solve.equations import nonlinear_of
from solve.errors import NoOrbitError
from solve.methods.fourier import Fourier
from solve.model.model import LinearisedModel
from solve.period.curve import FourierCurve
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from solve.proof.balls import (
    Ball,
    Matrix,
    acb,
    acb_mat,
    arb,
    arb_mat,
    arb_series,
    coefficient,
    precision,
    working_bits,
    working_terms,
)
from solve.system import PeriodicSystem
from solve.threads import symbolic

_FIRST_SAMPLES = 49
"""Initial number of samples per period. It is doubled until the highest harmonics are round-off. Chosen by
judgement."""

_MOST_UNKNOWNS = 5000
"""Largest size of the dense system of equations of a Newton correction. Chosen by judgement: its solution
takes about 20 s."""

_CORRECTIONS = 2
"""Number of Newton corrections on a grid. The initial orbit has seven correct digits, and each correction
doubles their number."""

_TAIL, _ROUNDOFF = 1 / 8, 64 * EPS
"""Fraction of the harmonics that must be below round-off, and the round-off relative to the largest harmonic.
Chosen by judgement."""

_ORDERS = 3
"""Number of functions of a motion: q and its first two time derivatives."""

_PARTS, _TERMS = 2, 32
"""Number of intervals of the period per harmonic, and number of terms of the Taylor polynomial on each
interval. The remainder is below π^32/32! = 3e-20, multiplied by the sum of the harmonics."""

_DROPPED = 1e-3 * EPS
"""Size, relative to the largest harmonic, below which harmonics are omitted. Chosen by judgement."""


@dataclass(frozen=True)
class TrigonometricMotion:
    """Motion q(φ) = Σ_k a_k cos(2πkφ/T) + b_k sin(2πkφ/T) with exact coefficients.

    cosines, sines (n, K+1): a_k and b_k. period: T, a ball."""

    cosines: Array
    sines: Array
    period: Ball

    @classmethod
    def from_curve(cls, curve: FourierCurve, period: Ball) -> "TrigonometricMotion":
        """Motion with the Fourier coefficients of a curve. Harmonics far below round-off are omitted."""
        c = curve.coefficients
        limits = _DROPPED * np.abs(c).max(axis=1, keepdims=True)
        large = np.flatnonzero((np.abs(c) > limits).any(axis=0))
        c = c[:, : large[-1] + 1] if len(large) else c[:, :1]
        return cls(np.real(c), -np.imag(c), period)

    @property
    def curve(self) -> FourierCurve:
        """Curve of this motion in double precision."""
        nodes = np.array([0.0, float(self.period.mid())])
        return FourierCurve(nodes, self.cosines - 1j * self.sines)

    @cached_property
    def _rate(self) -> Ball:
        return 2 * arb.pi() / self.period

    @cached_property
    def _weights(self) -> Matrix:
        """Factors (3n, 2K+2) of the cosines and sines in q, dq/dφ and d²q/dφ². Differentiation of a cos + b
        sin replaces (a, b) by 2πk/T (b, −a)."""
        a, b, rows = self.cosines, self.sines, []
        for order in range(_ORDERS):
            powers = [(k * self._rate) ** order for k in range(a.shape[1])]
            for pair in zip(a.tolist(), b.tolist(), strict=True):
                rows.append([arb(x) * power for each in pair for x, power in zip(each, powers, strict=True)])
            a, b = b, -a
        return arb_mat(rows)

    def states(self, phase: Ball, orders: int = _ORDERS) -> list[list[Ball]]:
        """Return q and its derivatives with respect to the phase. The phase is a real or complex ball, or a
        power series."""
        if isinstance(phase, arb_series):
            return self._series(phase[0], phase[1], orders)
        angle, count = phase * self._rate, self.cosines.shape[1]
        sines, cosines = zip(*((angle * k).sin_cos() for k in range(count)), strict=True)
        matrix = acb_mat if isinstance(phase, acb) else arb_mat
        values = (self._weights * matrix(2 * count, 1, [*cosines, *sines])).entries()
        n = len(self.cosines)
        return [values[order * n : (order + 1) * n] for order in range(orders)]

    def _series(self, phase: Ball, slope: Ball, orders: int) -> list[list[Ball]]:
        """Power series in t of q and its derivatives at phases φ + t·slope. With V_k = c_k exp(2πikφ/T), the
        coefficient of t^j is Re Σ_k V_k (2πik·slope/T)^j/j!."""
        terms, count = working_terms(), self.cosines.shape[1]
        waves = [(self._rate * phase * k).sin_cos() for k in range(count)]
        turned = [
            [
                [cos * x + sin * y for (sin, cos), x, y in zip(waves, a, b, strict=True)],
                [cos * y - sin * x for (sin, cos), x, y in zip(waves, a, b, strict=True)],
            ]
            for a, b in zip(self.cosines.tolist(), self.sines.tolist(), strict=True)
        ]
        columns = arb_mat([half for pair in turned for half in pair]).transpose()
        powers = self._powers(slope, terms + orders) * columns
        found: list[list[Ball]] = [[] for _ in range(orders)]
        for i in range(len(turned)):
            # The derivatives of a cos + b sin with respect to the angle at 0 are a, b, −a, −b, …
            series = [powers[j, 2 * i + j % 2] * (-1 if j % 4 > 1 else 1) for j in range(terms + orders)]
            for order in range(orders):
                found[order].append(arb_series(series[:terms]))
                series = [(j + 1) * c / slope for j, c in enumerate(series[1:])]
        return found

    def _powers(self, slope: Ball, terms: int) -> Matrix:
        """Table of (2πk·slope/T)^j/j!, with j along the rows and k along the columns."""
        rates = [self._rate * slope * k for k in range(self.cosines.shape[1])]
        rows = [[arb(1)] * len(rates)]
        for j in range(1, terms):
            rows.append([power * rate / j for power, rate in zip(rows[-1], rates, strict=True)])
        return arb_mat(rows)

    def at(self, phases: Array) -> list[list[Ball]]:
        """Coordinates q (n, k) at phases (k,)."""
        return [self.states(arb(phase), 1)[0] for phase in phases.tolist()]

    def polynomials(self) -> list[list[tuple[list[Ball], Ball]]]:
        """Taylor polynomials of each coordinate on equal intervals of the period, with bounds on the
        remainders.

        The variable is the fraction of the interval. After J terms, the remainder is at most Σ_k (|a_k| +
        |b_k|) (2πkh/T)^J/J!."""
        parts = _PARTS * self.cosines.shape[1]
        length, errors = self.period / parts, []
        with precision(working_bits(), _TERMS):
            last = self._powers(length, _TERMS + 1).table()[-1]
            for pair in zip(self.cosines.tolist(), self.sines.tolist(), strict=True):
                sizes = (abs(arb(x)) + abs(arb(y)) for x, y in zip(*pair, strict=True))
                rest = sum((size * power for size, power in zip(sizes, last, strict=True)), arb(0))
                errors.append(rest.upper())
            found: list[list[tuple[list[Ball], Ball]]] = [[] for _ in errors]
            for part in range(parts):
                (rows,) = self.states(arb_series([part * length, length]), 1)
                for pieces, series, error in zip(found, rows, errors, strict=True):
                    pieces.append(([coefficient(series, term) for term in range(_TERMS)], error))
        return found


def harmonics_of(system: LinearisedModel, speed: float) -> FourierCurve:
    """Trigonometric polynomial for the orbit about which `system` is linearised. The harmonics decrease to
    round-off. Raises NoOrbitError if too many harmonics are required."""
    n, T = system.n, system.period
    count = round(T / system.model.period) * _FIRST_SAMPLES
    while n * count <= _MOST_UNKNOWNS:
        grid = Grid.uniform(count | 1, T)
        phases = grid.nodes[:-1]
        curve = FourierCurve.through(grid.nodes, system.motion(phases, 0).T)
        for _ in range(_CORRECTIONS):
            q, _ = Fourier().collocated(SinglePoint(nonlinear_of(system).along(curve), speed), phases)
            curve = FourierCurve.through(grid.nodes, q)
        sizes = np.abs(curve.coefficients).max(axis=0)
        last = sizes[-max(1, int(_TAIL * len(sizes))) :]
        if last.max() <= _ROUNDOFF * sizes.max():
            return curve
        count *= 2
    raise NoOrbitError(
        f"the orbit has more than {_MOST_UNKNOWNS // (2 * n)} harmonics above round-off; a proof of a "
        "nonlinear orbit requires fewer harmonics"
    )


def corrected(
    motion: TrigonometricMotion, nodes: Array, at: Callable[[Ball], list[Array]]
) -> TrigonometricMotion:
    """Apply one Newton correction to the motion.

    The defect is evaluated in ball arithmetic of high precision, so that cancellation of forces loses no
    digits. at: function that returns M, C, K and the defect at a phase."""
    phases = [motion.period * k / (len(nodes) - 1) for k in range(len(nodes) - 1)]
    matrices = [np.array(part) for part in zip(*map(at, phases), strict=True)]
    names = [f"q{i}" for i in range(motion.cosines.shape[0])]
    system = PeriodicSystem(lambda phase, speed: matrices, names, float(nodes[-1]))
    q, _ = Fourier().collocated(SinglePoint(system, 1.0), nodes[:-1])
    correction, c = FourierCurve.through(nodes, q).coefficients, motion.curve.coefficients
    whole = correction.copy()
    whole[:, : c.shape[1]] += c
    return TrigonometricMotion.from_curve(FourierCurve(nodes, whole), motion.period)


def _residual(residual: casadi.Function) -> tuple[list[Any], Any, list[Any]]:
    """Return the symbolic inputs, the residual r (n,), and the inputs q, qd and qdd."""
    inputs = [casadi.SX.sym(residual.name_in(i), *residual.size_in(i)) for i in range(residual.n_in())]
    (r,) = residual.call(inputs, True, False)
    return inputs, r, inputs[2:5]


@symbolic
def linearised_about(residual: casadi.Function) -> casadi.Function:
    """Function of phase, speed, q, qd, qdd and parameters that returns ∂r/∂q̈, ∂r/∂q̇, ∂r/∂q and −r."""
    inputs, r, (q, qd, qdd) = _residual(residual)
    outputs: list[casadi.SX] = [*(casadi.jacobian(r, x) for x in (qdd, qd, q)), -r]
    return casadi.Function("linearised_about", inputs, casadi.cse(outputs))


@symbolic
def second_derivatives(residual: casadi.Function) -> casadi.Function:
    """Function that returns ∂²r_i/∂v_a∂v_b with v = (q, qd, qdd), in row a n + i and column b, and r.

    The residual r is included because its derivatives do not reveal kinks and jumps, such as the kink of |q|.
    """
    inputs, r, states = _residual(residual)
    v = casadi.vertcat(*states)
    jacobian = casadi.vec(casadi.jacobian(r, v))
    outputs: list[casadi.SX] = [casadi.jacobian(jacobian, v), r]
    return casadi.Function("second_derivatives", inputs, casadi.cse(outputs))
