"""python -m tests.benchmarks.bumps [--seed S] [--places N] [--rtol R] [--shape NAME]: verdicts on a
narrow stiffness bump.

The system q″ + 0.02 q′ + (3.9 + b(φ)) q = 0 is asymptotically stable without the bump b, |ρ| = 0.939, and
unstable with it. Bumps with an area of 1/2 are placed at N random phases a, and are not declared as breaks.
Their shapes are a Gaussian exp(-(φ - a)²/w²), one period of cos², and a rectangle of total width w. The
multipliers do not depend on a, so that there is one reference value for each shape and width. It is computed
by fourth-order Magnus steps over the bump, between two matrix exponentials; it is exact for the rectangle."""

import argparse
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import expm

from solve import PeriodicSystem, floquet

DAMPING, STIFFNESS, AREA = 0.02, 3.9, 0.5
TURN = 2 * np.pi
PARTS = 100, 1000, 2000, 4000, 5000, 10_000, 100_000
STEPS = 400
"""Magnus steps of a bump: 200 and 800 change no reference value by more than 1e-9."""

Shape = Callable[[np.ndarray], np.ndarray]
SHAPES: dict[str, tuple[Shape, float]] = {
    "Gaussian": (lambda x: np.exp(-(x**2)) / np.sqrt(np.pi), 7.0),
    "cos²": (lambda x: 2 * np.cos(np.pi * x) ** 2 * (np.abs(x) < 0.5), 0.5),
    "rectangle": (lambda x: 1.0 * (np.abs(x) < 0.5), 0.5),
}
"""Shapes of unit area as functions of x = (φ - a)/w, and |x| beyond which they vanish."""


def system(shape: Shape, place: float, width: float) -> PeriodicSystem:
    def matrices(phase, speed):
        away = np.remainder(phase - place + np.pi, TURN) - np.pi
        one = np.ones((len(phase), 1, 1))
        stiffness = STIFFNESS + AREA * shape(away / width) / width
        return one, DAMPING * one, stiffness[:, None, None], np.zeros((len(phase), 1))

    return PeriodicSystem(matrices, ["q"])


def exact_radius(shape: Shape, end: float, width: float) -> float:
    """Spectral radius by Magnus steps of fourth order (A. Iserles, S. P. Nørsett, Phil. Trans. R. Soc. A 357
    (1999) 983) of the bump, from -end to end times the width."""
    x = np.linspace(-end, end, STEPS + 1)
    h = width * (x[1] - x[0])
    middle, offset = (x[1:] + x[:-1]) / 2, (x[1] - x[0]) * np.sqrt(3) / 6

    def generators(places):
        A = np.zeros((STEPS, 2, 2))
        A[:, 0, 1], A[:, 1, 1] = 1.0, -DAMPING
        A[:, 1, 0] = -STIFFNESS - AREA * shape(places) / width
        return A

    first, second = generators(middle - offset), generators(middle + offset)
    commutator = second @ first - first @ second
    Phi = expm((TURN - 2 * end * width) * np.array([[0.0, 1.0], [-STIFFNESS, -DAMPING]]))
    for step in expm(h / 2 * (first + second) + np.sqrt(3) / 12 * h**2 * commutator):
        Phi = step @ Phi
    return float(np.abs(np.linalg.eigvals(Phi)).max())


def options(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.bumps", description=__doc__)
    parser.add_argument("--seed", type=int, default=42)
    parser.add_argument("--places", type=int, default=400, help="random places of each bump")
    parser.add_argument("--rtol", type=float, default=1e-8)
    parser.add_argument("--shape", choices=list(SHAPES), default="Gaussian")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    given = options(arguments)
    shape, end = SHAPES[given.shape]
    print(f"{given.shape}, {given.places} places, rtol {given.rtol:g}, seed {given.seed}")
    print(f"{'width':>10s}{'exact |ρ|':>12s}{'wrong':>8s}{'dishonest':>11s}{'warned':>8s}{'steps':>8s}")
    for part in PARTS:
        width = TURN / part
        radius = exact_radius(shape, end, width)
        places = np.random.default_rng((given.seed, part)).uniform(0.0, TURN, given.places)
        found = [floquet(system(shape, place, width), 1.0, rtol=given.rtol) for place in places]
        warned = sum(bool(each.warnings) for each in found)
        wrong = sum(each.verdict.endswith("stable") and each.verdict != "unstable" for each in found)
        errors = ((each.spectral_radius / radius - 1, each.error_estimate.multipliers) for each in found)
        dishonest = sum(abs(error) > 10 * estimate + 1e-9 for error, estimate in errors)
        steps = int(np.median([each.steps for each in found]))
        row = f"{wrong:8d}{dishonest:11d}{warned:8d}{steps:8d}"
        print(f"{'T/' + str(part):>10s}{radius:12.7f}{row}", flush=True)


if __name__ == "__main__":
    main()
