"""Periodic motion of a functional mock-up unit, found by shooting."""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.errors import FileError
from solve.readers.fmi import Unit

_CLOSED = 1e-10
"""Change of a state over a period, relative to its largest modulus, up to which the motion counts as
periodic. Chosen by judgement: it is several times the error of the integration."""

_INTEGRATION, _MONODROMY = 1e-12, 1e-8
"""Relative tolerances of LSODA for the motion and for the monodromy matrix. The monodromy matrix may be less
accurate, because it is used only in Newton corrections. Chosen by judgement."""

_MOST_CORRECTIONS = 20
"""Largest number of Newton corrections. Chosen by judgement: quadratic convergence requires about five."""

_SLOW = 0.1
"""Ratio of successive residuals above which the monodromy matrix is computed again. Chosen by judgement."""

_SINGULAR = 1e-10
"""Singular value of I - Φ, relative to the largest, below which the motion counts as not isolated. Chosen by
judgement."""

Motion = Callable[[Array], Array]
"""Type of functions that return all states (N, k) at times (k,) in s."""


def closed_motion(unit: Unit, kept: Array, duration: float) -> Motion:
    """Find, by Newton's method, a motion in which the states with the indices `kept` (k,) are periodic.

    The other states start from their start values. Raises FileError if the motion cannot be integrated, is
    not isolated, or is not found."""
    x, Phi, before = unit.start.copy(), None, np.inf
    for _ in range(_MOST_CORRECTIONS):
        motion, end, sizes = _integrated(unit, x, duration)
        residual = (end - x)[kept]
        relative = float((np.abs(residual) / sizes[kept]).max())
        if relative <= _CLOSED:
            return motion
        if Phi is None or relative > _SLOW * before:
            Phi = _monodromy(unit, x, kept, duration)
        before = relative
        x[kept] += _solved(unit, Phi, residual, sizes[kept])
    raise FileError(
        f"'{unit.path}' has no periodic motion near its start values: its states change by {before:.1e} in "
        "a period, relative to their largest values; give start values nearer to the motion, or give 'motion'"
    )


def _solved(unit: Unit, Phi: Array, residual: Array, sizes: Array) -> Array:
    """Solution x of (I - Φ) x = residual. Raises FileError for a multiplier +1."""
    scaled = np.eye(len(Phi)) - Phi * sizes / sizes[:, None]
    singular = np.linalg.svd(scaled, compute_uv=False)
    if singular[-1] <= _SINGULAR * singular[0]:
        raise FileError(
            f"'{unit.path}' has no isolated periodic motion: a multiplier is +1; exclude states that move "
            "freely, such as the angle of the drive"
        )
    return sizes * np.linalg.solve(scaled, residual / sizes)


def _integrated(unit: Unit, x: Array, duration: float) -> tuple[Motion, Array, Array]:
    """Return the motion from initial states (N,), the states (N,) at its end, and the largest moduli (N,) of
    the states. The modulus of a state that remains zero is replaced by 1."""
    from scipy.integrate import solve_ivp

    found = solve_ivp(
        unit.rates,
        (0.0, duration),
        x,
        "LSODA",
        rtol=_INTEGRATION,
        atol=_INTEGRATION * _nonzero(np.abs(x)),
        dense_output=True,
    )
    if not found.success or not np.isfinite(found.y).all():
        reason = " ".join(found.message.split())
        raise FileError(f"'{unit.path}' cannot be integrated over the period: {reason}")
    return found.sol, found.y[:, -1], _nonzero(np.abs(found.y).max(axis=1))


def _nonzero(sizes: Array) -> Array:
    """Replace zeros in `sizes` (N,) by 1."""
    return np.where(sizes > 0, sizes, 1.0)


def _monodromy(unit: Unit, x: Array, kept: Array, duration: float) -> Array:
    """Derivatives (k, k) of the k states `kept` at the end of a period, with respect to the same states at
    its start."""
    from scipy.integrate import solve_ivp

    N, k = len(x), len(kept)

    def rates(time: float, state: Array) -> Array:
        here, tangents = state[:N], state[N:].reshape(N, k)
        return np.concatenate((unit.rates(time, here), unit.products(time, here, tangents).ravel()))

    start = np.concatenate((x, np.eye(N)[:, kept].ravel()))
    found = solve_ivp(rates, (0.0, duration), start, "LSODA", rtol=_MONODROMY, atol=1e-10)
    return found.y[N:, -1].reshape(N, k)[kept]
