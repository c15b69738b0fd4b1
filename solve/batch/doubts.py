"""What two grids do not show of many points: modes too fast for both, as the certificate judges them."""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.batch.spectra import Spectra
from solve.batch.stiffness import Stiffness
from solve.batch.tables import Chunk
from solve.certify.certificate import surviving
from solve.methods.gauss import Gauss
from solve.methods.radau import Radau
from solve.period.multipliers import NEGLIGIBLE

FROZEN_PHASES = 128
"""At which the certificate freezes the coefficients."""

_EVERY = np.arange(FROZEN_PHASES)
_STAGES = _EVERY[::16], _EVERY[8::16], _EVERY[4::8], np.flatnonzero(_EVERY % 4)
"""The phases in the order in which they are asked for, as long as more could change anything."""

_DOUBT, _FAR = 1.2, 1e-3
"""An exponent and a factor that change nothing where few phases serve."""

_SAME, _CLOSE = 0.1, 0.3
"""Relative change by further phases that counts as none, unless as close as this to what is allowed."""


class Doubts:
    """Hidden errors of multipliers under a method; `witness` gives those of an L-stable method."""

    def __init__(self, method: Gauss | Radau, chunk: Chunk, rtol: float, witness: Callable[[Array], Spectra]):
        self.method, self.period, self.rtol = method, chunk.period, rtol
        self._chunk, self._witness = chunk, witness

    def hidden(self, steps: int, positions: Array, spectra: Spectra) -> tuple[Array, Array]:
        """Errors (k,) relative to the spectral radius, and whether the steps follow the fastest modes."""
        limit = steps * self.method.follows
        stiffness = frozen(self._chunk, positions, FROZEN_PHASES)
        resolved = stiffness.within(limit / self.period)
        errors = np.zeros(len(positions))
        open_ = np.flatnonzero(~resolved)
        if len(open_) and self.method.l_stable:
            lost, follows = self._survivors(stiffness[open_], limit, spectra.radius[open_])
            radius = spectra.radius[open_]
            radius = np.maximum(radius, NEGLIGIBLE)
            kept = lost < radius
            errors[open_] = np.where(kept, lost / np.where(kept, radius, 1.0), 1.0) * ~follows
            resolved[open_] = follows
        elif len(open_):
            size = np.abs(stiffness[open_].eigenvalues()).max(axis=(1, 2))
            resolved[open_] = size * self.period <= limit
            open_ = open_[~resolved[open_]]
            if len(open_):
                errors[open_] = spectra[open_].difference(self._witness(positions[open_]))
        return errors, resolved

    def _survivors(self, stiffness: Stiffness, limit: float, radius: Array) -> tuple[Array, Array]:
        """What a period leaves of modes beyond the limit, and whether there are none such.

        A few of the phases tell where that matters clearly or clearly not, some more where it has
        settled; all of them tell elsewhere.
        """
        lost, follows = np.ones(len(radius)), np.zeros(len(radius), dtype=bool)
        open_, known = np.arange(len(radius)), np.empty((len(radius), 0, 2 * self._chunk.n))
        for phases in _STAGES:
            known = np.concatenate((known, stiffness[open_].eigenvalues(phases)), axis=1)
            before, found = lost[open_], surviving(known, self.period, limit)
            allowed = self.rtol * radius[open_]
            matters = found**_DOUBT * _FAR > allowed
            matters_not = found ** (1 / _DOUBT) < _FAR * allowed
            same = (np.abs(found - before) < _SAME * found) & (np.abs(found - allowed) > _CLOSE * allowed)
            beyond = np.abs(known).max(axis=(1, 2)) * self.period > limit
            lost[open_], follows[open_] = found, ~beyond
            still = ~((beyond & (matters | same)) | matters_not)
            open_, known = open_[still], known[still]
            if len(open_) == 0:
                break
        return lost, follows


def frozen(chunk: Chunk, positions: Array, phases: int) -> Stiffness:
    """The coefficients of some points, frozen in the middles of so many parts of the period."""
    phase = (np.arange(phases) + 0.5) * (chunk.period / phases)
    tables, coefficients = chunk.tables(("frozen", phases), phase, positions)
    return Stiffness(tables.fields(coefficients), chunk.n)
