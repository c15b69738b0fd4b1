"""python -m tests.benchmarks.zig: kernel compiled by Zig compared with the kernel compiled by GCC or Clang.
The program prints ratios of processor times of steps of Radau's method for several points, see
`lane_compilers`, and ratios of elapsed times of the compilation. Each compiler has an empty cache. Run it
with OMP_NUM_THREADS=1.
"""

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager

from solve.kernel import compiler, library
from tests.benchmarks.lane_compilers import by_lanes, problem
from tests.benchmarks.timing import best

SIZES = 1, 2, 3, 6, 9
ROUNDS = 5


@contextmanager
def environment(**values: str) -> Iterator[None]:
    """Context with other variables of the environment, and no compiler or library of this process."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    forget()
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        forget()


def forget() -> None:
    """Forget the compiler and the libraries of this process."""
    for cached in (compiler.c_compiler, library.library, library.trouble, library.available, library.loaded):
        cached.cache_clear()


def compiled(n: int, cache: str, **values: str) -> tuple[float, float]:
    """Elapsed seconds until n coordinates are solved once, and processor seconds of a later run."""
    with environment(XDG_CACHE_HOME=cache, **values):
        start = time.perf_counter()
        run = by_lanes(n, *problem(n))
        run()
        return time.perf_counter() - start, best(run)


def ratios(n: int) -> tuple[float, float]:
    """Return the ratios of the times of compilation and run, Zig's divided by those of the usual compiler.
    Runs alternate, and the shortest times are used."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        usual, other = zip(
            *((compiled(n, one), compiled(n, two, PATH="", CC="")) for _ in range(ROUNDS)), strict=True
        )
    return other[0][0] / usual[0][0], min(run for _, run in other) / min(run for _, run in usual)


def main() -> None:
    """Print a line per number of coordinates."""
    if not compiler.zig():
        sys.exit("ziglang is not installed: pip install ziglang")
    print(" n  run by Zig / run by the usual compiler  compilation")
    for n in SIZES:
        compilation, run = ratios(n)
        print(f"{n:2}  {run:38.2f}  {compilation:11.2f}", flush=True)


if __name__ == "__main__":
    main()
