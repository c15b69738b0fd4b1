"""python -m tests.benchmarks.suite.exact [NAME …]: computes the results of all systems into `systems.json`.

Taylor series with coefficients of 500 bits (python-flint), step by step over the period. Two computations,
with different step sizes, agree to 36 digits before a result is written with 32. Nothing of `solve` is used.
With names, only these systems are computed again.
"""

import json
import sys

import flint
import mpmath
import numpy as np

from tests.benchmarks.suite.definitions import Definition, definitions
from tests.benchmarks.suite.systems import FILE, NAMES

BITS = 500
LEAST_TERM = 1e-90
"""Size of the last terms of a series that are left out, relative to the largest; 500 bits resolve 1e-150."""
MOST_TERMS = 400
SAMPLES = 4096
"""Phases of the discrete Fourier transform; the series end below harmonic 250."""
DIGITS = 32
AGREEMENT = 1e-36
"""Largest difference of the two computations, relative to each multiplier and to the largest state."""

Series = dict[str, list[tuple[int, list, list]]]


def fourier(definition: Definition) -> Series:
    """Rows [k, A, B] of the Fourier series of M, C, K, d, rounded to 15 digits: these rows are the system."""
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    series = {}
    for name in NAMES:
        values = definition.values(name, phase)
        spectrum = np.fft.rfft(values, axis=0) / SAMPLES
        spectrum[1:] *= 2
        size = np.abs(spectrum).max()
        rows = []
        for k in range(SAMPLES // 8):
            A, B = spectrum[k].real, -spectrum[k].imag
            if k == 0 or max(np.abs(A).max(), np.abs(B).max()) > 1e-13 * size:
                rows.append((k, _rounded(A, size), _rounded(B, size)))
        series[name] = rows
    return series


def _rounded(values: np.ndarray, size: float) -> list:
    shortened = np.array([float(f"{v:.15g}") if abs(v) > 1e-13 * size else 0.0 for v in values.ravel()])
    return shortened.reshape(values.shape).tolist()


def period(series: Series, speed: float, steps: int) -> flint.arb_mat:
    """Return [Φ | x] (2n, 2n+1) over the period for states (q, dq/dφ)."""
    n = len(series["M"][0][1])
    Omega = flint.arb(speed)
    factors = {"M": Omega * Omega, "C": Omega, "K": flint.arb(1), "d": flint.arb(1)}
    state = flint.arb_mat([[int(i == j) for j in range(2 * n + 1)] for i in range(2 * n)])
    h = 2 * flint.arb.pi() / steps
    for step in range(steps):
        start = 2 * flint.arb.pi() * step / steps
        coefficients = {name: _Coefficients(series[name], start, factors[name], n) for name in NAMES}
        state = _advance(state, coefficients, h, n)
        state = flint.arb_mat([[state[i, j].mid() for j in range(2 * n + 1)] for i in range(2 * n)])
    return state


class _Coefficients:
    """Taylor coefficients about a phase of one Fourier series, computed on request."""

    def __init__(self, rows: list, start: flint.arb, factor: flint.arb, n: int):
        self._rows = []
        for k, A, B in rows:
            cosine, sine = (k * start).cos(), (k * start).sin()
            A, B = (flint.arb_mat([v if isinstance(v, list) else [v] for v in X]) * factor for X in (A, B))
            # A cos k(s + x) + B sin k(s + x) = P cos kx + Q sin kx
            self._rows.append((k, A * cosine + B * sine, B * cosine - A * sine))
        self._terms: list = []
        self._powers = [flint.arb(1)] * len(rows)

    def __getitem__(self, j: int):
        while len(self._terms) <= j:
            order = len(self._terms)
            total = None
            for place, (k, P, Q) in enumerate(self._rows):
                if order:
                    self._powers[place] = self._powers[place] * k / order
                if k == 0 and order:
                    continue
                part = (P, Q, -P, -Q)[order % 4] * self._powers[place]
                total = part if total is None else total + part
            self._terms.append(total)
        return self._terms[j]


def _advance(state: flint.arb_mat, coefficients: dict, h: flint.arb, n: int) -> flint.arb_mat:
    M, C, K, d = (coefficients[name] for name in NAMES)
    width = state.ncols()
    q = [flint.arb_mat(state.tolist()[:n])]
    v = [flint.arb_mat(state.tolist()[n:])]
    a: list[flint.arb_mat] = []
    inverse = M[0].inv()
    power, small = flint.arb(1), 0
    sums = [q[0], v[0]]
    largest = max(_size(q[0]), _size(v[0]), 1.0)
    for k in range(MOST_TERMS):
        right = flint.arb_mat(n, width)
        load = d[k]
        if load is not None:
            right = flint.arb_mat(
                [[load[i, 0] if j == width - 1 else 0 for j in range(width)] for i in range(n)]
            )
        for j in range(k + 1):
            for series, terms in ((C, v), (K, q)):
                if series[j] is not None:
                    right = right - series[j] * terms[k - j]
            if j and M[j] is not None:
                right = right - M[j] * a[k - j]
        a.append(inverse * right)
        v.append(a[k] * (flint.arb(1) / (k + 1)))
        q.append(v[k] * (flint.arb(1) / (k + 1)))
        power = power * h
        added = q[-1] * power, v[-1] * power
        sums = [total + term for total, term in zip(sums, added, strict=True)]
        small = small + 1 if max(map(_size, added)) < LEAST_TERM * largest else 0
        if small == 4:
            return flint.arb_mat(sums[0].tolist() + sums[1].tolist())
    raise ArithmeticError("the series does not converge; take more steps")


def _size(matrix: flint.arb_mat) -> float:
    return max(float(abs(entry).mid()) for row in matrix.tolist() for entry in row)


def results(maps: flint.arb_mat, speed: float) -> tuple[list[mpmath.mpc], list[mpmath.mpf]]:
    """Return the multipliers in descending order of modulus, those with positive imaginary part first, and
    the periodic state (q, q̇) at phase 0."""
    N = maps.nrows()
    rows = [[mpmath.mpf(entry.mid().str(140, radius=False)) for entry in row] for row in maps.tolist()]
    Phi = mpmath.matrix([row[:N] for row in rows])
    x = mpmath.lu_solve(mpmath.eye(N) - Phi, mpmath.matrix([row[N] for row in rows]))
    values = mpmath.eig(Phi, left=False, right=False)
    values = sorted(values, key=lambda rho: (-mpmath.mpf(mpmath.nstr(abs(rho), DIGITS)), -rho.imag))
    return values, [x[i] * (speed if i >= N // 2 else 1) for i in range(N)]


def exact(series: Series, speed: float) -> tuple[list[list[str]], list[str]]:
    """Return multipliers and state as text. Raises ArithmeticError if two step sizes give different
    results."""
    most = max(k for name in NAMES for k, *_ in series[name])
    stiffest = np.sqrt(max(np.abs(np.array(A)).max() for _, A, _ in series["K"]))
    mass = min(np.abs(np.diag(np.atleast_2d(np.array(series["M"][0][1])))).max(), 1e300)
    steps = int(max(24, most, 2 * np.pi * stiffest / np.sqrt(mass) / speed / 3))
    with mpmath.workdps(120):
        coarse = results(period(series, speed, steps), speed)
        fine = results(period(series, speed, steps * 3 // 2), speed)
        scale = max(map(abs, fine[1])) or mpmath.mpf(1)
        left = list(coarse[0])
        for rho in fine[0]:
            nearest = min(left, key=lambda other: abs(other - rho))
            left.remove(nearest)
            if abs(nearest - rho) > AGREEMENT * abs(rho):
                raise ArithmeticError(
                    f"multipliers differ by {mpmath.nstr(abs(nearest - rho) / abs(rho), 2)}"
                )
        for one, other in zip(*(result[1] for result in (coarse, fine)), strict=True):
            if abs(one - other) > AGREEMENT * scale:
                raise ArithmeticError("orbits differ")
        multipliers = [[_text(rho.real, abs(rho)), _text(rho.imag, abs(rho))] for rho in fine[0]]
        return multipliers, [_text(number, scale) for number in fine[1]]


def _text(number: mpmath.mpf, scale: mpmath.mpf) -> str:
    """Return decimals to DIGITS digits, or "0" for values below the agreement of the two computations."""
    return "0" if abs(number) < AGREEMENT * scale else mpmath.nstr(number, DIGITS, strip_zeros=False)


def main() -> None:
    flint.ctx.prec = BITS
    names, stored = sys.argv[1:], {}
    if names:
        stored = {
            record["name"]: record for record in json.loads(FILE.read_text(encoding="utf-8"))["systems"]
        }
    records = []
    for definition in definitions():
        if names and definition.name not in names:
            records.append(stored[definition.name])
            continue
        series = fourier(definition)
        multipliers, state = exact(series, definition.speed)
        records.append(
            {"name": definition.name, "about": definition.about, "speed": definition.speed, **series}
            | {"multipliers": multipliers, "state": state}
        )
        print(f"{definition.name:32}{multipliers[0]}", file=sys.stderr)
    lines = ",\n".join(json.dumps(record, ensure_ascii=False) for record in records)
    FILE.write_text(f'{{"format": 1, "systems": [\n{lines}\n]}}\n', encoding="utf-8")


if __name__ == "__main__":
    main()
