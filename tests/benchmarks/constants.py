"""python -m tests.benchmarks.constants [--every K] [--seed S]: effect of halving and doubling each constant
of the error estimates.

For each value, the program prints rates of honest and sharp estimates and of decided verdicts, and the
processor time including the references. Every K-th system of the population is solved by `auto`, Gauss and
Radau; every K-th system of the fresh population with seed S is solved by `auto`."""

import argparse
import time
from types import ModuleType

from solve.certify import coefficients, comparison, point_solver, refinement, resolution
from solve.period import frozen, multipliers
from tests.solve.certificates import fresh, population
from tests.solve.certificates.trials import TRIALS, outcomes, rates

MODULES = coefficients, comparison, frozen, multipliers, point_solver, refinement, resolution
CONSTANTS = {
    refinement: ("_MAX_GROWTH", "_UNKNOWN"),
    resolution: ("MIN_STEPS", "_MAX_FIRST_STEPS", "_UNRESOLVED", "AIM"),
    comparison: (
        "_COEFFICIENTS",
        "_AMPLIFICATION",
        "PHASES_PER_STEP",
        "SAFETY",
        "NO_DIGIT",
        "RESULT_ROUND_OFF",
    ),
    point_solver: ("_AMPLIFIED",),
    coefficients: ("PHASES", "COEFFICIENT_ROUND_OFF"),
    multipliers: ("UNDERFLOW",),
}
CACHED = coefficients._sampled_phases, resolution._collocation_angle, coefficients._fixed_phases


def set_constant(owner: ModuleType, name: str, value: float) -> None:
    """Set a constant in its module, and in those that import it."""
    present = getattr(owner, name)
    for module in MODULES:
        if vars(module).get(name) is present:
            setattr(module, name, value)
    for function in CACHED:
        function.cache_clear()


def measured(label: str, every: int) -> float:
    """Print the rates, and return the processor time."""
    trials = [trial for trial in TRIALS if trial.name in {"auto", "gauss", "radau"}]
    started, found = time.process_time(), []
    for index in range(6, population.SIZE, every):
        found += outcomes(population.member(index), trials)
    automatic = [trial for trial in trials if trial.name == "auto" and trial.rtol < 1e-2]
    for index in range(6, fresh.SIZE, every):
        if fresh.kind_of(index) != "twenty":
            found += outcomes(fresh.member(index), automatic)
    seconds = time.process_time() - started
    print(f"{seconds:7.1f} s  {rates(label, found)}", flush=True)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.constants", description=__doc__)
    parser.add_argument("--every", type=int, default=142, help="each K-th system")
    parser.add_argument("--seed", type=int, default=fresh.SEED, help="seed of the fresh population")
    every, fresh.SEED = vars(parser.parse_args()).values()
    measured("present values", every)
    for owner, names in CONSTANTS.items():
        for name in names:
            present = getattr(owner, name)
            for value in (type(present)(present / 2), type(present)(2 * present)):
                set_constant(owner, name, value)
                measured(f"{name} {value:.3g}", every)
                set_constant(owner, name, present)


if __name__ == "__main__":
    main()
