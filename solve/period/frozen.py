"""Modes with the coefficients frozen at some phases: how fast they are, bounds first, eigenvalues where
the bounds leave doubt."""

from functools import cached_property

import numpy as np

from solve.arrays import Array, covers_all, solved
from solve.kernel import eigenvalues as kernel
from solve.kernel.engines import COMPILED, NUMPY
from solve.period.multipliers import EPS, scaled_alike
from solve.period.points import Multiplied, Points, Tables, parted, rate_of
from solve.period.rigid_body import ROUNDING, RigidBodyModes, may_be_singular, rigid_body_modes

PHASES = 128
"""At which the coefficients are frozen unless a caller asks for fewer."""

_ITERATIONS = 6

_LOOPED = 9
"""Coordinates up to which elimination by loops over rows, of all points and phases at once, takes as long as
LAPACK; with 27 and one point it takes 1.6 times as long, with 72 3.4 times. Determinants of a hundred
coordinates underflow, too."""

_NULL = 12 * EPS
"""Remainder of an equation whose largest coefficient is about 1 that counts as rounding."""

_LOOKS = 16
"""Phases, about, that tell the sizes of entries."""

_ALIKE = 64.0
"""Ratio of two rows, or of two entries of a column, that costs elimination few digits."""

_FEW = np.s_[::16]
"""Phases that tell how fast modes are, where a guess serves."""

_RETURNS = 1e-6
"""Relative difference of a state after a period that counts as none."""


class Frozen:
    """Of P points, at the middles of k equal parts of the period."""

    def __init__(self, tables: Tables, period: float, engine: str = NUMPY):
        self._tables, self._n, self.period, self._engine = tables, tables.n, period, engine
        self._among: tuple[Array, Array] | None = None

    def __len__(self) -> int:
        return len(self._tables.coefficients)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self._n

    def __getitem__(self, points: Array) -> "Frozen":
        if covers_all(points, len(self)):
            return self
        some = Frozen(self._tables[points], self.period, self._engine)
        if "_fields" in self.__dict__:
            some._among = self._fields, points
        elif self._among is not None:
            some._among = self._among[0], self._among[1][points]
        if "few_eigenvalues" in self.__dict__:
            some.__dict__["few_eigenvalues"] = self.few_eigenvalues[points]
        if "rigid_body_modes" in self.__dict__:
            every = self.rigid_body_modes
            some.__dict__["rigid_body_modes"] = None if every is None else every[points]
        return some

    @cached_property
    def rigid_body_modes(self) -> RigidBodyModes | None:
        """Rigid-body modes at these phases; None if no point has one."""
        if self._n == 1 and not self._tables.own:
            low, high = self._ranges
            M, C, K = np.maximum(-low[:3], high[:3])
            if (K > ROUNDING * (M + C)).all():
                return None
        elif self._n > 1:
            M, C, K = np.moveaxis(self._matrices_at(slice(1)), (3, 4), (1, 2))
            if not may_be_singular(K[:, 0], ROUNDING * (np.abs(M) + np.abs(C))[:, 0]).any():
                return None
        M, C, K = np.moveaxis(self._matrices, (3, 4), (1, 2))
        found = rigid_body_modes(K, C, M)
        return found if found.any.any() else None

    @property
    def matrices(self) -> tuple[Array, Array, Array]:
        """M, C and K (P, k, n, n) with respect to the phase."""
        M, C, K = np.moveaxis(self._matrices, (3, 4), (1, 2))
        return M, C, K

    @property
    def mean_mass(self) -> Array:
        """Mean of M over the period (P, n, n)."""
        return np.moveaxis(self._matrices[0].mean(axis=-1), -1, 0)

    @cached_property
    def _fields(self) -> Array:
        """Entries (3n² + n, P, k)."""
        if self._among is None:
            return self._tables.fields()
        fields, positions = self._among
        return fields[:, positions]

    @cached_property
    def _ranges(self) -> tuple[Array, Array]:
        """Numbers (3n² + n, P) between which the entries are."""
        return self._tables.ranges()

    @property
    def _matrices(self) -> Array:
        return self._matrices_at(slice(None))

    def _matrices_at(self, phases: Array | slice) -> Array:
        """M, C and K (3, n, n, P, k') at some of the phases, of which a slice is taken before the points:
        that copies less."""
        if self._among is not None and "_fields" not in self.__dict__ and isinstance(phases, slice):
            fields, positions = self._among
            fields = fields[..., phases][:, positions]
        else:
            fields = self._fields[..., phases]
        return fields[: 3 * self._n**2].reshape(3, self._n, self._n, *fields.shape[1:])

    @property
    def phases(self) -> Array:
        """At which the coefficients are frozen (k,)."""
        return _middles(self._tables.table.shape[-2], self.period)

    def inertia_steady(self, part: float) -> Array:
        """Whether det M (P,) keeps its sign and falls at no phase to less than a part of its median."""
        if self._n == 1 and not self._tables.own:
            low, high = self._ranges
            steady = (low[0] > part * high[0]) | (high[0] < part * low[0])
            if steady.all():
                return steady
        M = self._fields[: self._n**2].reshape(self._n, self._n, *self._fields.shape[1:])
        if self._n > _LOOPED:
            sign, logarithm = np.linalg.slogdet(np.moveaxis(M, (0, 1), (2, 3)))
            at = np.argsort(logarithm, axis=1)[:, [logarithm.shape[1] // 2]]
            usual = np.take_along_axis(logarithm, at, 1)
            alike = sign == np.take_along_axis(sign, at, 1)
            # No difference, of two that are singular, is not large enough.
            with np.errstate(invalid="ignore"):
                return np.asarray((alike & (logarithm - usual > np.log(part))).all(axis=1))
        M = M.copy()
        determinant: Array = np.ones(M.shape[2:])
        with np.errstate(all="ignore"):
            for k in range(self._n):
                determinant *= M[k, k]
                for i in range(k + 1, self._n):
                    M[i, k + 1 :] -= M[i, k] / M[k, k] * M[k, k + 1 :]
            middle = determinant.shape[1] // 2
            usual = np.partition(determinant, middle, axis=1)[:, [middle]]
            return np.asarray((determinant * np.sign(usual) > part * np.abs(usual)).all(axis=1))

    def eigenvalues(self, phases: Array | slice = slice(None)) -> Array:
        """Eigenvalues (P, k, 2n), by the phase, at some of the phases, all by default."""
        if self._n == 1:
            return _quadratic(*self._matrices_at(phases)[:, 0, 0])
        pencils = self._matrices_at(phases)
        found = kernel.eigenvalues(pencils) if self._engine == COMPILED else None
        if found is None:
            return _of_pencils(pencils)
        missed = np.isnan(found).any(axis=-1)
        if missed.any():
            found[missed] = _of_pencils(pencils[..., missed])
        return found

    @cached_property
    def few_eigenvalues(self) -> Array:
        """Those at every 16th of the phases (P, k', 2n)."""
        return self.eigenvalues(_FEW)

    @property
    def few_reach(self) -> Array:
        """`reach`, as far as these phases tell it (P,)."""
        return np.abs(self.few_eigenvalues).max(axis=(1, 2)) * self.period

    def lasting_rates(self, negligible: float) -> tuple[Array, Array]:
        """Largest moduli (P, 2n) of the rates in ascending order, and the mean decay of their modes over a
        period (P, 2n), relative to the least damped one or to what is negligible."""
        if self._n == 1:
            few = Tables(self._tables.table[..., _FEW, :], self._tables.coefficients, self._tables.entry, 1)
            sizes, rates = _moduli_and_real_parts(*few.fields()[:3])
        else:
            values = self.few_eigenvalues
            order = np.argsort(np.abs(values), axis=-1)
            values = np.take_along_axis(values, order, axis=-1)
            sizes, rates = np.abs(values), np.real(values)
        sizes, rates = sizes.max(axis=1), rates.mean(axis=1)
        with np.errstate(invalid="ignore"):
            left = rates * self.period
            left = left - np.maximum(left.max(axis=1, keepdims=True), np.log(negligible))
            left = np.exp(np.clip(left, -700.0, 0.0))
        return sizes, left

    def equation_factors(self) -> Array | None:
        """Powers of 2 (P, n) that make the inertias in all equations alike, in balanced units of the
        coordinates; 1 for points whose rows differ little. None where they are 1 for all."""
        if self._n == 1:
            return None
        entries = self._matrices
        sizes = np.abs(entries[..., some_phases(entries.shape[-1])]).max(axis=-1)
        own = np.einsum("aiip->aip", sizes)
        with np.errstate(over="ignore"):
            alike = sizes <= _ALIKE * (own + own[:1])[:, None]
        if alike.all():
            return None
        at = np.flatnonzero(~alike.all(axis=(0, 1, 2)))
        coupling = self[at]._coupling[0]
        sound = np.isfinite(coupling).all(axis=(1, 2))
        at, units = at[sound], scaled_alike(coupling[sound])[1]
        with np.errstate(all="ignore"):
            inertia = np.moveaxis(sizes[0][..., at], -1, 0) * units[:, None]
            exponents = -np.round(np.log2(inertia.max(axis=2)))
            exponents -= exponents.max(axis=1, keepdims=True)
        apart = np.isfinite(exponents).all(axis=1) & (exponents.min(axis=1) < -np.log2(_ALIKE))
        factors = np.ones((len(self), self._n))
        factors[at[apart]] = np.exp2(exponents[apart])
        return factors if apart.any() else None

    @property
    def _coupling(self) -> tuple[Array, Array]:
        """How strongly the coordinates (P, n, n) and the loads (P, n) drive coordinates."""
        n = self._n
        rate = np.abs(rate_of(*parted(np.moveaxis(self._fields, 0, -1), n))[..., n:, :]).mean(axis=1)
        return rate[..., :n] + rate[..., n : 2 * n], rate[..., -1]

    def burdens(self, sizes: Array) -> Array:
        """How far all that acts on a coordinate would move it against its own stiffness (P, n): the others,
        as large as `sizes` (P, n), and a load as large as any, in units in which the equations balance."""
        coupling, load = self._coupling
        units = scaled_alike(coupling)[1]
        largest = units * (load / units).max(axis=1, keepdims=True)
        own = 1.0 + np.einsum("pii->pi", coupling)
        return (np.einsum("pij,pj->pi", coupling, sizes) + largest) / own

    def drifts(self, points: Array, Phi: Array, errors: Array) -> Array:
        """Whether points at positions (k,) with monodromy matrices (k, 2n, 2n) and errors (k,) of their
        multipliers move freely in some direction v: C v = K v = 0 at every phase, but for rounding, and Φ,
        which sees what lies between, brings the state (v, 0) back. Then q = v t is a solution, and the
        multiplier +1 is defective."""
        rows = self._remaining(points)
        each = zip(rows, Phi, self.units(points), errors, strict=True)
        return np.array([_drifts(*one) for one in each], dtype=bool)

    def _remaining(self, points: Array) -> Array:
        """C and K as rows (k, r, n) of points at positions (k,) without their rigid-body modes: in relative
        coordinates, whose equations contain no acceleration along the modes."""
        M, C, K = np.moveaxis(self._matrices[..., points, :], (3, 4), (1, 2))
        modes = None if self.rigid_body_modes is None else self.rigid_body_modes[points]
        if modes is not None and modes.any.any():
            relative, kept = modes.relative
            kept = kept[:, None, None]
            C, K = (relative[:, None] @ solved(M, part) * kept for part in (C, K))
            # Reference coordinates are excluded.
            K = K + (1 - kept) * np.eye(self._n)
        return np.concatenate((C, K), axis=2).reshape(len(points), -1, self._n)

    def units(self, points: Array) -> Array:
        """In which the states (k, 2n) of points at positions (k,) are alike: square roots of the mean
        stiffness, or of the inertia where that is larger, and of the inertia, of each coordinate."""
        diagonals = np.abs(np.einsum("aiipk->apik", self._matrices[::2][..., points, :])).mean(axis=-1)
        inertia, stiffness = np.maximum(diagonals, np.finfo(float).tiny)
        return np.sqrt(np.concatenate((np.maximum(stiffness, inertia), inertia), axis=-1))

    @cached_property
    def reach(self) -> Array:
        """ω_max T (P,), the angle that the fastest mode turns in one period."""
        return np.abs(self.eigenvalues()).max(axis=(1, 2)) * self.period

    def faster(self, rate: float) -> Array:
        """Whether sqrt(ρ(M⁻¹K)) or ρ(M⁻¹C) exceeds the rate at any of the phases (P,)."""
        if self._n == 1:
            faster = ~self.surely_within(rate)
            open_ = np.flatnonzero(faster)
            if len(open_):
                faster[open_] = (self[open_]._fastest() > rate).any(axis=1)
            return faster
        limits, ratios = (rate, rate**2), self._ratios()
        # The largest eigenvalue is no less than the mean of all, a part of the trace.
        traces = [np.abs(np.einsum("iipk->pk", part)).max(axis=1) for part in ratios]
        faster = (traces[0] > self._n * limits[0]) | (traces[1] > self._n * limits[1])
        open_ = np.flatnonzero(~faster)
        if len(open_):
            parts = (np.abs(part[:, :, open_]) / limit for part, limit in zip(ratios, limits, strict=True))
            open_ = open_[~np.logical_and(*map(_contracts, parts))]
        if len(open_) > 1:
            stiffest = self[open_]._stiffest()
            faster[open_] = self[open_]._at(stiffest)._fastest()[:, 0] > rate
            open_ = open_[~faster[open_]]
        if len(open_):
            faster[open_] = (self[open_]._fastest() > rate).any(axis=1)
        return faster

    def within(self, reach: Array | float) -> Array:
        """Whether all eigenvalues are sure to have moduli of at most `reach` (P,): λ²M + λC + K
        is regular beyond where (|M⁻¹C|/r + |M⁻¹K|/r²) v ≤ v for some positive v (Perron, Collatz)."""
        reach = np.broadcast_to(reach, len(self))
        if self._n > 1:
            open_ = np.arange(len(self))
            for phases in (some_phases(self._tables.table.shape[-2]), slice(None)):
                open_ = open_[self[open_]._within_at(phases, reach[open_])]
                if not len(open_):
                    break
            inside = np.zeros(len(self), dtype=bool)
            inside[open_] = True
            return inside
        inside = self.surely_within(reach)
        open_ = np.flatnonzero(~inside)
        if len(open_):
            (C, K), reach = self[open_]._ratios(), reach[open_, None]
            # Schur and Cohn's criterion, sharp for a single mode.
            within = (np.abs(K) <= reach**2) & (np.abs(C) <= reach + K / reach)
            inside[open_] = np.all(within, axis=(0, 1, 3))
        return inside

    def _within_at(self, phases: slice, reach: Array) -> Array:
        """The same at some of the phases, of several coordinates."""
        C, K = self._ratios(phases)
        # No sum of squares of the 2n eigenvalues is larger than 2n times that of the largest.
        squares = np.einsum("ijpk,jipk->pk", C, C) - 2 * np.einsum("iipk->pk", K)
        inside = np.abs(squares).max(axis=1) <= 2 * self._n * reach**2
        some = np.flatnonzero(inside)
        if len(some):
            C, K, reach = C[:, :, some], K[:, :, some], reach[some, None]
            inside[some] = _contracts(np.abs(C) / reach + np.abs(K) / reach**2)
        return inside

    def surely_within(self, rate: Array | float) -> Array:
        """Whether |C/M| + |K/M|/rate ≤ rate follows for a single mode (P,) from the ranges of terms that the
        points share; it is then within the rate, and no faster."""
        if self._n > 1 or self._tables.own:
            return np.zeros(len(self), dtype=bool)
        low, high = self._ranges
        C, K = np.maximum(np.abs(low[1:3]), np.abs(high[1:3]))
        with np.errstate(all="ignore"):
            return (low[0] > 0) & (C / low[0] + K / low[0] / rate <= rate)

    def _at(self, phase: int) -> "Frozen":
        entries = np.moveaxis(self._fields[..., phase : phase + 1], 0, -1)
        return Frozen(Tables.of(entries, self._n), self.period, self._engine)

    def _stiffest(self) -> int:
        """The phase at which the point in the middle is stiffest: a guess for the others."""
        middle = self[np.array([len(self) // 2])]
        return int(middle._fastest()[0].argmax())

    def _fastest(self) -> Array:
        """The larger of sqrt(ρ(M⁻¹K)) and ρ(M⁻¹C), (P, k)."""
        M, C, K = np.moveaxis(self._matrices, (1, 2), (3, 4))
        if self._n == 1:
            stiffness, damping = (np.abs(part[..., 0, 0] / M[..., 0, 0]) for part in (K, C))
        else:
            stiffness, damping = (np.abs(_eigenvalues(solved(M, part))).max(axis=-1) for part in (K, C))
        return np.maximum(np.sqrt(stiffness), damping)

    def _ratios(self, phases: slice = slice(None)) -> tuple[Array, Array]:
        """M⁻¹C and M⁻¹K as fields (n, n, P, k), of few coordinates by elimination without exchange, as
        inertia allows."""
        M, C, K = self._matrices_at(phases)
        n, rows = self._n, np.concatenate((M, C, K), axis=1)
        if n > _LOOPED:
            M, CK = np.split(np.moveaxis(rows, (0, 1), (2, 3)), [n], axis=-1)
            C, K = np.split(np.moveaxis(solved(M, CK), (2, 3), (0, 1)), 2, axis=1)
            return C, K
        with np.errstate(all="ignore"):
            for k in range(n):
                rows[k, k + 1 :] /= rows[k, k]
                for i in range(n):
                    if i != k:
                        rows[i, k + 1 :] -= rows[i, k] * rows[k, k + 1 :]
        return rows[:, n : 2 * n], rows[:, 2 * n :]


def frozen(points: Points, phases: int = PHASES, engine: str = NUMPY) -> Frozen:
    """The points with their coefficients frozen at so many phases."""
    return Frozen(points.tables(_middles(phases, points.period)), points.period, engine)


def _middles(count: int, period: float) -> Array:
    """Of so many equal parts of the period."""
    return (np.arange(count) + 0.5) * (period / count)


def some_phases(count: int) -> slice:
    """Of so many phases, as many as tell the sizes of entries."""
    return slice(None, None, max(1, count // _LOOKS))


def balanced(points: Points, modes: Frozen) -> Points:
    """The points, of which these are the frozen modes, with equations in units that are alike: elimination
    chooses its pivots by the sizes of rows."""
    factors = modes.equation_factors()
    return points if factors is None else Multiplied(points, factors)


def surviving(eigenvalues: Array, period: float, limit: Array | float) -> Array:
    """What a period leaves, at most 1, of the least damped mode with ω T above the limit (…), from frozen
    eigenvalues (…, k, 2n) at k phases."""
    size = np.abs(eigenvalues)
    fast = (size * period > limit) | (size == size.max(axis=-1, keepdims=True))
    rates = np.where(fast, np.real(eigenvalues), -np.inf).max(axis=-1)
    return np.exp(np.minimum(rates.mean(axis=-1) * period, 0.0))


def _of_pencils(pencils: Array) -> Array:
    """Eigenvalues (…, 2n) of λ²M + λC + K, fields (3, n, n, …)."""
    M, C, K = np.moveaxis(pencils, (1, 2), (-2, -1))
    return _eigenvalues(rate_of(M, C, K, np.zeros(M.shape[:-1]))[..., :-1])


def _eigenvalues(matrices: Array) -> Array:
    """Eigenvalues (…, N); infinite where a matrix is not finite."""
    if np.isfinite(matrices).all():
        return np.linalg.eigvals(matrices)
    finite = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    values = np.linalg.eigvals(np.where(finite[..., None, None], matrices, 0.0))
    return np.where(finite[..., None], values, np.inf)


def _drifts(rows: Array, Phi: Array, units: Array, error: float) -> bool:
    """Whether equations (k, n) have a solution other than 0, in whatever units they and it are, which the
    monodromy matrix (2n, 2n) leaves as it is, but for an error of the states in `units` (2n,)."""
    for axis in (1, 0):
        largest = np.abs(rows).max(axis=axis, keepdims=True)
        largest = np.where(largest > 0, largest, 1.0)
        rows = rows / largest
    smallest = np.linalg.svd(rows, full_matrices=False)[2][-1]
    if (np.abs(rows @ smallest) > _NULL).any():
        return False
    state = np.concatenate((smallest / largest[0], np.zeros(len(smallest))))
    left, size = np.abs(Phi @ state - state), np.abs(Phi) @ np.abs(state) + np.abs(state)
    return bool((left <= _RETURNS * size + 10 * error * (units * np.abs(state)).max() / units).all())


def _quadratic(M: Array, C: Array, K: Array) -> Array:
    """Roots (…, 2) of λ²M + λC + K."""
    half, product = C / (2 * M), K / M
    root = np.sqrt((half**2 - product).astype(complex))
    larger = -half - np.where(half < 0, -1.0, 1.0) * root
    return np.stack(
        (larger, np.where(larger != 0, product / np.where(larger != 0, larger, 1.0), 0.0)), axis=-1
    )


def _moduli_and_real_parts(M: Array, C: Array, K: Array) -> tuple[Array, Array]:
    """Moduli and real parts (…, 2) of the roots of λ²M + λC + K, the smaller root first, without complex
    numbers."""
    with np.errstate(all="ignore"):
        half, product = C / (2 * M), K / M
        aperiodic = half**2 > product
        root = np.sqrt(np.abs(half**2 - product))
        larger = np.where(aperiodic, -half - np.copysign(root, half), -half)
        smaller = np.where(aperiodic, product / larger, -half)
        size = np.sqrt(np.abs(product))
    moduli = (np.where(aperiodic, np.abs(each), size) for each in (smaller, larger))
    return np.stack(tuple(moduli), axis=-1), np.stack((smaller, larger), axis=-1)


def _contracts(B: Array) -> Array:
    """Whether non-negative fields B (n, n, P, k) are sure to have spectral radii of at most 1 (P,)."""
    v = np.ones(B.shape[1:])
    with np.errstate(all="ignore"):
        for _ in range(_ITERATIONS):
            v = np.einsum("ijpk,jpk->ipk", B, v)
            v = np.maximum(v / v.max(axis=0), 1e-3)
        return (np.einsum("ijpk,jpk->ipk", B, v) <= v).all(axis=(0, 2))
