"""python -m tests.benchmarks.frequencies: four frequencies of the four-bar at 36 positions, 2e-6 accurate.

Run it with OMP_NUM_THREADS=1 for one thread.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

import solve
from solve.studies.frequencies import turn
from tests.benchmarks.timing import REPEATS, median

ACCURACY = 2e-6
COUNT = 4
OURS = "dynamic stiffness, 1 a link"


@dataclass(frozen=True)
class Contender:
    name: str
    run: Callable[[], np.ndarray]


@functools.cache
def model(element: str, elements: int):
    return solve.load("four_bar", options={"element": element, "elements": elements})


@functools.cache
def reference() -> np.ndarray:
    """Return frequencies from exact elements, two per link."""
    return solve.frequencies(model("dynamic", 2), turn(model("dynamic", 2)), COUNT).values


def ours(element: str, elements: int) -> np.ndarray:
    chosen = model(element, elements)
    return solve.frequencies(chosen, turn(chosen), COUNT).values


def sparse(elements: int) -> np.ndarray:
    """Return frequencies from SciPy's shift-and-invert Lanczos method with sparse matrices at each
    position."""
    chosen = model("cubic", elements)
    M, K = chosen.at_positions(turn(chosen)).matrices()
    start = np.ones(M.shape[1])
    squares = [
        scipy.sparse.linalg.eigsh(
            scipy.sparse.csc_matrix(k), COUNT, scipy.sparse.csc_matrix(m), sigma=0.0, v0=start,
            return_eigenvectors=False,
        )
        for m, k in zip(M, K, strict=True)
    ]  # fmt: skip
    return np.sort(np.sqrt(squares), axis=1)


CONTENDERS = [
    Contender(OURS, lambda: ours("dynamic", 1)),
    Contender("internal node, 4 a link", lambda: ours("internal", 4)),
    Contender("cubic, 30 a link", lambda: ours("cubic", 30)),
    Contender("cubic, 30 a link, SciPy sparse", lambda: sparse(30)),
]


def error(values: np.ndarray) -> float:
    """Return the largest relative error over positions and modes."""
    return float(np.abs(values / reference() - 1).max())


def main() -> None:
    computed = {contender.name: median(contender.run) for contender in CONTENDERS}
    unit = computed[OURS][0]
    print(f"four-bar, 36 positions, {COUNT} frequencies: medians of {REPEATS}, one thread\n")
    print(f"{'':34}{'ms':>10}{'error':>11}{'ratio':>9}")
    for name, (seconds, values) in computed.items():
        print(f"{name:34}{1e3 * seconds:10.1f}{error(values):11.1e}{seconds / unit:9.1f}")


if __name__ == "__main__":
    main()
