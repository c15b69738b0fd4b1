"""Warnings about a fit: residuals that are not noise, a doubtful unit, a channel with constant values, and
duplicate rows.

Residuals are not noise if neighbours are correlated. Each autocorrelation is divided by its standard
deviation; the test uses the sum of the squares for several lags (G. M. Ljung, G. E. P. Box, Biometrika 65
(1978) 297-303).
"""

from collections.abc import Mapping, Sequence

import numpy as np

from solve.arrays import Array
from solve.results.fit import Channel
from solve.studies.least_squares import EXACT

_FALSE_ALARMS = 0.003
"""Probability of a false warning, for residuals that are noise. Chosen by judgement."""

_MAX_LAGS, _VALUES_PER_LAG = 6, 6
"""Maximum number of lags, and number of residuals required for each lag. Chosen by judgement."""

_POOR_FIT = 0.5
"""Relative residual above which the model counts as not describing the data. Chosen by judgement."""

_SENSOR_ERROR = 0.05
"""Relative residual above which a fit counts as poor if it has too few values for two lags. Accelerometers
and their amplifiers are specified to 5 % of amplitude."""

_UNIT_RATIO = 100.0
"""Ratio of measured to computed values, or its inverse, above which a unit is doubtful. Chosen by
judgement."""


def diagnose(channels: Sequence[Channel], period: float, ratios: Mapping[str, float]) -> list[str]:
    """Return warnings, one sentence each. `ratios` maps each channel to the ratio of the measured to the
    initially computed values."""
    from scipy.stats import chi2

    warnings = [
        f"{name}: the measured values are {ratio:.2g} times those computed at the start; check the unit"
        for name, ratio in ratios.items()
        if not 1 / _UNIT_RATIO < ratio < _UNIT_RATIO
    ]
    for name in ratios:
        at, measured, residuals = _sorted([channel for channel in channels if channel.name == name], period)
        size = float(np.linalg.norm(residuals) / np.linalg.norm(measured))
        lags = range(1, 1 + min(_MAX_LAGS, len(residuals) // _VALUES_PER_LAG))
        pairs = [_autocorrelation(residuals, lag) for lag in lags]
        noise = chi2.sf(sum(deviation**2 for deviation, _ in pairs), max(1, len(pairs)))
        curve = all(channel.by_phase for channel in channels)
        if curve and len(measured) > 2 and not np.ptp(measured):
            warnings.append(f"{name} has the same measured value everywhere; check the record")
        elif size > _POOR_FIT:
            warnings.append(
                f"{name}: the residuals are {100 * size:.3g} % of the measured values (rms), so the "
                "model does not describe them; check unit, sign, speed and phase origin of the data, "
                "or fit further parameters"
            )
        elif len(residuals) < 2 * _VALUES_PER_LAG and size > _SENSOR_ERROR:
            warnings.append(
                f"{name}: the residuals are {100 * size:.3g} % of the measured values (rms), more than "
                f"typical sensor errors; {len(residuals)} values are too few to distinguish noise from "
                "model error"
            )
        elif noise < _FALSE_ALARMS / len(ratios) and size > EXACT:
            correlation = max((correlation for _, correlation in pairs), key=abs)
            warnings.append(
                f"{name}: neighbouring residuals have a correlation of {correlation:+.2f}: the model "
                "does not describe the data, or the noise is not independent; the 95 % intervals "
                "assume a correct model and independent noise, and are not valid"
            )
        if 2 * len(np.unique(np.stack((at, measured)), axis=1).T) <= len(at) and size > EXACT:
            warnings.append(
                f"{name}: the data contain duplicate rows; the 95 % intervals count every row and are too "
                "narrow"
            )
    return warnings


def _sorted(channels: Sequence[Channel], period: float) -> tuple[Array, Array, Array]:
    """Return, for the measurements of one quantity, their positions (k,) as complex numbers, the measured
    values, and the computed minus the measured values. Curves are sorted by speed, and then by phase;
    amplitudes by order, and then by speed; natural frequencies by mode, and then by position."""
    by_phase = channels[0].by_phase
    at = np.concatenate([np.mod(channel.at, period) if by_phase else channel.at for channel in channels])
    counts = [len(channel.at) for channel in channels]
    sets = np.repeat(
        [channel.speed if channel.position is None else channel.position for channel in channels], counts
    )
    order = np.lexsort((at, sets) if by_phase else (sets, at))
    measured = np.concatenate([channel.measured for channel in channels])[order]
    computed = np.concatenate([channel.computed for channel in channels])[order]
    return (at + 1j * sets)[order], measured, computed - measured


def _autocorrelation(residuals: Array, lag: int) -> tuple[float, float]:
    """Return the autocorrelation at a lag, which is the sum of the products of residuals, normalised in two
    ways. The first value is the modulus of the sum, divided by its standard deviation as estimated from the
    products. The second value is the sum itself, divided by the sum of the squares of the residuals."""
    products = np.real(residuals[lag:] * np.conj(residuals[:-lag]))
    deviation = float(np.sqrt(np.sum(products**2)))
    size = float(np.sum(np.abs(residuals) ** 2))
    total = float(products.sum())
    return (abs(total) / deviation, total / size) if deviation and size else (0.0, 0.0)
