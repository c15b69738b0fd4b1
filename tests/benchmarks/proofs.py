"""python -m tests.benchmarks.proofs [smooth|bump] [FIRST LAST]: proofs compared with an independent
integration.

By default, the 200 random smooth systems and 40 phases of a bump are proved, which takes about ten minutes.
Run it with OMP_NUM_THREADS=1.
"""

import sys
from collections import Counter
from collections.abc import Callable

import mpmath
import numpy as np

from solve.errors import MatricesError
from tests.solve.proof.fixed_point import multipliers
from tests.solve.proof.population import Case, bump, contradictions, smooth

COUNTS: dict[str, tuple[Callable[[int], Case], int]] = {"smooth": (smooth, 200), "bump": (bump, 40)}


def compared(name: str, numbers: range) -> None:
    proved, ordinary, seconds, ratios, contradicted, wrong = Counter(), Counter(), [], [], [], []
    for number in numbers:
        case = COUNTS[name][0](number)
        try:
            proof = case.proof()
        except MatricesError:
            # The ordinary result, which a proof stands beside, takes a bump for a jump.
            ordinary["refused"] += 1
            continue
        contradicted += [f"{case.name}: {text}" for text in contradictions(case, proof)]
        radius = float(max(map(abs, multipliers(case.Phi))))
        verdict, estimate = proof.result.verdict, proof.result.error_estimate.multipliers
        true = "unstable" if radius > 1 else "asymptotically stable"
        if verdict not in (true, "undetermined"):
            wrong.append(f"{case.name}: {verdict}, error {estimate:.0e}, |ρ| = {radius:.9g}")
        else:
            ratios.append(proof.true_error["multipliers"] / estimate)
        proved[proof.verdict] += 1
        ordinary[verdict] += 1
        seconds.append(proof.seconds)
    print(f"{name} {numbers.start} to {numbers.stop - 1}: proved {dict(proved)}, ordinary {dict(ordinary)}")
    print(f"  proofs that the integration contradicts: {len(contradicted)}")
    print(f"  ordinary verdicts that are wrong: {len(wrong)}")
    median, largest = np.median(ratios), max(ratios)
    print(f"  true error / estimate, where it is right: median {median:.2g}, largest {largest:.2g}")
    print(f"  processor seconds of a proof: median {np.median(seconds):.2f}, largest {max(seconds):.2f}")
    for line in (*contradicted, *wrong):
        print(f"  {line}")


def main() -> None:
    given = sys.argv[1:]
    for name in given[:1] or COUNTS:
        ends = map(int, given[1:3]) if len(given) == 3 else (0, COUNTS[name][1])
        with mpmath.workdps(30):
            compared(name, range(*ends))


if __name__ == "__main__":
    main()
