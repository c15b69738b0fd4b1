"""Matrices sampled at azimuths, their trigonometric interpolant and its harmonics."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solve.approximation import Trigonometric
from solve.arrays import EPS, Array, uniform_phases
from solve.errors import MatricesError, ValueOutOfBoundsError, counted
from solve.matrices import real_arrays

_SAME_AZIMUTH = 1e-9
"""Distance between two azimuths, as a fraction of the period, below which the azimuths count as equal. Chosen
by judgement."""

_MOST_PERIODS = 20
"""Range of azimuths, in periods, above which the azimuths are assumed to be in degrees. A revolution in
degrees would be 57 periods of 2π. Chosen by judgement."""

_MAX_CONDITION = 30.0
"""Condition number of the fit of a series to nonuniform azimuths above which fewer harmonics are fitted.
Errors of the samples and unresolved harmonics are amplified by the condition number. Chosen by judgement: for
uniform azimuths, it is √2."""

_FLATTENING = 0.85
"""Ratio between the logarithmic decays in the last and in the previous quarter of the harmonics, below which
the decay counts as flattening. The ratio is 1 for geometric decay and 0.33 for decay as a power; if both are
present, a large threshold is on the safe side. Measured: with 0.7, the errors of kinks at 24 azimuths exceed
their estimates by a factor of up to 1000."""

_FEWEST_FOR_POWER = 8
"""Smallest number of harmonics for which flattening is tested. Chosen by judgement: with this number, each
quarter has two harmonics."""

_SIGNIFICANT = 64 * EPS
"""Amplitude of a harmonic, relative to the largest amplitude in the same matrix, up to which the harmonic
counts as round-off. Chosen by judgement: about ten operations have this round-off."""


@dataclass(frozen=True)
class Samples:
    """Arrays sampled at several phases of a period. The interpolants have the harmonics 0 … `resolved`.

    Attributes
    ----------
    arrays : sequence of (k, …) arrays
        Values of the interpolants at k uniform phases from 0.
    period : float
        Period in phase.
    azimuths : int
        Number of sampled phases.
    amplification : float
        Factor by which the fit amplifies errors of the samples; 1 for uniform azimuths.
    given : tuple of arrays, optional
        Ascending non-uniform azimuths (k,), and the arrays sampled at these azimuths.
    """

    arrays: tuple[Array, ...]
    period: float
    azimuths: int
    amplification: float = 1.0
    given: tuple[Array, tuple[Array, ...]] | None = None

    @classmethod
    def from_arrays(
        cls, arrays: Sequence[Array], symbols: str, period: float, phases: Sequence[float] | Array | None
    ) -> "Samples":
        """Samples at azimuths that are uniform from 0, or at other azimuths `phases` (k,).

        Raises MatricesError if the arrays have different numbers of azimuths, if azimuths coincide, if there
        are fewer than three azimuths, or if a gap between azimuths is half of the period or longer."""
        counts = {len(array) if array.ndim else 0 for array in arrays}
        if len(counts) != 1 or 0 in counts:
            raise MatricesError(
                f"samples of {', '.join(symbols)} have shapes {[array.shape for array in arrays]}; give each "
                "the same first dimension: the number of phases, 1 or more"
            )
        (count,) = counts
        if phases is None:
            return cls(tuple(arrays), period, count)
        azimuths = _checked_azimuths(phases, count, period)
        order = np.argsort(azimuths)
        azimuths, uniform = azimuths[order], uniform_phases(count, period)
        if np.abs(azimuths - uniform).max() <= _SAME_AZIMUTH * period:
            return cls(tuple(array[order] for array in arrays), period, count)
        return cls._fitted(azimuths, [array[order] for array in arrays], (count - 1) // 2, period)

    @classmethod
    def _fitted(cls, azimuths: Array, arrays: Sequence[Array], most: int, period: float) -> "Samples":
        """Samples at ascending nonuniform azimuths (k,), with at most `most` harmonics."""
        values, amplification = _fit(azimuths, most, period)
        fitted = [(values @ array.reshape(len(array), -1)).reshape(-1, *array.shape[1:]) for array in arrays]
        return cls(tuple(fitted), period, len(azimuths), amplification, (azimuths, tuple(arrays)))

    def __call__(self, phase: Array, speed: float) -> list[Array]:
        """Interpolated arrays (m, …) at phases (m,), for any speed."""
        first, varies, curves = self._columns
        every = np.tile(first, (len(phase), 1))
        if varies.any():
            every[:, varies] = curves(phase)
        ends = np.cumsum([math.prod(array.shape[1:]) for array in self.arrays])[:-1]
        parts = zip(np.split(every, ends, axis=1), self.arrays, strict=True)
        return [part.reshape(len(phase), *array.shape[1:]) for part, array in parts]

    @cached_property
    def _columns(self) -> tuple[Array, Array, Trigonometric]:
        """Return the first value of each entry, whether each entry varies, and the interpolant of the varying
        entries."""
        columns = np.concatenate([array.reshape(len(array), -1) for array in self.arrays], axis=1)
        varies = (columns != columns[0]).any(axis=0)
        return columns[0], varies, Trigonometric(columns[:, varies], self.period)

    @property
    def resolved(self) -> int:
        """Highest harmonic for which the azimuths determine both the cosine and the sine coefficient."""
        return (len(self.arrays[0]) - 1) // 2

    @cached_property
    def envelope(self) -> Array:
        """Largest amplitude (h,) of each harmonic from 0 on, over all entries of all matrices. The amplitudes
        of a matrix are divided by its largest amplitude."""
        envelope = np.zeros(len(self.arrays[0]) // 2 + 1)
        for array in self.arrays:
            amplitudes = np.abs(np.fft.rfft(array, axis=0)).reshape(len(envelope), -1)
            if amplitudes.any():
                envelope = np.maximum(envelope, amplitudes.max(axis=1) / amplitudes.max())
        return envelope

    @property
    def significant(self) -> Array:
        """Numbers (h,) of the harmonics above 0 that exceed round-off in at least one entry."""
        return np.flatnonzero(self.envelope[1:] > _SIGNIFICANT) + 1

    def decay(self, first: float, last: float) -> float:
        """Ratio of the amplitude of harmonic `last` to the amplitude of harmonic `first`, at most 1."""
        return float(_decay(self.envelope[:, None], first, np.array([last]))[0, 0])

    def with_aliases(self) -> "Samples":
        """Return samples to which the aliases of the missing harmonics are added: for k azimuths, the missing
        harmonic k - h aliases to harmonic h. The amplitudes of the missing harmonics are extrapolated from
        the last quarter of the harmonics of each entry."""
        most, count = len(self.envelope) - 1, len(self.arrays[0])
        aliased = np.arange(self.resolved + 1)
        waves = np.cos(np.outer(np.arange(count), aliased) * (2 * math.pi / count))
        arrays = []
        for array in self.arrays:
            amplitudes = 2 * np.abs(np.fft.rfft(array.reshape(count, -1), axis=0)) / count
            ratios = _decay(amplitudes, 3 / 4 * most, self.azimuths - aliased)
            missing = ratios * amplitudes[most - max(1, most // 4) :].max(axis=0)
            arrays.append(array + (waves @ missing).reshape(array.shape))
        return replace(self, arrays=tuple(arrays))

    @property
    def spacing(self) -> int:
        """Greatest common divisor of the numbers of the significant harmonics; 1 if there are none."""
        return max(1, math.gcd(*self.significant.tolist()))

    @property
    def ends(self) -> bool:
        """Whether all harmonics are resolved. This is assumed if the next multiple of the spacing of the
        harmonics is resolved and zero."""
        last = int(self.significant.max(initial=0))
        return last == 0 or last + self.spacing <= self.resolved

    def truncated(self, harmonics: int) -> "Samples":
        """Samples of the interpolants without harmonics above `harmonics`.

        For nonuniform azimuths, higher harmonics alias to all lower harmonics. Interpolants through fewer
        azimuths, which have comparable errors, are used instead."""
        if self.given is not None:
            azimuths, arrays = self.given
            if not harmonics:
                means = [np.broadcast_to(array.mean(axis=0), array.shape) for array in self.arrays]
                return replace(self, arrays=tuple(means), given=None)
            some = np.round(np.linspace(0, len(azimuths), 2 * harmonics + 1, endpoint=False)).astype(int)
            return self._fitted(azimuths[some], [array[some] for array in arrays], harmonics, self.period)
        shortened = []
        for array in self.arrays:
            spectrum = np.fft.rfft(array, axis=0)
            spectrum[harmonics + 1 :] = 0.0
            shortened.append(np.fft.irfft(spectrum, len(array), axis=0))
        return Samples(tuple(shortened), self.period, self.azimuths, self.amplification)


def _decay(amplitudes: Array, first: float, last: Array) -> Array:
    """Return the ratios (L, E), at most 1, of the amplitudes of the harmonics `last` (L,) to the amplitude of
    the harmonic `first`. `amplitudes` (h, E) begin with harmonic 0.

    The ratio is extrapolated from the largest amplitudes in four intervals of harmonics. Amplitudes of smooth
    functions decay geometrically. If the decay of the logarithms is slower in the last interval, as for kinks
    and jumps, the amplitudes are assumed to decay as a power of the harmonic. The intervals are the quarters
    and, because a kink may be visible in the last harmonics only, the last harmonics of the quarters; the
    slower of the two decays is used."""
    most = len(amplitudes) - 1
    if most < 4:
        return np.ones((len(last), amplitudes.shape[1]))
    ends = np.linspace(0, most, 5).round().astype(int)
    # Each quarter includes the last harmonic of the previous quarter, because a single harmonic may be zero.
    starts = np.maximum(ends[:-1], 1), np.maximum(ends[1:] - max(1, most // 8), 1)
    floor = EPS * amplitudes.max(axis=0, initial=np.finfo(float).tiny)
    ratios = []
    for each in starts:
        sizes = np.array([amplitudes[a : b + 1].max(axis=0) for a, b in zip(each, ends[1:], strict=True)])
        ratios.append(_extrapolated_ratio(np.log(np.maximum(sizes, floor)), most, first, last))
    return np.maximum(*ratios)


def _extrapolated_ratio(sizes: Array, most: int, first: float, last: Array) -> Array:
    """Return the ratios (L, E) for the logarithms `sizes` (4, E) of the amplitudes in four intervals of
    `most` harmonics."""
    early, late = (sizes[2] - sizes[0]) / 2, sizes[3] - sizes[2]
    slope = np.maximum(early, late)
    is_flattening = np.zeros(slope.shape, dtype=bool)
    if most >= _FEWEST_FOR_POWER:
        is_flattening = late > _FLATTENING * early
    else:
        slope = (sizes[3] - sizes[1]) / 2
    power = np.minimum(late / math.log(3 / 2), 0.0)
    last = last[:, None]
    exponents = np.where(is_flattening, power * np.log(last / first), slope * (last - first) / (most / 4))
    return np.exp(np.where(np.minimum(early, late) >= 0, 0.0, np.minimum(exponents, 0.0)))


def _checked_azimuths(phases: Sequence[float] | Array, count: int, period: float) -> Array:
    """Azimuths (k,) modulo the period. Raises MatricesError."""
    try:
        azimuths = np.asarray(phases).astype(float, casting="same_kind")
    except (TypeError, ValueError) as error:
        raise MatricesError(
            f"phases are not real numbers: {error}; give one azimuth in rad per sample"
        ) from None
    if azimuths.shape != (count,):
        raise MatricesError(
            f"phases have shape {azimuths.shape} for {counted(count, 'sample')}; "
            "give one azimuth in rad per sample"
        )
    if not np.isfinite(azimuths).all():
        raise MatricesError("phases contain values that are not finite; give azimuths in rad")
    if count < 3:
        raise MatricesError(
            f"{counted(count, 'azimuth does', 'azimuths do')} not determine any harmonic; "
            "give 3 or more azimuths, or matrices without phases if they are constant"
        )
    if np.ptp(azimuths) > _MOST_PERIODS * period:
        raise MatricesError(
            f"azimuths are from {azimuths.min():.6g} to {azimuths.max():.6g} rad, which is "
            f"{np.ptp(azimuths) / period:.3g} periods; give azimuths in rad, not in degrees"
        )
    wrapped = np.mod(azimuths, period)
    ordered = np.sort(wrapped)
    gaps = np.append(np.diff(ordered), ordered[0] + period - ordered[-1])
    if gaps.min() < _SAME_AZIMUTH * period:
        twice = float(ordered[int(gaps.argmin())])
        raise MatricesError(f"two azimuths are {twice:.6g} rad, modulo the period; give each azimuth once")
    if gaps.max() >= period / 2 * (1 - _SAME_AZIMUTH):
        start = float(ordered[int(gaps.argmax())])
        raise MatricesError(
            f"no azimuth lies between {start:.6g} and {start + gaps.max():.6g} rad; this gap is not shorter "
            f"than half of the period {period:.6g}; give azimuths that cover the period"
        )
    return wrapped


def _fit(azimuths: Array, most: int, period: float) -> tuple[Array, float]:
    """Return a matrix (2H+1, k) that converts samples at azimuths (k,) to values of the fitted series at
    uniform phases, and the amplification of errors.

    The number of harmonics H is the largest for which the fit is well conditioned, but at most `most`."""
    for harmonics in range(most, 0, -1):
        design = _waves(azimuths, harmonics, period)
        singular = np.linalg.svd(design, compute_uv=False)
        condition = float(singular[0] / singular[-1]) if singular[-1] > 0 else math.inf
        if condition <= _MAX_CONDITION:
            size = 2 * harmonics + 1
            uniform = _waves(uniform_phases(size, period), harmonics, period)
            return uniform @ np.linalg.pinv(design), max(1.0, condition / math.sqrt(2))
    raise MatricesError(
        f"the {len(azimuths)} azimuths are clustered, so that harmonics cannot be determined; give "
        "azimuths that are distributed over the period"
    )


def _waves(phase: Array, harmonics: int, period: float) -> Array:
    """Values of 1 and of the cosines and sines of the harmonics at phases (m,), as an array (m, 2H+1)."""
    angles = np.outer(phase, np.arange(1, harmonics + 1)) * (2 * math.pi / period)
    return np.concatenate((np.ones((len(phase), 1)), np.cos(angles), np.sin(angles)), axis=1)


def sampled(
    arrays: Sequence[Array], symbols: str, period: float, phases: Sequence[float] | Array | None
) -> Samples:
    """Samples of matrices with the symbols `symbols`. Raises MatricesError, ValueOutOfBoundsError."""
    return Samples.from_arrays(
        real_arrays(arrays, symbols, "samples"), symbols, checked_period(period), phases
    )


def checked_period(period: float) -> float:
    """Return the period. Raises ValueOutOfBoundsError unless it is a finite phase > 0."""
    if isinstance(period, str) or not (math.isfinite(period) and period > 0):
        raise ValueOutOfBoundsError(f"period is {period!r}; allowed: a finite phase > 0, such as 2π")
    return float(period)
