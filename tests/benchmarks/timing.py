"""Processor times, which depend little on other programs."""

import statistics
import time
from collections.abc import Callable
from typing import TypeVar

REPEATS = 5
WARM = 0.2

Result = TypeVar("Result")


def median(run: Callable[[], Result], repeats: int = REPEATS) -> tuple[float, Result]:
    """Return the median time in seconds of `repeats` runs, and the last result. Unless `repeats` is 1, the
    runs are preceded by runs that are not timed: short ones are repeated until WARM seconds have passed,
    because interpreter and caches need about ten runs of a few milliseconds."""
    if repeats == 1:
        start = time.process_time()
        result = run()
        return time.process_time() - start, result
    _times(run, 1)
    times, result = _times(run, repeats)
    return statistics.median(times), result


def _times(run: Callable[[], Result], repeats: int) -> tuple[list[float], Result]:
    times: list[float] = []
    while True:
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
        if len(times) >= repeats and sum(times) >= WARM:
            return times, result


def best(run: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest time in seconds of several runs of at least some milliseconds."""
    run()
    times = []
    for _ in range(repeats):
        count, start = 0, time.process_time()
        while time.process_time() - start < 0.02:
            run()
            count += 1
        times.append((time.process_time() - start) / count)
    return min(times)
