"""Number of steps of the first grid, from the frozen modes and the harmonics of the coefficients."""

import numpy as np

from solve.arrays import Array
from solve.certify.coefficients import harmonics
from solve.methods.collocation import Collocated
from solve.methods.method import Method
from solve.period.frozen import Frozen
from solve.period.points import Points

LEAST = 8
"""Fewest steps of a grid."""

_MOST = 2**14
"""Most steps of a first grid; a prediction of more is not reliable."""

UNDERFLOW = 1e-30
"""Spectral radius below which the multipliers of Φ are round-off of its entries."""

AIM = 0.3
"""Fraction of `rtol` that a grid aims at. Between 0.15 and 0.6 the number of steps changes by less than 10
%."""

_FASTER = 1.5
"""Harmonics of the speed added to the rates of frozen modes, because the coefficients vary as well."""

_COUPLED = 1.25
"""Factor on the harmonics of the coefficients, because the response adds its own."""


def first_steps(method: Method, points: Points, modes: Frozen, orbit: bool, rtol: float) -> Array:
    """Steps (P,) with which the error m c (ωT/m)^(p + 1) of a motion of the angular frequency ω is the aim,
    with the error constant c and the order p of the method.

    Such motions are the frozen modes, weighted by their decay per period relative to the least damped one,
    and the harmonics of the coefficients, weighted by their amplitudes and, for orders k above the fastest
    mode ω, by (ω/k)³: inertia reduces the response by (ω/k)², and local errors accumulate over a period of
    the mode only. Methods without an error constant begin with few steps. Those that do not damp stiff modes
    begin with steps that resolve these on the doubled grid, with which they are compared.
    """
    if not isinstance(method, Collocated):
        reach = np.zeros(len(modes)) if method.l_stable else modes.few_reach
        return np.clip(np.ceil(np.nan_to_num(reach) / (2 * method.follows)), 2 * LEAST, _MOST).astype(int)
    c, p, T = method.error_constant, method.order, modes.period
    rates, left = modes.lasting_rates(UNDERFLOW)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        of_modes = (left * ((rates + _FASTER) * T) ** (p + 1)).max(axis=1)
        of_harmonics = _of_harmonics(harmonics(points, orbit), rates.max(axis=1), T, p)
        steps = (c / (AIM * rtol) * np.maximum(of_modes, of_harmonics)) ** (1 / p)
    return np.clip(np.ceil(np.nan_to_num(steps, posinf=_MOST)), LEAST, _MOST).astype(int)


def _of_harmonics(amplitudes: Array, fastest: Array, T: float, p: float) -> Array:
    """Largest weighted power (P,) of the harmonics of amplitudes (P, k), for the rates of the fastest modes
    (P,)."""
    k = np.arange(1, amplitudes.shape[1]) * 2 * np.pi / T
    response = 3 * np.minimum(np.log(fastest)[:, None] - np.log(k), 0.0)
    with np.errstate(divide="ignore"):
        powers = np.log(amplitudes[:, 1:]) + (p + 1) * np.log(_COUPLED * k * T) + response
    return np.exp(powers.max(axis=1, initial=-np.inf))
