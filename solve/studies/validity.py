"""Up to which speed the linear model is to be trusted."""

from collections.abc import Sequence

import numpy as np

from solve.arrays import Array
from solve.errors import LinearModelError, SolveError, ValueOutOfBoundsError
from solve.methods.choice import Rule
from solve.results.validity import Validity
from solve.single import periodic
from solve.system import PeriodicSystem, of_system
from solve.terminal import progress
from solve.units import speeds_given


@of_system
def validity(
    system: PeriodicSystem,
    speeds: float | str | Sequence[float | str] | Array,
    at: float = 0.05,
    method: str | Rule = "auto",
    rtol: float = 1e-6,
) -> Validity:
    """`Orbit.linearisation_error` at every speed (rad/s, texts with unit, or one text such as
    "100:900:81 rpm"), and the speed up to which it is at most `at`.

    A speed without a linear orbit, or from which no correction leads on, has no error, and counts as one
    where the model is not trusted. Raises LinearModelError for systems without nonlinear equations, and
    other SolveError subclasses for bad input.
    """
    if not 0 < at <= 1:
        raise ValueOutOfBoundsError(f"at is {at}; allowed: a part > 0 and up to 1, such as 0.05 for 5 %")
    if not system.nonlinear:
        raise LinearModelError(
            f"{system.name} is linear by construction; only a model with nonlinear equations can be off them"
        )
    given = speeds_given(speeds)
    system, omegas = system.shown_in(given[0]), np.sort(given)
    errors, failures = np.full((len(omegas), system.n), np.nan), {}
    with progress.task("speeds", len(omegas)):
        for position, omega in enumerate(omegas.tolist()):
            with progress.subtask("speeds"):
                try:
                    found = periodic(system, omega, method, rtol=rtol).linearisation_error
                    assert found is not None
                    errors[position] = list(found.values())
                except SolveError as reason:
                    failures[position] = str(reason)
    return Validity(system, omegas, errors, at, failures)
