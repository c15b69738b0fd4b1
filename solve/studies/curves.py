"""Periodic solutions at many speeds on a common grid, as curves."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arguments import matches_annotations
from solve.arrays import Array, uniform_phases
from solve.batch.family import over_speed
from solve.batch.task import task_of
from solve.errors import MatricesError, StepsError
from solve.methods.method import Method
from solve.methods.radau import Radau
from solve.system import PeriodicSystem, multiplier_count
from solve.units import speeds_given

_METHOD = Radau()

_SPEEDS = (1.0, 3.0, 9.0, 27.0, 81.0, 243.0)
"""Speeds (rad/s) at which the matrices are sampled to identify how they depend on the speed; the result is
checked at other speeds. Chosen by judgement: a geometric sequence over two decades."""

_DOUBLINGS = 6
"""Number of times that a monodromy matrix is squared. The result is the 64th power of the matrix, and the
norm of the result bounds the spectral radius."""


@dataclass(frozen=True)
class SolvedCurves:
    """Periodic solutions at P speeds: `q` (P, n, k) with the given number of steps, and `coarse` (P, n, k)
    with half as many. The difference between `q` and `coarse` is an estimate of the error of `q`. Both arrays
    are infinite at speeds without a periodic solution. `radius_bound` (P,) is an upper bound on the spectral
    radius."""

    q: Array
    coarse: Array
    radius_bound: Array


class PeriodicCurves:
    """Solver for the periodic solutions of one system at arbitrary speeds, on a fixed grid. The matrices are
    sampled once for all speeds.

    Parameters
    ----------
    system : PeriodicSystem
        System without discontinuities.
    method : Method
        Method, by default Radau IIA.
    steps : int
        Even number of steps per period.
    samples : int
        Number of phases per step at which q is evaluated.

    Raises
    ------
    StepsError
        For an invalid number of steps.
    MatricesError
        For a system with breaks, because the steps do not end at them.

    Examples
    --------
    >>> import solve
    >>> curves = PeriodicCurves(solve.load("four_bar"), steps=32)
    >>> curves("50 rad/s").q.shape[0]
    1
    """

    @matches_annotations
    def __init__(self, system: PeriodicSystem, method: Method = _METHOD, steps: int = 96, samples: int = 4):
        if not (isinstance(steps, int) and steps >= 2 and steps % 2 == 0):
            raise StepsError(f"steps is {steps!r}; allowed: even numbers of at least 2, such as 96")
        if system.breaks:
            raise MatricesError(
                f"{system.labels.name} has matrices that jump, but the steps of PeriodicCurves do not end at "
                "jumps; call solve.periodic at each speed"
            )
        self.system, self.steps, self.samples = system, steps, samples
        task, _ = task_of(over_speed(system), method, rtol=1e-6, engine="auto")
        self._batch = task.batch(np.array(_SPEEDS)[:, None])

    @cached_property
    def phase(self) -> Array:
        """Phases (k,) of the curves."""
        count = self.steps * self.samples
        return uniform_phases(count, self.system.period)

    @matches_annotations
    def __call__(self, speeds: float | str | Iterable[float | str]) -> SolvedCurves:
        """Solve at speeds (P,), in rad/s or as strings with a unit. Raises UnitError,
        ValueOutOfBoundsError."""
        speeds = np.array(speeds_given(speeds), dtype=float)
        n, coarse_steps = self.system.n, self.steps // 2
        coarse, fine = np.full((2, len(speeds), n, len(self.phase)), np.inf)
        Phi = np.zeros((len(speeds), *2 * (multiplier_count(self.system),)))
        for steps, positions, solutions in self._batch.solutions(speeds[:, None], coarse_steps, self.steps):
            assert solutions.curve is not None
            if steps == coarse_steps:
                coarse[positions] = solutions.curve.sampled(2 * self.samples)
            else:
                fine[positions], Phi[positions] = solutions.curve.sampled(self.samples), solutions.Phi
        return SolvedCurves(fine, coarse, _radius_bound(Phi))


def _radius_bound(Phi: Array) -> Array:
    """Return an upper bound (P,) on the spectral radius of matrices (P, N, N): ‖Φ^k‖^(1/k) for a large power
    k."""
    power, scale = Phi, np.zeros(len(Phi))
    for _ in range(_DOUBLINGS):
        power = power @ power
        size = np.linalg.norm(power, axis=(1, 2))
        size = np.where(size > 0, size, 1.0)
        power, scale = power / size[:, None, None], 2 * scale + np.log(size)
    return np.exp(scale / 2**_DOUBLINGS)
