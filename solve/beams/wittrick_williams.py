"""Every frequency of a structure whose stiffness depends on frequency (Wittrick and Williams; thesis 5.3).

J(ω) = J0(ω) + s{D(ω)}, the number of frequencies below ω, is what its elements have below ω with their
ends clamped, and the number of negative eigenvalues of D. The r-th frequency is therefore where the
eigenvalue of number r − J0 passes through zero: its sign is the count's, and its size lets a bracketing
method converge fast. Frequencies at which no joint moves are found as the places where J0 jumps.
"""

import numpy as np

from solve.arrays import Array
from solve.beams.eigen import at_rest
from solve.beams.positions import Positions
from solve.errors import StructureError

_DOUBLINGS = 60

PARTS = (2, 3, 5)
"""Into how many parts exact elements are cut, in turn, until none has a pole near a frequency."""

_NEAR = 1e-4
"""Relative distance from a pole of D within which a frequency is better found with divided elements."""


def exact_frequencies(positions: Positions, count: int, rtol: float = 1e-13) -> Array:
    """The lowest `count` frequencies at every position, (m, count) in rad/s, rising, each as often as it
    occurs."""
    m = len(positions.phase)
    everywhere, rest = np.arange(m), np.zeros(m)
    static = positions.dynamic_stiffness(everywhere, rest)
    low = at_rest(positions.dynamic_mass(everywhere, rest), static)
    above = _above(positions, count)
    index, order = (each.ravel() for each in np.meshgrid(everywhere, np.arange(1, count + 1), indexing="ij"))
    moving = np.flatnonzero(order > count_below(positions, everywhere, low)[index])
    index, order = index[moving], order[moving]
    found = _roots(positions, index, order, low[index], above[index], rtol)
    _separate(positions, index, order, found, rtol)
    frequencies = np.zeros(m * count)
    frequencies[moving] = found
    return frequencies.reshape(m, count)


def _separate(positions: Positions, index: Array, order: Array, found: Array, rtol: float) -> None:
    """Find those of the frequencies again that lie near a pole, with elements divided until it is away."""
    near = np.flatnonzero(near_clamped(positions, found))
    for parts in PARTS:
        if len(near) == 0:
            break
        divided = Positions(positions.beams.divided(parts), positions.phase)
        still_near = near_clamped(divided, found[near])
        apart = near[~still_near]
        low, high = (found[apart] * (1 + 10 * sign * _NEAR) for sign in (-1, 1))
        found[apart] = _roots(divided, index[apart], order[apart], low, high, rtol)
        near = near[still_near]


def near_clamped(positions: Positions, omega: Array) -> Array:
    """Whether each frequency (b,) is close to one of an element with its ends clamped, a pole of D: it is
    then better found and drawn with the elements divided (thesis 5.4.1)."""
    above, below = (positions.interior_count(omega * (1 + sign * _NEAR)) for sign in (1, -1))
    return above != below


def _roots(positions: Positions, index: Array, order: Array, low: Array, high: Array, rtol: float) -> Array:
    """The frequencies (b,) of the given orders at positions `index`, each between low and high."""
    from scipy.optimize.elementwise import find_root

    m = len(positions.phase)
    scale = _scale(positions.dynamic_stiffness(np.arange(m), np.zeros(m)))

    def eigenvalue(omega: Array, index: Array, order: Array) -> Array:
        return crossing(positions, scale, omega, index, order)

    tolerances = {"xatol": 0.0, "xrtol": rtol, "fatol": 0.0, "frtol": 0.0}
    found = find_root(eigenvalue, (low, high), args=(index, order), tolerances=tolerances, maxiter=200)
    return np.asarray(found.x)


def count_below(positions: Positions, index: Array, omega: Array) -> Array:
    """J (b,): number of frequencies below ω (b,) at the positions of number `index` (b,)."""
    eigenvalues = np.linalg.eigvalsh(positions.dynamic_stiffness(index, omega))
    return positions.interior_count(omega) + (eigenvalues < 0).sum(axis=1)


def crossing(positions: Positions, scale: Array, omega: Array, index: Array, order: Array) -> Array:
    """For each (b,) a number that falls through zero at the frequency of that order, within −1 … 1.

    scale (m, n) multiplies rows and columns of D, which changes no sign.
    """
    D = positions.dynamic_stiffness(index, omega) * (scale[index, :, None] * scale[index, None, :])
    eigenvalues = np.linalg.eigvalsh(D)
    n = eigenvalues.shape[1]
    place = order - positions.interior_count(omega) - 1
    value = np.where(place < 0, -1.0, 1.0)
    inside = np.flatnonzero((place >= 0) & (place < n))
    chosen = eigenvalues[inside, place[inside]]
    value[inside] = chosen / (1 + np.abs(chosen))
    return value


def _above(positions: Positions, count: int) -> Array:
    """A frequency (m,) at every position that has `count` others below it."""
    everywhere = np.arange(len(positions.phase))
    omega = np.ones(len(everywhere))
    for _ in range(_DOUBLINGS):
        few = count_below(positions, everywhere, omega) < count
        if not few.any():
            return omega
        omega[few] *= 2.0
    raise StructureError(f"fewer than {count} frequencies below {omega.max():.3g} rad/s; ask for fewer")


def _scale(static: Array) -> Array:
    """1/√ of the diagonal of the static stiffness, (m, n): brings displacements and rotations together."""
    diagonal = np.einsum("mii->mi", static)
    return 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
