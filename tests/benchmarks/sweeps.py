"""python -m tests.benchmarks.sweeps: many points solved together or one at a time; one thread.

Cam over 200 speeds and over speed × k3, Mathieu's chart of 300 × 300 points; SciPy's DOP853 on a sample
of the points, as a user would call it: one solve_ivp on the matrix equation of Φ.
"""

import subprocess
import sys
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import solve
from solve.batch.batch import Batch
from solve.batch.family import over_speed
from solve.batch.gathering import gathered
from solve.kernel.engines import COMPILED, NUMPY
from solve.period.points import SinglePoint, state_rate
from solve.results.points import Kept
from solve.single import request
from tests.benchmarks.kernel import exponent
from tests.benchmarks.timing import median

RTOL = 1e-6
SPEEDS = np.linspace(300, 900, 200) * np.pi / 30

MEMORY = """
import resource, sys, numpy as np, solve
kind = sys.argv[1]
if kind == "cam":
    model = solve.load("cam")
    speeds = np.linspace(300, 900, 100_000) * np.pi / 30
    solve.sweep(model, speeds, rtol=1e-6, quantities=["q1"])
else:
    model, side = solve.load("mathieu", zeta=0.0), np.linspace(0.0, 1.0, 1000)
    solve.chart(model, {"delta": -1 + 11 * side}, {"epsilon": 8 * side}, 1.0, boundaries=False)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def dop853(system, speed: float, rtol: float) -> np.ndarray:
    """Return Φ by integration of the matrix equation, with the phase as independent variable."""
    n, point = system.n, SinglePoint(system, speed)

    def rate(phase, y):
        P = state_rate(point, np.array([phase]))[0, 0, :, :-1]
        return (P @ y.reshape(2 * n, 2 * n)).ravel()

    start = np.eye(2 * n).ravel()
    y = solve_ivp(rate, (0, system.period), start, "DOP853", rtol=rtol, atol=rtol * 1e-3).y
    return y[:, -1].reshape(2 * n, 2 * n)


def dop853_mathieu(delta: float, epsilon: float, rtol: float) -> np.ndarray:
    """The same with Mathieu's equation written out."""

    def rate(t, y):
        stiffness = delta + epsilon * np.cos(2 * t)
        return [y[2], y[3], -stiffness * y[0], -stiffness * y[1]]

    start = [1.0, 0.0, 0.0, 1.0]
    return solve_ivp(rate, (0, np.pi), start, "DOP853", rtol=rtol, atol=rtol).y[:, -1].reshape(2, 2)


def cam_sweeps() -> None:
    """200 speeds with periodic solutions, extrema, multipliers and certificates."""
    cam = solve.load("cam", case="1")
    q = cam.coordinates

    def together(engine: str) -> object:
        return solve.sweep(cam, SPEEDS, rtol=RTOL, quantities=q, engine=engine)

    def one_by_one(engine: str) -> object:
        return [solve.periodic(cam, w, rtol=RTOL, engine=engine).statistics("q1") for w in SPEEDS[::20]]

    unit, _ = median(lambda: together(COMPILED))
    _say("cam, 200 speeds, orbit: compiled lanes", unit, 200, 1.0)
    seconds, _ = median(lambda: together(NUMPY), 3)
    _say("  NumPy batch", seconds, 200, seconds / unit)
    for engine in (COMPILED, NUMPY):
        seconds = 20 * median(lambda engine=engine: one_by_one(engine), 3)[0]
        _say(f"  solve.periodic one by one, {engine} (10 × 20)", seconds, 200, seconds / unit)


def cam_chart() -> None:
    """300 × 300 points of speed × k3, multipliers with certificates; DOP853 on 3 points."""
    cam, side = solve.load("cam", case="1"), np.linspace(0.0, 1.0, 300)
    k3 = 1e8 + 4e8 * side

    def rows(count: int) -> None:
        solve.chart(cam, {"speed": SPEEDS[0] + 62 * side}, {"k3": k3[:count]}, rtol=RTOL, boundaries=False)

    ours = median(lambda: rows(10), 3)[0] * 30
    peer = median(lambda: [dop853(cam, float(w), 1e-7) for w in (40.0, 60.0, 80.0)], 1)[0] / 3 * 90_000
    _say("cam, speed × k3, 300 × 300 (10 rows × 30)", ours, 90_000, 1.0)
    _say("  DOP853 a point (3 points × 30 000)", peer, 90_000, peer / ours)


def mathieu_chart() -> None:
    """300 × 300 points of delta × epsilon with certificates; DOP853 on 100 of them."""
    model, side = solve.load("mathieu", zeta=0.0), np.linspace(0.0, 1.0, 300)
    x, y = {"delta": -1 + 11 * side}, {"epsilon": 0.02 + 7.98 * side}
    grid, _ = median(lambda: solve.chart(model, x, y, 1.0, boundaries=False))
    whole, _ = median(lambda: solve.chart(model, x, y, 1.0), 3)
    points = np.random.default_rng(0).uniform((-1, 0), (10, 8), (100, 2))
    peer = median(lambda: [dop853_mathieu(*point, 1e-8) for point in points], 3)[0] * 900
    _say("Mathieu, 300 × 300: points", grid, 90_000, 1.0)
    _say("  with boundaries to 1e-9 of the range", whole, 90_000, whole / grid)
    _say("  DOP853 a point (100 points × 900)", peer, 90_000, peer / grid)


def exponents() -> None:
    """Fitted powers of the cost in points and in steps (cam, stability and orbit on a fixed grid)."""
    cam = solve.load("cam", case="1")
    kept = Kept(("q1",), warnings=False)

    def grid(points: int, steps: int) -> Callable[[], object]:
        speeds = np.resize(SPEEDS, points)[:, None]
        batch = Batch(
            over_speed(cam), SPEEDS[:, None], solve.Radau(), request(steps, RTOL, COMPILED, orbit=True)
        )
        return lambda: gathered(batch, speeds, kept)

    counts, steps = [512, 1024, 2048, 4096], [128, 256, 512, 1024]
    print(f"cost over points: power {exponent(counts, lambda count: grid(count, 128)):.2f}")
    print(f"cost over steps: power {exponent(steps, lambda count: grid(200, count)):.2f}")


def memory(kind: str) -> None:
    """Largest resident memory of a process that solves 10⁵ cam speeds or 10⁶ Mathieu points."""
    ran = subprocess.run([sys.executable, "-c", MEMORY, kind], capture_output=True, text=True, check=True)
    print(f"memory, {kind}: {float(ran.stdout):.0f} MiB")


def _say(what: str, seconds: float, points: int, ratio: float) -> None:
    print(f"{what:48}{seconds:10.3f} s{1e6 * seconds / points:12.1f} µs/point{ratio:10.1f}", flush=True)


def main() -> None:
    if "--memory" in sys.argv[1:]:
        # First: a process starts with the largest memory of the one that starts it.
        for kind in ("mathieu", "cam"):
            memory(kind)
    print(f"{'':48}{'time':>12}{'':>21}{'ratio':>10}")
    for part in (cam_sweeps, mathieu_chart, cam_chart, exponents):
        part()


if __name__ == "__main__":
    main()
