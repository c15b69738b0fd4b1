"""Conditions for a real and finite fundamental motion: the permitted phases, speeds and parameters of a
generated module."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arrays import CACHE_SIZE, ROUND_OFF, Array
from solve.errors import DesiredMotionError
from solve.model.sampling import Sampler
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

_SAMPLES = 131
"""Number of phases per period at which margins are sampled. The minimum of a smooth margin between the phases
is bracketed by three samples, and a change of sign is located by bisection. The number is prime and has no
common factor with the harmonics of margins; 128 phases would sample harmonic 64 at only two values."""

_SHIFT = 0.31
"""Shift of the sampled phases, as a fraction of their spacing. It avoids fractions of the revolution with
small denominators, where symmetric motions have extrema."""

BISECTIONS = 40
"""Number of bisections of the interval between two samples: 0.049 rad · 2⁻⁴⁰ is 4e-14 rad. For the same
reduction, golden-section search needs 1.44 times as many steps."""

_JUMP_SIZE = 1e-6
"""Threshold for jumps, relative to the largest margin. A change of sign between margins with larger moduli is
a jump, not a zero. Chosen by judgement."""

_BATCH_PHASES = 2**16
"""Number of phases, over all points, that are evaluated in one call. Chosen by judgement."""

_GOLDEN = (5**0.5 - 1) / 2


class _Violations(NamedTuple):
    """Violations of conditions (f,): index of the point, index of the condition, phase, and margin."""

    point: Array
    row: Array
    phase: Array
    value: Array


class Domain:
    """Conditions of a generated module on phase, speed and parameters. The free parameters may differ between
    points."""

    def __init__(
        self,
        function: "casadi.Function",
        sampler: Sampler,
        rows: Sequence[tuple[str, str, str, str]],
        period: float,
    ):
        """Store the conditions.

        function: generated function that returns the margins. sampler: evaluation of the function for phases,
        speeds and free parameters. rows: selected conditions of DOMAIN."""
        self._rows, self._sampler, self._period = rows, sampler, float(period)
        relations = np.array([relation for *_, relation in self._rows])
        self._zero, self._positive = relations == "!= 0", relations == "> 0"
        self._cache: dict[tuple[int, bytes, bytes], Array] = {}
        self._by_phase = _depends(function, 0).any()
        self._by_speed = _depends(function, 1)

    @property
    def by_speed(self) -> bool:
        """Whether any condition depends on the speed."""
        return bool(self._by_speed.any())

    def holds(self, speeds: Array, values: Array) -> Array:
        """Return a mask (P,) of the points at which all conditions hold, for speeds (P,) and free parameters
        (P, v)."""
        key = len(values), speeds.tobytes() if self.by_speed else b"", values.tobytes()
        if key not in self._cache:
            while len(self._cache) >= CACHE_SIZE:
                del self._cache[next(iter(self._cache))]
            self._cache[key] = self._evaluate(speeds, values)
        return self._cache[key]

    def _evaluate(self, speeds: Array, values: Array) -> Array:
        points = np.column_stack([speeds if self.by_speed else np.ones_like(speeds), values])
        unique, group = np.unique(points, axis=0, return_inverse=True)
        is_satisfied = np.ones(len(unique), dtype=bool)
        batch = max(1, _BATCH_PHASES // len(self._phases))
        for start in range(0, len(unique), batch):
            some = unique[start : start + batch]
            is_satisfied[start + self._violations(some[:, 0], some[:, 1:]).point] = False
        return is_satisfied[group.ravel()]

    def require(self, speed: float | None = None, at: str = "") -> None:
        """Raise DesiredMotionError if a condition is violated at a speed (rad/s). Without a speed, only
        conditions that do not depend on the speed are tested. at: text of the speed for the message."""
        violations = self._violations(np.array([1.0 if speed is None else speed]), np.zeros((1, 0)))
        if speed is None:
            independent = ~self._by_speed[violations.row]
            violations = _Violations(*(column[independent] for column in violations))
        if not len(violations.row):
            return
        row = int(violations.row.min())
        what, function, margin, relation = self._rows[row]
        of_row = violations.row == row
        where = self._where(row, violations.phase[of_row], violations.value[of_row])
        cure = "the parameters" if speed is None or not self._by_speed[row] else "the speed or the parameters"
        raise DesiredMotionError(
            f"{what} is not real and finite{at and ' at '}{at}: {function} requires {margin} {relation}, "
            f"which is {where}; change {cure}"
        )

    @property
    def _phases(self) -> Array:
        count = _SAMPLES if self._by_phase else 1
        return (np.arange(count) + _SHIFT) * (self._period / count)

    def _where(self, row: int, phase: Array, value: Array) -> str:
        """Text for a violation: the smallest margin and its phase."""
        worst = int(np.argmax(np.isnan(value))) if np.isnan(value).any() else int(np.argmin(value))
        if len(self._phases) == 1:
            return f"{value[worst]:.4g} at every phase"
        if self._zero[row]:
            return f"0 at phase {phase[worst]:.4g}"
        sampled = int(np.isin(self._phases, phase).sum())
        share = f" and fails at {sampled} of {_SAMPLES} phases" if sampled > 1 else ""
        return f"{value[worst]:.4g} at phase {phase[worst]:.4g}{share}"

    def _margins(self, phase: Array, speeds: Array, values: Array) -> Array:
        """Margins (k, R) of the R conditions at k points, each with its phase."""
        with np.errstate(all="ignore"):
            return self._sampler(phase, speeds, values)

    def _violations(self, speeds: Array, values: Array) -> _Violations:
        """Violations at P points: at the sampled phases or, if there are none, at phases between the
        samples."""
        phase, P = self._phases, len(speeds)
        k = len(phase)
        grid = np.tile(phase, P), np.repeat(speeds, k), np.repeat(values, k, axis=0)
        margins = self._margins(*grid).reshape(P, k, -1)
        finite = np.where(np.isfinite(margins), np.abs(margins), 0.0)
        allowed = ROUND_OFF * finite.max(axis=1, keepdims=True)
        point, at, row = np.nonzero(self._fails(margins, allowed))
        violations = [_Violations(point, row, phase[at], margins[point, at, row])]
        if k > 1:
            failed = np.zeros((P, 1, margins.shape[2]), dtype=bool)
            failed[point, 0, row] = True
            violations += [
                self._crossings(margins, allowed, failed, speeds, values),
                self._minima(margins, allowed, failed, speeds, values),
            ]
        return _Violations(*(np.concatenate(field) for field in zip(*violations, strict=True)))

    def _fails(self, margins: Array, allowed: Array) -> Array:
        """Whether margins (…, R) violate the R conditions."""
        size = np.where(self._zero, np.abs(margins), margins)
        strict = self._zero | self._positive
        return ~np.isfinite(margins) | np.where(strict, size <= allowed, size < -allowed)

    def _crossings(
        self, margins: Array, allowed: Array, failed: Array, speeds: Array, values: Array
    ) -> _Violations:
        """Zeros between samples of opposite sign. They are violations of conditions that require a nonzero
        margin."""
        changes = (margins * np.roll(margins, -1, axis=1) < 0) & self._zero & ~failed
        point, at, row = np.nonzero(changes)
        step = self._period / margins.shape[1]
        low = self._phases[at]
        high, first = low + step, margins[point, at, row]
        for _ in range(BISECTIONS if len(point) else 0):
            middle = (low + high) / 2
            same = self._margins(middle, speeds[point], values[point])[np.arange(len(row)), row] * first > 0
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        ends = [self._at(phase, point, row, speeds, values) for phase in (low, high)]
        least = np.minimum(*map(np.abs, ends)) if len(point) else np.zeros(0)
        zero = least <= _JUMP_SIZE / ROUND_OFF * allowed[point, 0, row]
        return _Violations(point[zero], row[zero], low[zero] % self._period, np.zeros(zero.sum()))

    def _minima(
        self, margins: Array, allowed: Array, failed: Array, speeds: Array, values: Array
    ) -> _Violations:
        """Violations at minima between samples. A minimum is sought only if the differences between
        neighbouring samples permit a violation."""
        size = np.where(self._zero, np.abs(margins), margins)
        before, behind = np.roll(size, 1, axis=1), np.roll(size, -1, axis=1)
        reach = np.maximum(before - size, behind - size)
        low = (size <= before) & (size <= behind) & (size - reach <= allowed) & ~failed
        point, at, row = np.nonzero(low)
        step = self._period / margins.shape[1]
        left, right = self._phases[at] - step, self._phases[at] + step

        def sized(phase: Array) -> Array:
            margin = self._at(phase, point, row, speeds, values)
            return np.where(np.isnan(margin), -np.inf, np.where(self._zero[row], np.abs(margin), margin))

        for _ in range(round(1.44 * BISECTIONS) if len(point) else 0):
            inner = right - _GOLDEN * (right - left), left + _GOLDEN * (right - left)
            first = sized(inner[0]) < sized(inner[1])
            left, right = np.where(first, left, inner[0]), np.where(first, inner[1], right)
        middle = (left + right) / 2
        value = self._at(middle, point, row, speeds, values)
        full = np.ones((len(point), margins.shape[2]))
        full[np.arange(len(point)), row] = value
        fails = self._fails(full, allowed[point, 0])[np.arange(len(point)), row]
        return _Violations(point[fails], row[fails], middle[fails] % self._period, value[fails])

    def _at(self, phase: Array, point: Array, row: Array, speeds: Array, values: Array) -> Array:
        """Margins (f,) of the conditions `row` (f,) at the phases (f,) and points `point` (f,)."""
        if not len(phase):
            return np.zeros(0)
        return self._margins(phase, speeds[point], values[point])[np.arange(len(row)), row]


@symbolic
def _depends(function: "casadi.Function", position: int) -> Array:
    """Whether each output of a generated function depends on one of its scalar inputs."""
    pattern = function.jac_sparsity(0, position)
    depends = np.zeros(pattern.size1(), dtype=bool)
    depends[pattern.row()] = True
    return depends
