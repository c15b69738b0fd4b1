"""Modes too fast for both of two grids: what they may hide of the multipliers."""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.methods.method import Method
from solve.period.frozen import PHASES, Frozen, surviving
from solve.period.multipliers import NEGLIGIBLE, Multipliers

_PHASE_ERROR = 0.25
"""Angle (rad) at the end of a period by which the coarser of two grids may misplace a mode, if they are to
tell their error: beyond it they may agree by chance."""

_FURTHER = np.s_[8::16], np.s_[4::8], np.flatnonzero(np.arange(PHASES) % 4)
"""The phases behind every 16th in the order in which they are asked for, as long as more could change
anything."""

_UNSURE, _FAR = 1.2, 1e-3
"""An exponent and a factor that change nothing where few phases serve."""

_SAME, _CLOSE = 0.1, 0.3
"""Relative change by further phases that counts as none, unless as close as this to what is allowed."""

_DOUBT = 10.0
"""Times what frozen modes leave that may be left: their damping is not that of the modes."""

Witness = Callable[[Array], tuple[Multipliers, Array]]
"""Multipliers of points at positions (k,) by an L-stable method, and the errors (k,) of their orbits as this
shows them, 0 where it is not needed."""


def hidden(
    modes: Frozen, method: Method, steps: Array, multipliers: Multipliers, rtol: float, witness: Witness
) -> Array:
    """Errors (P, 3) of the orbits of points, and of the multipliers relative to the spectral radius and
    absolute, that both of two grids of `steps` (P, 2), the coarser one first, may have from frozen modes that
    they do not follow, or that they misplace by so much of a turn that they may agree by chance.

    An L-stable method loses modes that it does not follow, which is wrong where they truly live on: both
    grids must follow them. Any other may turn those into anything that the finer one does not follow, and is
    judged by one that is L-stable.
    """
    coarser, finer = steps.T
    follows = (coarser if method.l_stable else finer) * method.follows
    limit = np.minimum(follows, method.in_phase(coarser, _PHASE_ERROR))
    followed = modes.within(limit / modes.period)
    errors = np.zeros((len(modes), 3))
    open_ = np.flatnonzero(~followed)
    if method.l_stable:
        if len(open_):
            radius = multipliers.spectral_radius[open_]
            lost, followed[open_] = _survivors(modes[open_], limit[open_], rtol * radius)
            radius = np.maximum(radius, NEGLIGIBLE)
            kept = lost < radius
            share = np.where(kept, lost / np.where(kept, radius, 1.0), 1.0)
            errors[open_, 1:] = np.column_stack((share, _DOUBT * lost)) * ~followed[open_, None]
        return errors
    if len(open_):
        followed[open_] = modes[open_].reach <= limit[open_]
    doubtful = np.flatnonzero(~followed)
    if len(doubtful):
        ours, (truth, orbits) = multipliers[doubtful], witness(doubtful)
        absolute = np.maximum(ours.distance(truth), truth.bound)
        errors[doubtful] = np.column_stack((orbits, ours.difference(truth), absolute))
    return errors


def _survivors(modes: Frozen, limit: Array, allowed: Array) -> tuple[Array, Array]:
    """What a period leaves (P,) of modes beyond the limit (P,), and whether there are none such.

    A few of the phases tell where that matters clearly or clearly not beside what is `allowed` (P,), some
    more where it has settled; all of them tell elsewhere.
    """
    lost, followed = np.ones(len(allowed)), np.zeros(len(allowed), dtype=bool)
    open_ = np.arange(len(allowed))
    known = modes.few_eigenvalues
    for phases in (None, *_FURTHER):
        if phases is not None:
            known = np.concatenate((known, modes[open_].eigenvalues(phases)), axis=1)
        before, left, most = (
            lost[open_],
            surviving(known, modes.period, limit[open_, None, None]),
            allowed[open_],
        )
        matters = left**_UNSURE * _FAR > most
        matters_not = left ** (1 / _UNSURE) < _FAR * most
        same = (np.abs(left - before) < _SAME * left) & (np.abs(left - most) > _CLOSE * most)
        beyond = np.abs(known).max(axis=(1, 2)) * modes.period > limit[open_]
        lost[open_], followed[open_] = left, ~beyond
        still = ~((beyond & (matters | same)) | matters_not)
        open_, known = open_[still], known[still]
        if len(open_) == 0:
            break
    return lost, followed
