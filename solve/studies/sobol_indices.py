"""Sobol indices of a function of independent variables. The samples and the first-order estimator, for
centred values, are those of A. Saltelli et al. (Comput. Phys. Commun. 181 (2010) 259-270). The total
estimator is that of M. J. W. Jansen (Comput. Phys. Commun. 117 (1999) 35-43)."""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.results.tolerances import SobolIndices
from solve.studies.probability import QUANTILE

_RESAMPLES = 200
"""Number of bootstrap samples for the error estimates. Chosen by judgement: the estimates then have a
relative error of 5 %."""


def sobol_indices(
    evaluate: Callable[[Array], Array],
    dimensions: int,
    samples: int,
    rng: np.random.Generator,
    error: float = 0.0,
) -> tuple[list[list[SobolIndices]], int]:
    """Return the first-order and total index of each quantity for each variable, and the number of samples
    without a value.

    `evaluate` returns the values (P, q) of q quantities at points (P, r) of the unit cube. `samples` is a
    power of two. `error` is the relative error of the values. If a quantity varies by less than this error,
    its indices are NaN.
    """
    from scipy.stats.qmc import Sobol

    both = Sobol(2 * dimensions, rng=rng).random(samples)
    first, second = both[:, :dimensions], both[:, dimensions:]
    mixed = np.tile(first, (dimensions, 1, 1))
    for place in range(dimensions):
        mixed[place, :, place] = second[:, place]
    values = evaluate(np.concatenate((first, second, *mixed)))
    values = values.reshape(dimensions + 2, samples, -1)
    known = np.isfinite(values).all(axis=(0, 2))
    values = values[:, known]
    if not known.any():
        values = np.full((dimensions + 2, 1, values.shape[2]), np.nan)
    found = _estimates(values)
    found[:, :, np.ptp(values, axis=(0, 1)) <= error * np.abs(values).max(axis=(0, 1))] = np.nan
    rows = rng.integers(values.shape[1], size=(_RESAMPLES, values.shape[1]))
    errors = QUANTILE * np.std([_estimates(values[:, each]) for each in rows], axis=0)
    indices = [
        [
            SobolIndices(*found[:, place, at].tolist(), *errors[:, place, at].tolist())
            for place in range(dimensions)
        ]
        for at in range(values.shape[2])
    ]
    return indices, int(np.count_nonzero(~known))


def _estimates(values: Array) -> Array:
    """Return the first-order and total indices (2, r, q) from values (r + 2, P, q); 0 for a constant
    quantity."""
    first, second, mixed = values[0], values[1], values[2:]
    both = np.concatenate((first, second))
    variance = both.var(axis=0)
    main = ((second - both.mean(axis=0)) * (mixed - first)).mean(axis=1)
    scale = np.where(variance > 0, variance, 1.0)
    return np.stack((main, ((first - mixed) ** 2).mean(axis=1) / 2)) / scale
