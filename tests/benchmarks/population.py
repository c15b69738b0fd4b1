"""python -m tests.benchmarks.population [--fresh] [--start I] [--first K] [--every K]: error estimates and
verdicts compared with reference solutions. The program solves the whole population in half an hour, or the
systems I, I + K, I + 2K, … of the first ones. It prints rates for each method, and for each kind and method,
and the worst results. With --fresh, the population is the one on which no estimate was tuned, and `auto` is
the only method."""

import argparse
import sys
from collections.abc import Sequence

from tests.solve.certificates import fresh, population
from tests.solve.certificates.trials import TRIALS, Outcome, grouped, outcomes, rates, request_name

WORST = 10
FRESH_TRIALS = [trial for trial in TRIALS if trial.name == "auto" and trial.rtol in {1e-4, 1e-8}]


def options(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.population", description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="each K-th system")
    parser.add_argument("--start", type=int, default=0, help="none before system I")
    parser.add_argument("--first", type=int, help="none but the first K systems")
    parser.add_argument(
        "--fresh", action="store_true", help="the population on which no estimate was tuned, by `auto` alone"
    )
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    given = options(arguments)
    source, trials = (fresh, FRESH_TRIALS) if given.fresh else (population, TRIALS)
    chosen = range(source.SIZE)[given.start : given.first : given.every]
    found: list[Outcome] = []
    for index in chosen:
        found += outcomes(source.member(index), trials)
        if index % 50 == given.start % 50:
            print(f"system {index} of {source.SIZE}", file=sys.stderr, flush=True)
    print(f"{len(chosen)} systems, {len(found)} results, each with orbit and multipliers\n")
    methods = grouped(found, request_name)
    for name, part in methods.items():
        print(rates(name, part))
    with_steps = [each for each in found if each.trial.steps]
    if with_steps:
        print(rates("given steps", with_steps))
    print(f"\n{'honest, %':24s}" + "".join(f"{kind:>18s}" for kind in source.KINDS))
    for name, part in methods.items():
        shares = {kind: rates(name, of_kind).honest for kind, of_kind in grouped(part, _kind).items()}
        row = (
            f"{100 * shares[kind]:18.2f}" if shares.get(kind, -1) >= 0 else f"{'-':>18s}"
            for kind in source.KINDS
        )
        print(f"{name:24s}" + "".join(row))
    solved = [each for each in found if not each.refusal]
    for title, part in (
        ("contradicted", [each for each in solved if each.contradicted]),
        ("least honest", sorted(solved, key=lambda each: -each.ratio)[:WORST]),
    ):
        print(f"\n{title}")
        for each in part:
            print(each)


def _kind(outcome: Outcome) -> str:
    return outcome.kind


if __name__ == "__main__":
    main()
