"""Processor times, so that other work on the machine counts little."""

import statistics
import time
from collections.abc import Callable
from typing import TypeVar

REPEATS = 5

Result = TypeVar("Result")


def median(run: Callable[[], Result], repeats: int = REPEATS) -> tuple[float, Result]:
    """Median time in seconds, after one run to warm up unless a single one is asked for, and the last
    result."""
    if repeats > 1:
        run()
    times = []
    while True:
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
        if len(times) == repeats:
            return statistics.median(times), result


def best(run: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest time in seconds, over runs that take some milliseconds at least."""
    run()
    times = []
    for _ in range(repeats):
        count, start = 0, time.process_time()
        while time.process_time() - start < 0.02:
            run()
            count += 1
        times.append((time.process_time() - start) / count)
    return min(times)
