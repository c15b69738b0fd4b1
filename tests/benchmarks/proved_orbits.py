"""python -m tests.benchmarks.proved_orbits [--manipulator]: proofs of nonlinear orbits, and their cost.

Orbits of a hardening and of a softening Duffing oscillator along a branch that turns back twice, from
harmonic balance with one harmonic of growing amplitude. Run it with OMP_NUM_THREADS=1.
"""

import sys
from collections import Counter
from functools import partial

import numpy as np

import solve
from tests.solve.newton.mechanisms import duffing, model_of

COUNT = 30
"""Orbits on each side of the branch."""

CASES = {
    "hardening": ({"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.5}, 2.0),
    "softening": ({"zeta": 0.1, "k": 1.0, "alpha": -0.1, "f": 0.4}, 2.2),
}
"""Numbers of the cases, and the largest amplitude of one harmonic."""


def branch(numbers: dict[str, float], largest: float) -> list[tuple[float, float, float]]:
    """Speed, amplitude and phase by |k − Ω² + 3αa²/4 + 2iζΩ| a = f, with two speeds for an amplitude."""
    zeta, k, alpha, f = (numbers[name] for name in ("zeta", "k", "alpha", "f"))
    found = []
    for side in (-1, 1):
        for a in np.linspace(0.12, 1.0, COUNT) * largest:
            stiffness = k + 0.75 * alpha * a**2
            # (s − x)² + 4ζ²x = (f/a)² for x = Ω².
            half, rest = stiffness - 2 * zeta**2, stiffness**2 - (f / a) ** 2
            if half**2 > rest and (x := half + side * np.sqrt(half**2 - rest)) > 0.01:
                angle = -np.angle(complex(stiffness - x, 2 * zeta * np.sqrt(x)))
                found.append((float(np.sqrt(x)), float(a), float(angle)))
    return found


def proved(name: str, numbers: dict[str, float], largest: float) -> None:
    model, seconds, radii, verdicts, failed = model_of(duffing(), **numbers), [], [], Counter(), []
    for speed, a, angle in branch(numbers, largest):
        start = partial(lambda a, b, phase: a * np.cos(phase + b)[None], a, angle)
        try:
            proof = solve.prove(solve.nonlinear(model, speed, start))
        except solve.SolveError as error:
            failed.append(f"speed {speed:.4f}, amplitude {a:.3f}: {error}")
            continue
        seconds.append(proof.seconds)
        if proof.orbit is None:
            failed.append(f"speed {speed:.4f}, amplitude {a:.3f}: {proof.warnings[0]}")
            continue
        verdicts[proof.verdict] += 1
        radii.append(proof.orbit.radius["q"][0] / proof.statistics("q")[1])
    print(f"{name} Duffing oscillator, {numbers}: {len(radii)} orbits proved, {dict(verdicts)}")
    print(f"  processor seconds: median {np.median(seconds):.2f}, largest {max(seconds):.2f}")
    print(f"  radius over max|q|: median {np.median(radii):.1e}, largest {max(radii):.1e}")
    for line in failed:
        print(f"  not proved: {line}")


def main() -> None:
    for name, case in CASES.items():
        proved(name, *case)
    if "--manipulator" in sys.argv[1:]:
        proof = solve.prove(solve.nonlinear(solve.load("manipulator"), "50 rpm"))
        assert proof.orbit is not None
        radii = {name: radius[0] for name, radius in proof.orbit.radius.items()}
        print(
            f"manipulator, 50 rpm: {proof.verdict}, {proof.seconds:.1f} s, {proof.steps} steps, radii {radii}"
        )


if __name__ == "__main__":
    main()
