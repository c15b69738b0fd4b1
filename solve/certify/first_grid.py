"""Steps of the first grid, foreseen for each point from its modes at a few phases."""

import numpy as np

from solve.arrays import Array
from solve.certify.pace import LEAST, sure_powers
from solve.methods.method import Method
from solve.period.frozen import Frozen

_ORBIT_LEAST = 16
"""Steps to begin with where loads of high orders may look like low ones, and where steps are samples of a
series, which shows nothing of what it leaves out."""

_DAMPING_LEAST = 64
"""Steps to begin with where stiff modes may be present that need not be followed."""

_MOST = 1024
"""Steps to begin with at most, however fast modes are."""

_PART, _USUAL_RTOL = 0.65, 1e-6
"""Part of the angle that the method follows which the fastest mode may turn in a step of the first grid, at
this `rtol`."""

_FINEST = 0.25
"""Part of it at least at others."""

_FEW, _COARSER = 4, 2.0
"""Coordinates up to which a grid in vain takes longer than steps in vain; how much farther the mode may turn
with more of these."""


def first_steps(method: Method, modes: Frozen, orbit: bool, rtol: float) -> Array:
    """Steps (P,) of the first grid, for orbits or for multipliers alone: so many that no mode of which more
    than `rtol` lasts for the period turns far in one of them, so that a somewhat finer grid tells its error;
    and others no farther than a method that does not damp them follows them."""
    least = LEAST
    if method.l_stable:
        least = _DAMPING_LEAST
    elif orbit or method.spectral:
        least = _ORBIT_LEAST
    finer = (rtol / _USUAL_RTOL) ** (1 / sure_powers(method).min())
    coarser = 1.0 if modes.n <= _FEW else _COARSER
    angle = method.follows * min(1.0, _PART * max(finer, _FINEST) * coarser)
    steps = np.full(len(modes), least)
    open_ = np.flatnonzero(~modes.surely_within(least * angle / modes.period))
    if len(open_) and not method.spectral:
        some = modes[open_]
        wanted = some.lasting(rtol) / angle
        if not method.l_stable:
            wanted = np.maximum(wanted, some.few_reach / method.follows)
        # Powers of 2 alone, so that many points share their grids.
        steps[open_] = np.exp2(np.round(np.log2(np.clip(wanted, least, _MOST))))
    return steps
