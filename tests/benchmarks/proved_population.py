"""python -m tests.benchmarks.proved_population [FIRST LAST]: prove smooth systems of the population.

Those with up to three coordinates are stored in tests/solve/certificates/proved.jsonl.

The true errors of the numerical results are printed relative to their estimates. The whole population takes
about ten minutes. Run it with OMP_NUM_THREADS=1.
"""

import json
import sys
from collections import Counter

import numpy as np

import solve
from tests.solve.certificates.population import HALF, member
from tests.solve.certificates.proved import FILE, MOST_COORDINATES

DIGITS = 12


def main() -> None:
    first, last = map(int, sys.argv[1:3]) if len(sys.argv) == 3 else (0, HALF)
    verdicts, ratios, seconds, failed = Counter(), {"multipliers": [], "orbit": []}, [], []
    with FILE.open("w") as stream:
        for index in range(first, last):
            each = member(index)
            if each.n > MOST_COORDINATES:
                continue
            try:
                proof = solve.prove(each.system, each.speed, digits=DIGITS)
            except solve.SolveError as error:
                failed.append(f"{index}: {error}")
                continue
            verdicts[each.kind, proof.verdict, proof.result.verdict] += 1
            seconds.append(proof.seconds)
            if proof.contradicted:
                failed.append(f"{index}: {proof.verdict} is proved, {proof.result.verdict} is estimated")
            estimate = proof.result.error_estimate
            for name, error in proof.true_error.items():
                ratios[name].append(error / getattr(estimate, name))
            record = {key: proof.record[key] for key in ("verdict", "multipliers", "isolated")}
            print(json.dumps({"index": index, **record, "max_abs": proof.max_abs}), file=stream)
    for (kind, proved, ordinary), count in sorted(verdicts.items()):
        print(f"{kind}: {count} proved {proved}, ordinary verdict {ordinary}")
    print(f"processor seconds: median {np.median(seconds):.2f}, largest {max(seconds):.2f}")
    for name, values in ratios.items():
        known = np.array(values)[np.isfinite(values)]
        print(
            f"true error / estimate, {name}: median {np.median(known):.2g}, largest {known.max():.2g}, "
            f"above 1: {(known > 1).sum()} of {len(values)}, unknown {len(values) - len(known)}"
        )
    for line in failed:
        print(line)


if __name__ == "__main__":
    main()
