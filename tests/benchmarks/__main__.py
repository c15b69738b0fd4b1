"""python -m tests.benchmarks [--slow]: a table of the contenders, slowest against the user's own call.

Run it with OMP_NUM_THREADS=1 for one thread.
"""

import statistics
import sys
import time

from tests.benchmarks.cam import ACCURACY, CONTENDERS, OURS, Contender, error


def measured(contender: Contender) -> tuple[float, float]:
    """Median time in seconds after one run to warm up, and the error."""
    if contender.repeats > 1:
        contender.run()
    times = []
    for _ in range(contender.repeats):
        start = time.perf_counter()
        result = contender.run()
        times.append(time.perf_counter() - start)
    return statistics.median(times), error(result)


def main() -> None:
    chosen = [c for c in CONTENDERS if c.repeats > 1 or "--slow" in sys.argv[1:]]
    found = {contender.name: measured(contender) for contender in chosen}
    unit = found[OURS][0]
    print(f"cam, case 1, 600 rpm, orbit and multipliers, q3 to {ACCURACY:g}: medians, one thread\n")
    print(f"{'':32}{'ms':>12}{'error of q3':>14}{'ratio':>10}{'repeats':>9}")
    for contender in chosen:
        seconds, achieved = found[contender.name]
        print(
            f"{contender.name:32}{1e3 * seconds:12.2f}{achieved:14.1e}"
            f"{seconds / unit:10.1f}{contender.repeats:9d}"
        )


if __name__ == "__main__":
    main()
