"""What is kept of every point, in arrays: a point costs some hundred bytes."""

from collections.abc import Callable, Sequence

import numpy as np

from solve.arrays import Array
from solve.batch.batch import Batch
from solve.batch.family import Family
from solve.batch.figures import FIGURES, Signals
from solve.batch.refinement import Found
from solve.batch.spectra import VERDICTS, verdicts
from solve.certificate import Refinement
from solve.errors import SolveError
from solve.floquet import NEAR_ONE, Stability, floquet
from solve.load import Model
from solve.methods.grid import Grid
from solve.methods.method import Solution
from solve.orbit import Orbit, Turn
from solve.periodic import periodic
from solve.signal import Statistics
from solve.system import PeriodicSystem

FAILED = -1
"""Place of a verdict where there is none."""

_ABSENT = Statistics(*(float(sign + "inf") for sign in ("-", "+", "-", "", "", "", "")))
"""Of a quantity that nobody asked for: it keeps within all bounds."""


class Results:
    """Arrays over P points.

    figures (P, q, 7) of the quantities `names`; amplitudes (P, chosen, count + 1); multipliers (P, N),
    zero where unresolved; errors (P, 2) of orbit and multipliers; verdicts (P,), positions in VERDICTS
    or FAILED; steps (P,); methods: a name a point. warnings and failures: texts by point.
    """

    def __init__(self, count: int, n: int, names: Sequence[str], chosen: Sequence[str] = (), harmonics: int = 0):
        self.names, self.chosen, self.harmonics = tuple(names), tuple(chosen), harmonics
        self.figures = np.full((count, len(names), len(FIGURES)), np.nan)
        self.amplitudes = np.full((count, len(chosen), harmonics + 1), np.nan)
        self.multipliers = np.full((count, 2 * n), np.nan, dtype=complex)
        self.errors = np.full((count, 2), np.nan)
        self.verdicts = np.full(count, FAILED, dtype=np.int8)
        self.steps = np.zeros(count, dtype=np.int64)
        self.methods = np.full(count, "", dtype="U16")
        self.warnings: dict[int, list[str]] = {}
        self.failures: dict[int, str] = {}

    def __len__(self) -> int:
        return len(self.steps)
