"""Resolution of modes and harmonics by a number of steps: first grid, grid sizes, and unresolved modes.

With coefficients frozen at a phase, a step of length h of a one-step method multiplies a mode of rate λ by
R(hλ) instead of exp(hλ). If these two factors differ, two solutions may agree on a wrong multiplier: an
L-stable method damps an undamped mode, and other methods preserve a decaying mode. The larger of the two
factors, multiplied over all steps of a period, bounds what remains of a perturbation of this mode after one
period."""

from functools import lru_cache

import numpy as np

from solve.arrays import Array
from solve.certify.coefficients import harmonics
from solve.certify.comparison import NO_DIGIT
from solve.methods.collocated import Collocated
from solve.methods.collocation import Collocation
from solve.methods.method import Method
from solve.period.frozen import FrozenModes
from solve.period.pencils import residual_amplitude
from solve.period.points import Points

MIN_STEPS = 8
"""Smallest number of steps of a grid. Chosen by judgement. docs/certificate.md states the measured range."""

_MAX_FIRST_STEPS = 2**14
"""Largest number of steps of a first grid. Chosen by judgement, because larger predicted numbers are not
reliable. docs/certificate.md states the measured range."""

AIM = 0.3
"""Target of the error on the next grid, as a fraction of `rtol`. Measured: for values between 0.15 and 0.6,
the number of steps changes by less than 10 %."""

_UNRESOLVED = 0.25
"""Relative error of a mode over the period above which the mode counts as unresolved: a quarter of a radian
of phase. This is far below half a revolution, where two solutions may agree by chance. With half or twice
this value, the errors of 65 results on 14 random test systems stay within their estimates, and the verdicts
are the same."""

_COMPARABLE = 3.0
"""Ratio between the remainders of two modes up to which it is pointless to resolve one mode if the other
cannot be resolved. Chosen by judgement: the error of the multipliers is then at most three times the
inevitable error."""


def first_steps(
    method: Method, points: Points, modes: FrozenModes, orbit: bool, rtol: float, most: int
) -> tuple[Array, Array]:
    """Return the numbers of steps (P,) of the first grids. Also return the remainders (P,) of unresolved
    modes: the factors by which modes that require too many steps decay in a period.

    The number of steps m is that for which the error m c (ωT/m)^(p + 1) of a motion of angular frequency ω
    equals the target. Here, c and p are the error constant and the order of the method. The motions are the
    frozen modes, weighted by their decay per period relative to the least damped mode, and the harmonics of
    the coefficients, weighted by their amplitudes. Along a nonlinear orbit, only the modes count, because the
    orbit has spurious harmonics on a coarse grid.

    Methods without an error constant start with few steps. Methods that do not damp stiff modes start with a
    number of steps that resolves these modes on the grid of the comparison solution, which has twice as many
    steps.

    If an orbit is requested, damped modes that require more than `most` steps do not count. Modes whose
    remainder after a period is at most `_COMPARABLE` times the remainder of these modes do not count either.
    With such modes, the multipliers do not meet the tolerance on any grid, and fine grids would increase the
    round-off of the orbit."""
    collocation = method.corrector
    if not isinstance(collocation, Collocated):
        phase_advance = np.zeros(len(modes)) if method.l_stable else modes.phase_advance_estimate
        steps = np.ceil(np.nan_to_num(phase_advance) / (2 * method.follows))
        return np.clip(steps, 2 * MIN_STEPS, _MAX_FIRST_STEPS).astype(int), np.zeros(len(modes))
    c, p, T = collocation.error_constant, collocation.order, modes.period
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        rates, remaining = modes.rates_and_decay()
        # The variation of the coefficients increases the frozen rates by about 1.5 times the speed.
        powers = remaining * ((rates + 1.5) * T) ** (p + 1)
        is_out_of_reach = (c / (AIM * rtol) * powers > float(most) ** p) & orbit
        unresolved = _COMPARABLE * np.where(is_out_of_reach, remaining, 0.0).max(axis=1)
        unresolved = np.where(unresolved < NO_DIGIT, unresolved, 0.0)
        largest = np.where(remaining > unresolved[:, None], powers, 0.0).max(axis=1)
        if method.linear:
            amplitudes = harmonics(points, orbit)
            largest = np.maximum(largest, _harmonic_powers(amplitudes, rates.max(axis=1), T, p))
        steps = (c / (AIM * rtol) * largest) ** (1 / p)
    steps = np.where(steps > MIN_STEPS, np.minimum(steps, _MAX_FIRST_STEPS), MIN_STEPS)
    return np.ceil(steps).astype(int), unresolved


def _harmonic_powers(amplitudes: Array, fastest: Array, T: float, p: float) -> Array:
    """Return the largest value (P,) of amplitude · (ωT)^(p + 1) over the harmonics with the `amplitudes` (P,
    k).

    Harmonics above the frequency ω₁ of the fastest mode, `fastest` (P,), have the additional weight (ω₁/ω)³:
    inertia reduces the response by (ω₁/ω)², and local errors accumulate only over one vibration period 2π/ω₁
    of the fastest mode. In (ωT)^(p + 1), ω is multiplied by 1.25, because the harmonics of the response
    extend beyond those of the coefficients."""
    omega = np.arange(1, amplitudes.shape[1]) * 2 * np.pi / T
    response = 3 * np.minimum(np.log(fastest)[:, None] - np.log(omega), 0.0)
    powers = np.log(amplitudes[:, 1:]) + (p + 1) * np.log(1.25 * omega * T) + response
    return np.exp(powers.max(axis=1, initial=-np.inf))


def grid_sizes(steps: Array) -> Array:
    """Round numbers of steps (k,) up to members of the sequence 8, 12, 16, 24, …, 128, 192, 224, 256, 320
    and so on.

    Points share these few grid sizes, so that tables are reused. Above 192 steps, there are four sizes per
    factor of two, because additional steps then cost more than an additional grid."""
    steps = np.maximum(steps, MIN_STEPS)
    octave = np.exp2(np.floor(np.log2(steps)))
    spacing = octave / np.where(steps > 192, 4, 2)
    return (spacing * np.ceil(steps / spacing)).astype(int)


def unresolved_remainder(method: Method, modes: FrozenModes, steps: int) -> Array:
    """Return a bound (P,) on what remains, after one period, of a unit perturbation in modes that the steps
    do not resolve.

    The remainder is 0 if all modes are resolved. It is infinite if a method without a stability function
    preserves unresolved modes. The mean damping of a mode over a few phases would be wrong if the damping had
    as many harmonics as there are phases. Therefore, all phases are used."""
    limit = _resolved_angle(method, steps) * steps / modes.period
    rows = (~modes.is_within(limit)).nonzero()[0]
    remainder = np.zeros(len(modes))
    if not len(rows):
        return remainder
    rates = modes[rows].eigenvalues()
    if method.stages is not None:
        remainder[rows] = _collocation_remainder(method.stages, rates, modes.period / steps, steps)
    else:
        is_unresolved = np.abs(rates).max(axis=(1, 2)) > limit
        lasting = residual_amplitude(rates, modes.period, limit * modes.period) if method.l_stable else np.inf
        remainder[rows] = np.where(is_unresolved, lasting, 0.0)
    return remainder


def _collocation_remainder(stages: Collocation, rates: Array, h: float, steps: int) -> Array:
    """Return the product (P,), over all steps of the period, of the largest factor of the unresolved modes.
    At phases where all modes are resolved, the factor of the fastest mode is used. The product is 0 if all
    modes are resolved at all phases. rates (P, k, 2n): frozen eigenvalues."""
    z = h * rates
    is_unresolved, factors = _unresolved_factors(stages, z, steps)
    counts = is_unresolved | (np.abs(z) == np.abs(z).max(axis=-1, keepdims=True))
    exponents = np.where(counts, np.log(factors), -np.inf).max(axis=-1).sum(axis=-1)
    remainder = np.exp(exponents * (steps / rates.shape[1]))
    return np.where(is_unresolved.any(axis=(-2, -1)), remainder, 0.0)


def _unresolved_factors(stages: Collocation, z: Array, steps: int) -> tuple[Array, Array]:
    """Return whether modes with z = hλ are unresolved, and the larger of the moduli of their exact and
    computed factors."""
    exact, computed = np.exp(z), stages.stability_function(z)
    largest = np.maximum(np.abs(exact), np.abs(computed))
    return ~(steps * np.abs(computed - exact) <= _UNRESOLVED * largest), largest


def _resolved_angle(method: Method, steps: int) -> float:
    """Return the largest h|λ| up to which a method resolves all modes that do not grow, over `steps`
    steps."""
    if method.stages is not None:
        return _collocation_angle(method.stages, steps)
    return min(method.follows, float(method.in_phase(np.array(steps), _UNRESOLVED)) / steps)


@lru_cache(maxsize=256)
def _collocation_angle(stages: Collocation, steps: int) -> float:
    radii, angles = np.geomspace(1e-3, 64.0, 400), np.pi * np.linspace(0.5, 1.0, 33)
    is_unresolved = _unresolved_factors(stages, radii[:, None] * np.exp(1j * angles), steps)[0].any(axis=1)
    return float(radii[max(int(is_unresolved.argmax()) - 1, 0)] if is_unresolved.any() else radii[-1])
