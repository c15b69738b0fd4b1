"""python -m tests.benchmarks.heyoka_peers [--avx2]: heyoka's Taylor integrators compared with certified
solutions.

F. Biscani, D. Izzo, MNRAS 504 (2021) 2614-2628. The programs follow heyoka's documentation: equations as
symbols, compiled once; points in batches of the recommended width; the largest tolerance that reaches the
accuracy. They compute monodromy matrices and the periodic state at the start of the period, but neither error
estimates nor extrema. Run it with OMP_NUM_THREADS=1. --avx2: this package is compiled for AVX2; heyoka uses
all instructions of the processor.
"""

import functools
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

import heyoka as hy
import numpy as np

import solve
from solve.arrays import Array
from solve.kernel import compiler
from solve.kernel.library import Size, lanes
from tests.benchmarks import peers
from tests.benchmarks.kernel import AVX2
from tests.benchmarks.timing import median

SPEEDS = np.linspace(300, 900, 200) * np.pi / 30
RTOL = 1e-6
SIDE = np.linspace(0.0, 1.0, 300)
DELTA, EPSILON = -1 + 11 * SIDE, 0.02 + 7.98 * SIDE
TOLERANCES = {"cam": 1e-5, "mathieu": 1e-5}
"""The loosest powers of ten with which the orbit is right to 1e-6, and Mathieu's multipliers are."""


@functools.cache
def cam(tolerance: float, batch: int = 1):
    """[Φ | x] of chapter Eq. (64) in the phase, with the speed as parameter; M is solved by rows."""
    speed, phase = hy.par[0], hy.time
    law = [(order, peers.LAW[order - 1]) for order in (1, 3, 5)]
    U1 = sum(a * hy.cos(k * phase) for k, a in law)
    U2 = sum(-a * k * hy.sin(k * phase) for k, a in law)
    U3 = sum(-a * k**2 * hy.cos(k * phase) for k, a in law)
    m, force = peers.M2 + peers.M3, peers.F
    system = []
    for column in range(7):
        load = float(column == 6)
        q = hy.make_vars(*(f"q{row}_{column}" for row in range(3)))
        v = hy.make_vars(*(f"v{row}_{column}" for row in range(3)))
        pushed = U3 * q[0] + 2.0 * U2 * v[0] + load * U2
        drive = force * U2 * q[0] + peers.K1 * q[0] + load * force * U1
        r3 = -peers.M3 * speed**2 * pushed - peers.C3 * speed * v[2] - peers.K3 * q[2] - load * force
        r2 = -m * speed**2 * pushed - peers.C2 * speed * v[1] - peers.K2 * q[1] - load * force
        r1 = -m * speed**2 * U1 * pushed - m * speed**2 * U2**2 * q[0] - peers.C1 * speed * v[0] - drive
        a1 = (r1 - U1 * r2) / peers.I1
        a2 = (r2 - r3) / peers.M2 - U1 * a1
        a3 = r3 / peers.M3 - a2 - U1 * a1
        rates = [*v, *(a / speed**2 for a in (a1, a2, a3))]
        system += zip([*q, *v], rates, strict=True)
    return _compiled(system, 42, tolerance, batch)


@functools.cache
def mathieu(tolerance: float, batch: int):
    """Φ of q″ + (δ + ε cos 2t) q = 0."""
    system = []
    for column in range(2):
        q, v = hy.make_vars(f"q_{column}", f"v_{column}")
        system += [(q, v), (v, -(hy.par[0] + hy.par[1] * hy.cos(2.0 * hy.time)) * q)]
    return _compiled(system, 4, tolerance, batch)


def _compiled(system, size: int, tolerance: float, batch: int):
    if batch == 1:
        return hy.taylor_adaptive(system, np.zeros(size), tol=tolerance)
    return hy.taylor_adaptive_batch(system, np.zeros((size, batch)), tol=tolerance)


def cam_single(
    speed: float = peers.SPEED, tolerance: float = TOLERANCES["cam"]
) -> tuple[Array, Array, Array]:
    """Phase 0, q (3, 1) there, and the multipliers."""
    integrator = cam(tolerance)
    integrator.time, integrator.pars[0] = 0.0, speed
    integrator.state[:] = np.eye(6, 7).T.ravel()
    integrator.propagate_until(2 * np.pi)
    maps = integrator.state.reshape(7, 6).T
    x = np.linalg.solve(np.eye(6) - maps[:, :6], maps[:, 6])
    return np.zeros(1), x[:3, None], np.linalg.eigvals(maps[:, :6])


def cam_batch(tolerance: float = TOLERANCES["cam"], spent: list[float] | None = None) -> tuple[Array, Array]:
    """Return q (200, 3) at phase 0 and the multipliers. The seconds spent in heyoka are appended to
    `spent`."""
    width = hy.recommended_simd_size()
    maps = _in_batches(cam(tolerance, width), SPEEDS[:, None], np.eye(6, 7).T.ravel(), 2 * np.pi, spent)
    maps = np.swapaxes(maps.reshape(-1, 7, 6), 1, 2)
    x = np.linalg.solve(np.eye(6) - maps[..., :6], maps[..., 6:])[..., 0]
    return x[:, :3], np.linalg.eigvals(maps[..., :6])


def mathieu_batch(tolerance: float = TOLERANCES["mathieu"], spent: list[float] | None = None) -> Array:
    """Multipliers (90 000, 2) by trace and determinant, δ running fastest."""
    points = np.stack(np.meshgrid(DELTA, EPSILON), axis=-1).reshape(-1, 2)
    integrator = mathieu(tolerance, hy.recommended_simd_size())
    Phi = _in_batches(integrator, points, np.eye(2).ravel(), np.pi, spent)
    half = (Phi[:, 0] + Phi[:, 3]) / 2
    root = np.sqrt((half**2 - (Phi[:, 0] * Phi[:, 3] - Phi[:, 1] * Phi[:, 2])).astype(complex))
    return np.stack((half + root, half - root), axis=-1)


def _in_batches(integrator, points: Array, start: Array, period: float, spent: list[float] | None) -> Array:
    """States (P, k) after a period, points (P, v) being the parameters."""
    width = integrator.batch_size
    filled = np.concatenate((points, np.repeat(points[-1:], -len(points) % width, axis=0)))
    computed = np.empty((len(filled), len(start)))
    for first in range(0, len(filled), width):
        integrator.set_time(np.zeros(width))
        integrator.state[:] = start[:, None]
        integrator.pars[:] = filled[first : first + width].T
        before = time.process_time()
        integrator.propagate_until(np.full(width, period))
        if spent is not None:
            spent.append(time.process_time() - before)
        computed[first : first + width] = integrator.state.T
    return computed[: len(points)]


def processor() -> str:
    """Return the name of the processor, and the number of values per vector register."""
    information = Path("/proc/cpuinfo")
    lines = information.read_text(encoding="utf-8").splitlines() if information.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{(named or [platform.processor()])[0]}, {lanes(Size(3, 5, 6, True, True))} lanes"


def main() -> None:
    if "--avx2" in sys.argv[1:]:
        compiler.MACHINE = AVX2
    model, chart = solve.load("cam", case="1"), solve.load("mathieu", zeta=0.0)

    def single() -> list[float]:
        orbit = solve.periodic(model, peers.SPEED, rtol=RTOL)
        return [orbit.statistics(name).max for name in model.coordinates]

    def mathieu_chart() -> object:
        return solve.chart(chart, {"delta": DELTA}, {"epsilon": EPSILON}, 1.0, rtol=RTOL, boundaries=False)

    def sweep() -> object:
        return solve.sweep(model, SPEEDS, rtol=RTOL, quantities=model.coordinates)

    print(processor())
    rows: list[tuple[str, Callable[[], object], Callable[..., object]]] = [
        ("cam, 600 rpm", single, cam_single),
        ("cam, 200 speeds", sweep, cam_batch),
        ("Mathieu, 300 x 300", mathieu_chart, mathieu_batch),
    ]
    print(f"{'processor time':22}{'ours, ms':>10}{'heyoka, ms':>12}{'within it':>11}{'ratio':>8}")
    for name, ours, theirs in rows:
        unit, seconds = median(ours)[0], median(theirs)[0]
        within = ""
        if theirs is not cam_single:
            spent: list[float] = []
            theirs(spent=spent)
            within = f"{1e3 * sum(spent):.1f}"
        print(
            f"{name:22}{1e3 * unit:10.2f}{1e3 * seconds:12.2f}{within:>11}{seconds / unit:8.2f}", flush=True
        )


if __name__ == "__main__":
    main()
