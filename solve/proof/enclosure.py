"""Enclosures of the results of a model at a speed. The precision is increased until the verdict is
decided."""

import math
import time
from concurrent.futures import Executor
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from functools import partial

import numpy as np

from solve.arrays import Array, uniform_phases
from solve.errors import ResonanceError
from solve.model.model import Model
from solve.period.multipliers import UNDETERMINED, VERDICTS
from solve.proof.balls import Ball, Matrix, above, arb, arb_mat, below, largest, number, precision
from solve.proof.equation import Equation
from solve.proof.instructions import Instructions
from solve.proof.orbit import largest_modulus, polynomials, position_and_rate, states
from solve.proof.outputs import Outputs
from solve.proof.periodicity import repeats
from solve.proof.result import Proof
from solve.proof.spectrum import Multiplier, multipliers, verdict
from solve.proof.symbolic import linearised
from solve.proof.turn import Marching, Turn, homogeneous, turn
from solve.results.orbit import Orbit
from solve.results.stability import Stability
from solve.system import PeriodicSystem

GUARD_BITS = 40
"""Bits added to the precision. They suffice for condition numbers up to 10^6 and for the levels of the
product."""

_MOST_ADVANCE = 24.0
"""Largest h‖A‖ of a step. Measured for the cam at 600 rpm: the computation takes 1.2 times as long with 48,
and twice as long with 72."""

ROUNDED = 34, 4.0
"""Precision in bits, and largest h‖A‖ of a step, if the parameters are balls. The radius of a parameter, up
to 2^-51, grows by the factor e^{2h‖A‖} in a step."""

_DOUBLINGS = 2
"""Largest number of times that the precision is doubled because the verdict is undecided. Chosen by
judgement."""

_SAMPLES = 64
"""Number of phases from which scales are computed. Chosen by judgement; it affects the widths of the
enclosures, not their validity."""

_SHOWN = 4
"""Number of decimal digits of two bounds that are shown beyond their common digits. Chosen by judgement."""

EXACT = "parameters, speed and constants are exactly their double-precision numbers"
_ALL_WITHIN = (
    "parameters, speed and constants are any real numbers within two units in the last place of the given "
    "ones; whole numbers are exact"
)

_OF_FUNCTIONS = "the matrices are defined by the operations of the given function on symbolic phases"
_OF_SAMPLES = "the matrices are the interpolant of the samples, with coefficients in double precision"

_DENOMINATORS = range(1, 13)
"""Denominators q. A period within two units in the last place of kπ/q counts as exactly kπ/q."""


def enclosed(
    system: PeriodicSystem, result: Stability, digits: int, rounded: bool, executor: Executor | None = None
) -> Proof:
    """Prove results for a system, starting from a numerical result. The orbit is enclosed if `result`
    contains one. executor: executor that computes steps in parallel."""
    begun = time.process_time()
    equation = equation_of(system, result.speed, rounded)
    bits, most = ROUNDED if rounded else (math.ceil(digits * math.log2(10)) + GUARD_BITS, _MOST_ADVANCE)
    found = _enclosed(system, equation, Marching(bits, most, executor=executor), rounded)
    for _ in range(0 if rounded else _DOUBLINGS):
        if found.verdict != UNDETERMINED:
            break
        bits *= 2
        found = _enclosed(system, equation, Marching(bits, most, executor=executor), rounded)
    bounds, orbit_error, warnings = {}, math.nan, []
    if found.verdict == UNDETERMINED:
        warnings.append(
            "no verdict is proved: discs of multipliers meet the unit circle; more digits help, except for "
            "multipliers on the circle, such as those of rigid-body modes"
        )
    with precision(2 * bits):
        if isinstance(result, Orbit):
            try:
                enclosures = states(found.turn, equation.n, found.Phi)
                bounds, orbit_error = _orbit(result, equation, found, enclosures)
                bounds |= _outputs(
                    system, Outputs.from_system(system, equation, found.turn, enclosures, rounded)
                )
            except ResonanceError as error:
                warnings.append(str(error))
        errors = {"multipliers": true_error(result, found.discs), "orbit": orbit_error}
        centers, radii, isolated = discs_of(found.discs)
        radius = bounds_of([disc.low for disc in found.discs], [disc.high for disc in found.discs])
    return Proof(
        verdict=VERDICTS[found.verdict],
        multipliers=centers,
        radii=radii,
        isolated=isolated,
        spectral_radius=radius,
        max_abs=bounds,
        result=result,
        true_error=errors,
        assumed=assumption(system, equation.instructions, rounded),
        steps=len(found.turn.steps),
        seconds=time.process_time() - begun,
        warnings=tuple(warnings),
    )


def assumption(system: PeriodicSystem, instructions: Instructions, rounded: bool) -> str:
    """Return a text that states the assumptions of a proof. The assumptions concern the numbers and functions
    of a system and, unless the instructions prove the period, also the period."""
    texts, multiple = [_ALL_WITHIN if rounded else EXACT], multiple_of_pi(system.period)
    if not isinstance(system, Model):
        texts.append(_OF_FUNCTIONS if system.capabilities.samples is None else _OF_SAMPLES)
    if multiple is None or not repeats(instructions, multiple):
        texts.append("the equations on one period are continued periodically")
    return "; ".join(texts)


def discs_of(discs: list[Multiplier]) -> tuple[Array, Array, Array]:
    """Return the centers of the discs as doubles, the radii about these centers, and whether each disc
    contains exactly one multiplier."""
    each = [disc for disc in discs for _ in range(disc.count)]
    centers = [complex(disc.center) for disc in each]
    moves = [abs(disc.center - center) for disc, center in zip(each, centers, strict=True)]
    radii = [above(disc.radius + move) for disc, move in zip(each, moves, strict=True)]
    # Multipliers that agree in double precision share a disc. Its center is a double.
    alone = [
        disc.isolated and bool(arb(radius) < disc.room - move)
        for disc, move, radius in zip(each, moves, radii, strict=True)
    ]
    return np.array(centers), np.array(radii), np.array(alone)


def bounds_of(lows: list[Ball], highs: list[Ball]) -> tuple[str, str]:
    """Return the maximum of the lower bounds and the maximum of the upper bounds, as decimal numbers. The two
    numbers are printed with their common digits and a few more."""
    low, high = largest(lows), largest(highs)
    if not high.is_finite():
        return _decimal(low, _SHOWN, ROUND_FLOOR), "inf"
    shared = float((high / (high - low)).log()) / math.log(10) if high > low else 0.0
    digits = _SHOWN + math.ceil(max(0.0, shared))
    return _decimal(low, digits, ROUND_FLOOR), _decimal(high, digits, ROUND_CEILING)


@dataclass(frozen=True)
class _Enclosed:
    """Steps of a period, the product Φ (2n+1, 2n+1) of the maps of the steps, the multipliers, and the
    verdict. unloaded: whether the load is zero."""

    turn: Turn
    Phi: Matrix
    discs: list[Multiplier]
    verdict: int
    unloaded: bool


def _enclosed(system: PeriodicSystem, equation: Equation, marching: Marching, rounded: bool) -> _Enclosed:
    with precision(2 * marching.bits):
        period = period_of(system, rounded)
        found = turn(equation, period, system.breaks, marching)
        Phi = found.levels()[-1][0]
        unforced = homogeneous(Phi)
        discs = multipliers(unforced)
        conservative, unloaded = equation.vanishes(period)
        return _Enclosed(found, Phi, discs, verdict(unforced, discs, conservative), unloaded)


def equation_of(system: PeriodicSystem, omega: float, rounded: bool) -> Equation:
    """Equation in ball arithmetic of a system at a speed in rad/s. rounded: see `solve.prove`."""
    instructions = Instructions.from_function(linearised(system), partial(number, rounded=rounded))
    phases = uniform_phases(_SAMPLES, system.period)
    M, C, K, d = system.at(phases, omega)
    samples = M, C / omega, K / omega**2, d / omega**2
    parameters = system.setup.p if isinstance(system, Model) else ()
    numbers = [number(float(x), rounded) for x in (omega, *parameters)]
    return Equation.scaled(instructions, numbers[0], numbers[1:], samples)


def multiple_of_pi(T: float) -> Fraction | None:
    """Fraction k/q for which kπ/q equals the period T within rounding errors; None if there is no such
    fraction."""
    for q in _DENOMINATORS:
        k = round(T * q / math.pi)
        if k and abs(Fraction(k, q) * Fraction(math.pi) - Fraction(T)) <= 2 * Fraction(math.ulp(T)):
            return Fraction(k, q)
    return None


def period_of(system: PeriodicSystem, rounded: bool = False) -> Ball:
    """Period as a ball. It is an exact multiple of π if the period equals such a multiple within rounding
    errors."""
    multiple = multiple_of_pi(system.period)
    if multiple is None:
        return number(system.period, rounded)
    return arb.pi() * multiple.numerator / multiple.denominator


def _orbit(
    result: Orbit, equation: Equation, found: _Enclosed, enclosures: list[Matrix]
) -> tuple[dict[str, tuple[float, float]], float]:
    """Return bounds on max|q| of each coordinate, and the error of the numerical orbit relative to max|q|.
    Both are zero if there is no load."""
    if found.unloaded:
        return dict.fromkeys(result.coordinates, (0.0, 0.0)), 0.0
    q = result.at(np.array([float(start) for start in found.turn.starts]))
    bounds, worst, resting = {}, 0.0, 0.0
    for i, name in enumerate(result.coordinates):
        row = arb_mat([[*(arb(x) * equation.load for x in equation.modes[i].tolist()), *([0] * equation.n)]])
        low, high = largest_modulus(polynomials(found.turn, enclosures, row))
        bounds[name] = below(low), above(high)
        values = zip(enclosures, q[i].tolist(), strict=True)
        apart = largest(abs((row * position_and_rate(state))[0, 0] - value) for state, value in values)
        if low > 0:
            worst = max(worst, above(apart / low))
        else:
            resting = max(resting, above(apart))
    # A coordinate that may be zero is compared with the largest coordinate.
    size = max(low for low, _ in bounds.values())
    return bounds, max(worst, resting / size) if size > 0 else math.inf


def _outputs(system: PeriodicSystem, outputs: Outputs | None) -> dict[str, tuple[float, float]]:
    """Mapping from names of outputs to bounds on their maximum moduli. Outputs without finite bounds are
    omitted."""
    if outputs is None:
        return {}
    each = {name: outputs.largest_modulus(k) for k, name in enumerate(system.outputs)}
    return {name: (below(low), above(high)) for name, (low, high) in each.items() if high.is_finite()}


def true_error(result: Stability, discs: list[Multiplier]) -> float:
    """Largest distance between a numerical multiplier and the nearest enclosure, relative to the spectral
    radius; NaN if the distance is not known."""
    centers = [(complex(disc.center), disc) for disc in discs for _ in range(disc.count)]
    radius = largest(disc.low for disc in discs)
    worst, left = arb(0), list(centers)
    for rho in result.multipliers.tolist():
        if math.isnan(rho.real):
            continue
        near = min(left, key=lambda each: abs(each[0] - rho))
        left.remove(near)
        worst = largest((worst, abs(near[1].center - rho) + near[1].radius))
    if len(left) == len(centers):
        return math.nan
    return above(worst / radius) if radius > 0 else math.inf


def _decimal(x: Ball, digits: int, rounding: str) -> str:
    """Convert an exact ball to a decimal number, rounded in the direction `rounding`."""
    mantissa, exponent = (int(part) for part in x.man_exp())
    exact = Context(prec=abs(exponent) + mantissa.bit_length() + 10)
    value = exact.multiply(Decimal(mantissa), exact.power(Decimal(2), exponent))
    return str(value.normalize(Context(prec=digits, rounding=rounding)))
