"""Every frequency of a structure whose stiffness depends on frequency (Wittrick and Williams; thesis 5.3).

J(ω) = J0(ω) + s{D(ω)}, the number of frequencies below ω, is what its elements have below ω with their
ends clamped, and the number of negative eigenvalues of D. The r-th frequency is therefore where the
eigenvalue of number r − J0 passes through zero: its sign is the count's, and its size lets a bracketing
method converge fast. Frequencies at which no joint moves are found as the places where J0 jumps.
"""

import numpy as np

from solve.arrays import Array
from solve.errors import StructureError
from solve.structure.positions import Positions

_DOUBLINGS = 60


def exact_frequencies(positions: Positions, count: int, rtol: float = 1e-13) -> Array:
    """The lowest `count` frequencies at every position, (m, count) in rad/s, rising, each as often as it
    occurs."""
    from scipy.optimize.elementwise import find_root

    index, order = (
        each.ravel()
        for each in np.meshgrid(np.arange(len(positions.phase)), np.arange(1, count + 1), indexing="ij")
    )
    above = _above(positions, count)
    scale = _scale(positions)

    def eigenvalue(omega: Array, index: Array, order: Array) -> Array:
        return crossing(positions, scale, omega, index, order)

    found = find_root(
        eigenvalue,
        (np.zeros(len(index)), above[index]),
        args=(index, order),
        tolerances={"xatol": 0.0, "xrtol": rtol, "fatol": 0.0, "frtol": 0.0},
        maxiter=200,
    )
    return found.x.reshape(len(positions.phase), count)


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
    place = order - positions.interior_count(omega) - 1
    n = eigenvalues.shape[1]
    value = np.take_along_axis(eigenvalues, np.clip(place, 0, n - 1)[:, None], axis=1)[:, 0]
    bounded = value / (1 + np.abs(value))
    return np.where(place < 0, -1.0, np.where(place >= n, 1.0, bounded))


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


def _scale(positions: Positions) -> Array:
    """1/√ of the diagonal of the static stiffness, (m, n): brings displacements and rotations together."""
    everywhere = np.arange(len(positions.phase))
    static = positions.dynamic_stiffness(everywhere, np.zeros(len(everywhere)))
    diagonal = np.einsum("mii->mi", static)
    return 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
