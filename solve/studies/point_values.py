"""Values of named quantities from results at many points."""

from collections.abc import Sequence

import numpy as np

from solve.arrays import Array
from solve.period.named import EXPONENT, HARMONIC, RADIUS, Named
from solve.period.signals import FIGURES
from solve.results.points import Kept, PointResults


def kept_for(quantities: Sequence[Named], limited: Sequence[str] = ()) -> Kept:
    """Return the selection of data that must be stored at each point. They are the data for `quantities`, and
    the data for `limited`, the coordinates and outputs with limits."""
    of_orbit = [quantity for quantity in quantities if quantity.of_orbit]
    orders = [quantity.number for quantity in of_orbit if quantity.figure == HARMONIC]
    spectra = dict.fromkeys(quantity.subject for quantity in of_orbit if quantity.figure == HARMONIC)
    names = dict.fromkeys([*(quantity.subject for quantity in of_orbit), *limited])
    return Kept(tuple(names), tuple(spectra), max(orders, default=0), warnings=False)


def values_of(quantity: Named, results: PointResults, speeds: Array, period: float) -> Array:
    """Return the values (P,) of a quantity; NaN at points without a result. Speeds (P,) are in rad/s;
    `period` is the period as a phase in rad."""
    if quantity.figure == HARMONIC:
        return results.amplitudes[:, results.kept.spectra.index(quantity.subject), quantity.number]
    if quantity.of_orbit:
        place = results.kept.names.index(quantity.subject)
        return results.figures[:, place, FIGURES.index(quantity.figure)]
    if quantity.subject == RADIUS:
        return results.spectral_radius
    every = results.all_multipliers
    rho = np.where(every == 0, np.nan, every)[:, quantity.number - 1]
    return quantity.part(np.log(rho) * speeds / period if quantity.subject == EXPONENT else rho)


def errors_of(quantity: Named, values: Array, results: PointResults, speeds: Array, period: float) -> Array:
    """Return the estimated absolute errors (P,) of `values` (P,). They are computed from relative errors in
    `results`. The errors of an orbit are relative to the largest absolute value of the coordinate or output.
    The errors of multipliers are relative to the spectral radius."""
    orbit, multipliers = results.errors.T
    if quantity.of_orbit:
        place = results.kept.names.index(quantity.subject)
        return _bounded(orbit, results.figures[:, place, FIGURES.index("max_abs")])
    error = _bounded(multipliers, results.spectral_radius)
    if quantity.subject != EXPONENT:
        return error
    with np.errstate(divide="ignore", invalid="ignore"):
        return error / np.abs(results.all_multipliers[:, quantity.number - 1]) * speeds / period


def _bounded(relative: Array, sizes: Array) -> Array:
    """Return the absolute errors (P,) from relative errors and sizes. An infinite relative error, which means
    unknown, stays infinite even if the size is 0."""
    return np.where(np.isinf(relative), np.inf, np.where(np.isinf(relative), 0.0, relative) * sizes)
