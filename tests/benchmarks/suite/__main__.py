"""python -m tests.benchmarks.suite [--target 1e-6] [--limit 20] [NAME …]: processor times at equal measured
accuracy.

The tolerance of each program is the largest power of ten for which the errors are at most the target. These
are the errors of the multipliers, relative to the spectral radius, and of q and q̇ at φ = 0, each relative to
its largest entry. Preparation before the first solution, such as compilation, is not timed. A program is
stopped if it takes more processor time (s) for a system than the limit. NAME: of a program or a system. Run
it with OMP_NUM_THREADS=1.
"""

import argparse
import math
import os
import platform
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import metadata
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from solve.arrays import Array
from tests.benchmarks.suite.contenders import CONTENDERS, Solver, UnsuitableError
from tests.benchmarks.suite.systems import FourierSystem, load
from tests.benchmarks.timing import median

LOOSEST, TIGHTEST = 2, 13
LIBRARIES = "numpy", "scipy", "casadi", "jax", "heyoka"


class NoTimeError(Exception):
    """Raised if a program does not solve a system; the text is the reason."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Context that raises TimeoutError after the given processor seconds, as soon as Python code runs."""

    def stop(*_: object) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, stop)
    # Repeated: callbacks of libraries swallow exceptions.
    signal.setitimer(signal.ITIMER_PROF, seconds, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def errors(system: FourierSystem, multipliers: Array, state: Array) -> tuple[float, float]:
    """Errors of the multipliers and of the state at φ = 0, both relative."""
    distances = np.abs(np.asarray(multipliers)[:, None] - system.multipliers)
    matched = distances[linear_sum_assignment(distances)]
    halves = np.split(state - system.state, 2), np.split(system.state, 2)
    sizes = [np.abs(half).max() for half in halves[1]]
    differences = [
        np.abs(difference).max() / (size or 1.0) for difference, size in zip(halves[0], sizes, strict=True)
    ]
    return float(matched.max() / np.abs(system.multipliers).max()), float(max(differences))


def measured(system: FourierSystem, solver: Solver, target: float, limit: float) -> float:
    """Return the time in seconds of a solution at the largest tolerance that reaches the target. Raises
    NoTimeError."""
    try:
        with limited(limit):
            run, seconds = _loosest(system, solver, target)
    except TimeoutError:
        raise NoTimeError(f"over {limit:g} s") from None
    except NoTimeError:
        raise
    except Exception as reason:
        raise NoTimeError(type(reason).__name__) from reason
    # The first call prepared what later ones reuse: compiled code, an integrator.
    return median(run, repeats=3 if seconds < 2.0 else 1)[0]


def _loosest(system: FourierSystem, solver: Solver, target: float) -> tuple[Callable[[], object], float]:
    error = math.inf
    for power in range(LOOSEST, TIGHTEST + 1):
        run = partial(solver, 10.0**-power)
        seconds, result = median(run, repeats=1)
        if not all(np.isfinite(values).all() for values in result):
            raise NoTimeError("not resolved")
        error = max(errors(system, *result))
        if error <= target:
            return run, seconds
    raise NoTimeError(f"error {error:.0e}")


def environment() -> str:
    """Processor, load and versions of this run."""
    processor = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        found = re.search(r"model name\s*: (.*)", cpuinfo.read_text())
        processor = found[1] if found else processor
    installed = {package.name: package.version for package in metadata.distributions()}
    versions = [f"{name} {installed[name]}" for name in LIBRARIES if name in installed]
    load = os.getloadavg()[0]
    return f"{processor}; load {load:.1f}; Python {platform.python_version()}, {', '.join(versions)}"


def main() -> None:
    parser = argparse.ArgumentParser(description="Processor times at equal measured accuracy.")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--target", type=float, default=1e-6)
    parser.add_argument("--limit", type=float, default=20.0)
    arguments = parser.parse_args()
    systems = load()
    known = [*CONTENDERS, *(system.name for system in systems)]
    if unknown := [name for name in arguments.names if name not in known]:
        parser.error(f"no system or installed program is named '{unknown[0]}'; known: {', '.join(known)}")
    for option, value in (("--target", arguments.target), ("--limit", arguments.limit)):
        if not 0.0 < value < math.inf:
            parser.error(f"{option} is {value:g}; give a positive number")
    programs = [name for name in CONTENDERS if name in arguments.names] or [*CONTENDERS]
    systems = [system for system in systems if system.name in arguments.names] or systems
    print(f"Milliseconds at an error of at most {arguments.target:g}; a text is why there is no time")
    print(environment(), end="\n\n")
    print(f"{'':30}" + "".join(f"{name:>15}" for name in programs))
    times: dict[str, dict[str, float]] = {name: {} for name in programs}
    for system in systems:
        row = f"{system.name:30}"
        for name in programs:
            try:
                seconds = measured(system, CONTENDERS[name](system), arguments.target, arguments.limit)
            except (NoTimeError, UnsuitableError) as reason:
                row += f"{str(reason)[:14]:>15}"
            else:
                times[name][system.name] = seconds
                row += f"{1e3 * seconds:15.2f}"
        print(row, flush=True)
    print(f"\n{'systems solved':30}" + "".join(f"{len(times[name]):15}" for name in programs))
    print(
        f"{'time over that of ' + programs[0]:30}"
        + "".join(_ratio(times, name, programs[0]) for name in programs)
    )


def _ratio(times: dict[str, dict[str, float]], name: str, reference: str) -> str:
    """Geometric mean over the systems that both solved; a dash if there are none."""
    both = times[name].keys() & times[reference].keys()
    if not both:
        return f"{'–':>15}"
    mean = math.fsum(math.log(times[name][key] / times[reference][key]) for key in both) / len(both)
    return f"{math.exp(mean):15.3g}"


if __name__ == "__main__":
    main()
