"""python -m tests.benchmarks.population [--every K]: error estimates and verdicts against the truth, on the
whole population (half an hour) or on each K-th system: rates by method, by kind and method, and the worst
results."""

import argparse
import sys
from collections.abc import Sequence

from tests.solve.certificates.population import KINDS, SIZE, member
from tests.solve.certificates.trials import Outcome, asked, grouped, outcomes, rates

WORST = 10


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.population", description=__doc__)
    parser.add_argument("--every", type=int, default=1, help="each K-th system")
    chosen = range(0, SIZE, parser.parse_args(arguments).every)
    found: list[Outcome] = []
    for index in chosen:
        found += outcomes(member(index))
        if index % 50 == 0:
            print(f"system {index} of {SIZE}", file=sys.stderr, flush=True)
    print(f"{len(chosen)} systems, {len(found)} results, each with orbit and multipliers\n")
    methods = grouped(found, asked)
    for name, part in methods.items():
        print(rates(name, part))
    print(rates("given steps", [each for each in found if each.trial.steps]))
    print(f"\n{'honest, %':24s}" + "".join(f"{kind:>18s}" for kind in KINDS))
    for name, part in methods.items():
        shares = {kind: rates(name, of_kind).honest for kind, of_kind in grouped(part, _kind).items()}
        row = (
            f"{100 * shares[kind]:18.2f}" if shares.get(kind, -1) >= 0 else f"{'-':>18s}" for kind in KINDS
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
