"""The periodic solution over many speeds, a row of figures a speed."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np

from solve.arrays import Array
from solve.batch.family import over_speed
from solve.batch.spread import task_of
from solve.errors import StepsError
from solve.methods.auto import Rule
from solve.results.points import Kept
from solve.results.sweep import Sweep
from solve.system import PeriodicSystem
from solve.units import speeds_given


def sweep(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    executor: Executor | None = None,
    progress: Callable[[int], None] | None = None,
    quantities: Sequence[str] | None = None,
    spectra: Sequence[str] = (),
    harmonics: int = 60,
    engine: str = "auto",
) -> Sweep:
    """`periodic` at every speed (rad/s, texts with unit, or one text such as "100:900:81 rpm"), keeping
    the figures of each.

    quantities: the coordinates and outputs to keep, by default all; bounds on outputs that are not kept
    are not checked. spectra: those whose amplitudes are kept too, of so many `harmonics`. A speed at
    which no periodic solution is found gives NaN and the reason; the sweep goes on. With an executor
    parts of the sweep are handed to it; progress is told the number of points done. engine: "compiled",
    "numpy", or "auto" for the first where there is a C compiler. Raises SolveError subclasses for what no
    speed could mend.
    """
    omegas = np.array(speeds_given(speeds))
    names = system.known_quantities(quantities)
    kept = Kept(names, system.known_quantities(spectra), harmonics if spectra else 0)
    if steps is not None and not (isinstance(steps, int | np.integer) and steps >= 1):
        raise StepsError(
            f"steps is {steps!r}; allowed: whole numbers of at least 1; leave --steps out to have it chosen"
        )
    task, notes = task_of(over_speed(system), method, rtol, engine, kept, steps)
    points = omegas[:, None]
    results = task.solved(task.batch(points), points, executor, progress)
    return Sweep(system, omegas, results, task.request.engine, notes)
