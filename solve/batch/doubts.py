"""What two grids do not show of many points: modes too fast for both, as the certificate judges them."""

from collections.abc import Callable

import numpy as np

from solve.arrays import Array
from solve.batch.spectra import Spectra
from solve.batch.stiffness import Stiffness
from solve.batch.tables import Chunk
from solve.certificate import surviving
from solve.methods.gauss import Gauss
from solve.methods.radau import Radau

FROZEN_PHASES = 128
"""At which the certificate freezes the coefficients."""

_FEWER, _DOUBT, _FAR = 16, 1.2, 1e-3
"""Every so many-th of the phases serves where even another exponent, and a factor, change nothing."""


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

        A few of the phases tell where that matters clearly or clearly not; all of them tell elsewhere.
        """
        few = stiffness.eigenvalues(_FEWER)
        lost, follows = surviving(few, self.period, limit), np.zeros(len(few), dtype=bool)
        beyond = np.abs(few).max(axis=(1, 2)) * self.period > limit
        matters = beyond & (lost**_DOUBT * _FAR > self.rtol * radius)
        matters_not = lost ** (1 / _DOUBT) < _FAR * self.rtol * radius
        unsure = np.flatnonzero(~(matters | matters_not))
        if len(unsure):
            every = stiffness[unsure].eigenvalues()
            lost[unsure] = surviving(every, self.period, limit)
            follows[unsure] = np.abs(every).max(axis=(1, 2)) * self.period <= limit
        return lost, follows


def frozen(chunk: Chunk, positions: Array, phases: int) -> Stiffness:
    """The coefficients of some points, frozen in the middles of so many parts of the period."""
    phase = (np.arange(phases) + 0.5) * (chunk.period / phases)
    tables, coefficients = chunk.tables(("frozen", phases), phase, positions)
    return Stiffness(tables.fields(coefficients), chunk.n)
