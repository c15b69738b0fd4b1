"""Proof of the existence of a nonlinear orbit near a trigonometric polynomial, and of its stability."""

import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import casadi
import numpy as np

from solve.arrays import Array
from solve.errors import NoOrbitError, ResonanceError, StepsError
from solve.model.model import LinearisedModel, Model
from solve.period.multipliers import UNDETERMINED, VERDICTS
from solve.proof.balls import Ball, Matrix, above, arb, arb_mat, below, largest, number, precision, widened
from solve.proof.curvature import sizes_of
from solve.proof.enclosure import GUARD_BITS, ROUNDED, assumption, bounds_of, discs_of, period_of, true_error
from solve.proof.equation import Equation
from solve.proof.existence import Existence, Linear, existence
from solve.proof.instructions import Instructions
from solve.proof.motion import (
    TrigonometricMotion,
    corrected,
    harmonics_of,
    linearised_about,
    second_derivatives,
)
from solve.proof.orbit import largest_modulus, states
from solve.proof.result import Proof, ProvedOrbit
from solve.proof.spectrum import multipliers, verdict
from solve.proof.transitions import transitions
from solve.proof.turn import Marching, homogeneous, turn
from solve.results.special_orbits import NonlinearOrbit

MOST_DIGITS = 12
"""Largest number of digits. With more digits, the discs of the multipliers would not shrink, because the
coefficients of the polynomial are doubles."""

_MOST_ADVANCE = 12.0
"""Largest h‖A‖ of a step. Chosen by judgement: the computing time for the cells of a step grows with the
square of their number."""

_SAMPLES = 32
"""Number of phases from which scales are computed. Chosen by judgement; it affects the widths of the
enclosures, not their validity."""


def enclosed_orbit(
    orbit: NonlinearOrbit,
    system: LinearisedModel,
    digits: int,
    rounded: bool,
    executor: Executor | None = None,
) -> Proof:
    """Prove results for a nonlinear orbit. `system` is the system linearised about the orbit. executor:
    executor that computes steps in parallel."""
    begun = time.process_time()
    bits, most = math.ceil(min(digits, MOST_DIGITS) * math.log2(10)) + GUARD_BITS, _MOST_ADVANCE
    marching = Marching(*(ROUNDED if rounded else (bits, most)), executor=executor)
    with precision(2 * bits):
        try:
            found = _prove_existence(orbit, system, marching, rounded)
        except (NoOrbitError, ResonanceError, StepsError) as error:
            return _unproved(orbit, str(error), time.process_time() - begun)
        discs = multipliers(found.Phi)
        index = verdict(found.Phi, discs, False)
        located = _radii_by_coordinate(found, system.coordinates)
        maxima, error = _extrema(orbit, found.motion, located)
        centers, radii, isolated = discs_of(discs)
        open_verdict = ("no verdict is proved: discs of multipliers meet the unit circle",)
        return Proof(
            verdict=VERDICTS[index],
            multipliers=centers,
            radii=radii,
            isolated=isolated,
            spectral_radius=bounds_of([disc.low for disc in discs], [disc.high for disc in discs]),
            max_abs=maxima,
            result=orbit,
            true_error={"multipliers": true_error(orbit, discs), "orbit": error},
            assumed=assumption(system.model, found.equation.instructions, rounded),
            steps=found.steps,
            seconds=time.process_time() - begun,
            warnings=open_verdict if index == UNDETERMINED else (),
            orbit=located,
        )


@dataclass(frozen=True)
class _LinearisedProof:
    """Equations linearised about a motion, and proved properties of the nonlinear orbit near the motion: an
    enclosure Φ of its monodromy matrix, and the radii of existence."""

    equation: Equation
    motion: TrigonometricMotion
    steps: int
    Phi: Matrix
    existence: Existence


def _prove_existence(
    orbit: NonlinearOrbit, system: LinearisedModel, marching: Marching, rounded: bool
) -> _LinearisedProof:
    """Prove that the orbit exists. Raises NoOrbitError, ResonanceError or StepsError if the proof fails."""
    model = system.model
    period = period_of(model, rounded) * round(system.period / model.period)
    equation, motion = _equation(system, orbit.speed, period, rounded)
    turned = turn(equation, period, (), marching)
    whole = turned.levels()[-1][0]
    Phi = homogeneous(whole)
    bounds = transitions(turned)
    linear = Linear.from_maps(turned, Phi, bounds, states(turned, equation.n, whole))
    second = _instructions(model, second_derivatives, rounded)
    proved = existence(equation, second, turned, linear, bounds)
    return _LinearisedProof(equation, motion, len(turned.steps), widened(Phi, proved.change), proved)


def _instructions(
    model: Model, derived: Callable[[casadi.Function], casadi.Function], rounded: bool
) -> Instructions:
    return Instructions.from_function(
        derived(model.setup.function("residual")), partial(number, rounded=rounded)
    )


def _equation(
    system: LinearisedModel, omega: float, period: Ball, rounded: bool
) -> tuple[Equation, TrigonometricMotion]:
    """Return the equations linearised about a motion near the orbit, and the motion. Scales balance the
    coefficients.

    The load is the defect. It is scaled by the inertia forces of the motion, because it is far smaller than
    other forces."""
    model, n = system.model, system.n
    numbers = [number(float(x), rounded) for x in (omega, *model.setup.p)]
    instructions = _instructions(model, linearised_about, rounded)
    curve = harmonics_of(system, omega)

    def plain(motion: TrigonometricMotion, phase: Ball) -> list[Array]:
        unscaled = Equation(
            instructions, n, numbers[0], tuple(numbers[1:]), np.eye(n), np.ones(n), 1.0, motion
        )
        m, r = map(_doubles, unscaled.at(phase, None))
        return [m, r[:, n : 2 * n], r[:, :n], -r[:, 2 * n]]

    motion = TrigonometricMotion.from_curve(curve, period)
    motion = corrected(motion, curve.nodes, partial(plain, motion))
    phases = [period * k / _SAMPLES for k in range(_SAMPLES)]
    M, C, K, _ = (np.array(part) for part in zip(*(plain(motion, phase) for phase in phases), strict=True))
    accelerations = motion.curve(np.array([float(phase.mid()) for phase in phases]), 2)
    d = np.einsum("kij,jk->ki", M, accelerations)
    return Equation.scaled(instructions, numbers[0], numbers[1:], (M, C, K, d), motion), motion


def _doubles(matrix: Matrix) -> Array:
    return np.array([[float(x.mid()) for x in row] for row in matrix.table()])


def _unproved(orbit: NonlinearOrbit, reason: str, seconds: float) -> Proof:
    count = len(orbit.multipliers)
    return Proof(
        verdict=VERDICTS[UNDETERMINED],
        multipliers=np.zeros(count, dtype=complex),
        radii=np.full(count, math.inf),
        isolated=np.zeros(count, dtype=bool),
        spectral_radius=("0", "inf"),
        max_abs={},
        result=orbit,
        true_error={"multipliers": math.nan, "orbit": math.nan},
        assumed="nothing is proved",
        steps=0,
        seconds=seconds,
        warnings=(reason,),
    )


def _radii_by_coordinate(found: _LinearisedProof, names: tuple[str, ...]) -> ProvedOrbit:
    """Radii of existence and uniqueness for each coordinate.

    An orbit of norm ≤ ρ has |u_a| ≤ ρ s_a. Conversely, |u_a| ≤ c ρ s_a implies a norm ≤ ρ if c Σ_a |T⁻¹_ia|
    s_a ≤ λ for every i. The same is true of u̇ and ü with T W instead of T."""
    equation, motion, proved = found.equation, found.motion, found.existence
    n, sizes = equation.n, sizes_of(equation, proved.rate)
    T = arb_mat(equation.modes.tolist())
    inverse, W = T.inv(), equation.frequencies.tolist()
    radius, unique = {}, {}
    scales = (
        arb(equation.load),
        arb(equation.load) * abs(equation.speed),
        arb(equation.load) * equation.speed**2 * proved.rate,
    )
    factors = []
    for order, scale in enumerate(scales):
        by_row = (
            sum((abs(inverse[i, a]) * sizes[order * n + a] for a in range(n)), arb(0))
            / (arb(W[i]) if order else 1)
            for i in range(n)
        )
        factors.append(scale / largest(by_row))
    for a, name in enumerate(names):
        radii = [sizes[order * n + a] for order in range(3)]
        radius[name] = tuple(above(proved.radius * s) for s in radii)
        unique[name] = tuple(below(proved.unique * s * c) for s, c in zip(radii, factors, strict=True))
    return ProvedOrbit(motion.cosines - 1j * motion.sines, radius, unique)


def _extrema(
    orbit: NonlinearOrbit, motion: TrigonometricMotion, located: ProvedOrbit
) -> tuple[dict[str, tuple[float, float]], float]:
    """Return bounds on max|q| of each coordinate, and the error of the numerical orbit at its nodes relative
    to max|q|."""
    nodes = orbit.curve.nodes[:-1]
    exact, given = motion.at(nodes), orbit.at(nodes)
    bounds, worst = {}, 0.0
    for i, (name, pieces) in enumerate(zip(orbit.coordinates, motion.polynomials(), strict=True)):
        radius = arb(located.radius[name][0])
        low, high = largest_modulus(pieces)
        low = (low - radius).lower()
        bounds[name] = below(low) if low > 0 else 0.0, above(high + radius)
        apart = largest(abs(q[i] - float(x)) + radius for q, x in zip(exact, given[i], strict=True))
        worst = max(worst, above(apart / low) if low > 0 else math.inf)
    return bounds, worst
