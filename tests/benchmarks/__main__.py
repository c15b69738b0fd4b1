"""python -m tests.benchmarks [--slow]: times of contenders relative to calls of this package.

Run it with OMP_NUM_THREADS=1 for one thread.
"""

import sys

from tests.benchmarks.cam import ACCURACY, CONTENDERS, OURS, error
from tests.benchmarks.timing import median


def main() -> None:
    chosen = [c for c in CONTENDERS if c.repeats > 1 or "--slow" in sys.argv[1:]]
    computed = {contender.name: median(contender.run, contender.repeats) for contender in chosen}
    print(f"cam, case 1, 600 rpm, orbit and multipliers, q3 to {ACCURACY:g}: medians, one thread")
    print(f"ratio: to the time of each of the {OURS} calls of this package\n")
    ours = [computed[contender.name][0] for contender in chosen[:OURS]]
    print(f"{'':38}{'ms':>9}{'error':>9}" + "".join(f"{f'ratio {k + 1}':>9}" for k in range(OURS)))
    for contender in chosen:
        seconds, result = computed[contender.name]
        ratios = "".join(f"{seconds / unit:9.3g}" for unit in ours)
        print(f"{contender.name:38}{1e3 * seconds:9.3f}{error(result):9.1e}{ratios}")


if __name__ == "__main__":
    main()
