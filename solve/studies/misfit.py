"""What tells that a fit is not to be trusted: differences that are no noise, a wrong unit, a channel that
does not vary, values that stand twice. Differences are no noise where neighbours are correlated, by the sum
of the squares of the correlations at several distances, each over its own deviation (G. M. Ljung, G. E. P.
Box, Biometrika 65 (1978) 297-303)."""

from collections.abc import Mapping, Sequence

import numpy as np

from solve.arrays import Array
from solve.results.fit import Channel

_EXACT = 1e-5
"""Difference, relative, up to which it may be what the solution itself leaves."""

_FALSE = 0.003
"""Part of the cases in which noise may be taken for something else."""

_MOST_LAGS, _A_LAG = 6, 6
"""How far apart neighbours are compared at most, and values for each of these distances at least."""

_APART = 0.5
"""Difference, relative, beyond which a model explains little."""

_FEW, _OF_SENSORS = 2 * _A_LAG, 0.05
"""Number of values below which autocorrelation is not meaningful, and the relative difference beyond which so
few values count as a poor fit: accelerometers and their amplifiers are specified to 5 % of amplitude."""

_UNIT = 100.0
"""Ratio of sizes from which on a unit is doubtful."""


def misfits(channels: Sequence[Channel], period: float, ratios: Mapping[str, float]) -> list[str]:
    """In words, a sentence each. ratios: by name, how many times as large as computed at the start it was
    measured."""
    from scipy.stats import chi2

    found = [
        f"{name} is measured {ratio:.2g} times as large as computed at the start; look at its unit"
        for name, ratio in ratios.items()
        if not 1 / _UNIT < ratio < _UNIT
    ]
    for name in ratios:
        at, measured, left = _in_order([each for each in channels if each.name == name], period)
        size = float(np.linalg.norm(left) / np.linalg.norm(measured))
        pairs = [_alike(left, lag) for lag in range(1, 1 + min(_MOST_LAGS, len(left) // _A_LAG))]
        noise = chi2.sf(sum(far**2 for far, _ in pairs), max(1, len(pairs)))
        curve = all(each.by_phase for each in channels)
        if curve and len(measured) > 2 and not np.ptp(measured):
            found.append(f"{name} has the same measured value everywhere; check the record")
        elif size > _APART:
            found.append(
                f"{name} differs by {100 * size:.3g} %: the model does not describe it; check unit, sign, "
                "speed and phase origin of the data, or free further parameters"
            )
        elif len(left) < _FEW and size > _OF_SENSORS:
            found.append(
                f"{name} differs by {100 * size:.3g} %, more than typical sensor errors; {len(left)} values "
                "are too few to distinguish noise from model error"
            )
        elif noise < _FALSE / len(ratios) and size > _EXACT:
            alike = max((alike for _, alike in pairs), key=abs)
            found.append(
                f"{name}: differences are no noise, neighbours have a correlation of {alike:+.2f}: the model "
                "does not follow the data, or noise is not independent; 95 % intervals suppose both, and do "
                "not hold"
            )
        if 2 * len(np.unique(np.stack((at, measured)), axis=1).T) <= len(at) and size > _EXACT:
            found.append(f"{name}: duplicate rows; the 95 % intervals count each and are too narrow")
    return found


def _in_order(channels: Sequence[Channel], period: float) -> tuple[Array, Array, Array]:
    """Where one quantity was measured (k,), and there measured and computed less measured: neighbours are of
    one speed and next phases, or of one order or mode and next speeds."""
    by_phase = channels[0].by_phase
    at = np.concatenate([np.mod(each.at, period) if by_phase else each.at for each in channels])
    counts = [len(each.at) for each in channels]
    sets = np.repeat([each.speed if each.position is None else each.position for each in channels], counts)
    order = np.lexsort((at, sets) if by_phase else (sets, at))
    measured = np.concatenate([each.measured for each in channels])[order]
    left = np.concatenate([each.computed for each in channels])[order] - measured
    return (at + 1j * sets)[order], measured, left


def _alike(left: Array, lag: int) -> tuple[float, float]:
    """How far the sum of the products of neighbours is from 0, in its standard deviations as the products
    themselves give them, and the correlation."""
    products = np.real(left[lag:] * np.conj(left[:-lag]))
    spread, size = float(np.sqrt(np.sum(products**2))), float(np.sum(np.abs(left) ** 2))
    total = float(products.sum())
    return (abs(total) / spread, total / size) if spread and size else (0.0, 0.0)
