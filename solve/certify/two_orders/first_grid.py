"""Steps of the first grid, from the frozen modes and the harmonics of the coefficients."""

import numpy as np

from solve.arrays import Array
from solve.certify.two_orders.coefficients import harmonics
from solve.methods.collocation import Collocated
from solve.methods.method import Method
from solve.period.frozen import Frozen
from solve.period.points import Points

LEAST = 8
"""Fewest steps of a grid."""

_MOST = 2**14
"""Most steps of a first grid; a prediction of more is not reliable."""

AIM = 0.3
"""Fraction of `rtol` at which a grid aims. Between 0.15 and 0.6 the steps change by less than 10 %."""

_FASTER = 1.5
"""Harmonics of the speed by which the rates of frozen modes rise, since coefficients vary as well."""

_COUPLED = 1.25
"""Factor on the harmonics of the coefficients, since the response adds its own."""


def first_steps(method: Method, points: Points, modes: Frozen, rtol: float) -> Array:
    """Steps (P,) with which the error m c (ωT/m)^(p + 1) of a motion of the angular frequency ω is the aim,
    with the error constant c and the order p of the method.

    Such motions are the frozen modes, weighted by what a period leaves of them relative to the least damped
    one, and the harmonics of the coefficients, weighted by their amplitudes and beyond the fastest mode by
    its (ω/k)², the response of inertia. Methods without such a constant begin with few steps.
    """
    if not isinstance(method, Collocated):
        return np.full(len(modes), 2 * LEAST)
    c, p, T = method.error_constant, method.order, modes.period
    bound = modes.rate_bound
    rates, left = modes.lasting_rates if bound is None else (bound[:, None], np.ones((len(modes), 1)))
    of_modes = (left * ((rates + _FASTER) * T) ** (p + 1)).max(axis=1)
    of_harmonics = _of_harmonics(harmonics(points), rates.max(axis=1), T, p)
    with np.errstate(over="ignore"):
        steps = (c / (AIM * rtol) * np.maximum(of_modes, of_harmonics)) ** (1 / p)
    return np.clip(np.ceil(steps), LEAST, _MOST).astype(int)


def _of_harmonics(amplitudes: Array, fastest: Array, T: float, p: float) -> Array:
    """Largest weighted power (P,) over the harmonics k, for the next of some rates above the fastest (P,)."""
    if len(amplitudes) < 2:
        return np.zeros(len(fastest))
    k = np.arange(1, len(amplitudes)) * 2 * np.pi / T
    rates = k[0] * np.exp2(np.arange(0, np.log2(len(amplitudes)) + 1, 0.25))
    with np.errstate(divide="ignore"):
        response = 2 * np.minimum(np.log(rates)[:, None] - np.log(k), 0.0)
        powers = (np.log(amplitudes[1:]) + (p + 1) * np.log(_COUPLED * k * T) + response).max(axis=1)
    return np.exp(powers[np.minimum(np.searchsorted(rates, fastest), len(rates) - 1)])
