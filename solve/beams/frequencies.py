"""Natural frequencies and modes of a beam structure at fixed positions.

With finite elements, these are the frequencies of M q̈ + K q = 0 (thesis, Eq. (4.40)). With exact elements,
the stiffness depends on the frequency (Wittrick and Williams; section 5.3 of the thesis). The number of
frequencies below ω is J(ω) = J0(ω) + s{D(ω)}, where J0 is the number of frequencies below ω of the elements
with clamped ends, and s is the number of negative eigenvalues of D. At the r-th frequency, eigenvalue number
r − J0 of D is therefore zero. A bracketing method finds this zero quickly. J0 jumps at frequencies at which
no joint moves."""

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import ROUNDING, Beams, Positions
from solve.contracts import ModeShape
from solve.errors import StructureError
from solve.model.modes import lowest_frequencies, modes, roundoff_frequency


def lowest(positions: Positions, count: int) -> Array:
    """Lowest `count` frequencies (m, count) in rad/s at m positions, in ascending order."""
    if positions.beams.exact_links:
        return exact_frequencies(positions, count)
    return lowest_frequencies(*positions.matrices(), count)


_DOUBLINGS = 60
"""Largest number of doublings of 1 rad/s in the search for an upper bound, which reaches 1e18 rad/s."""

PARTS = (2, 3, 5)
"""Numbers of parts into which exact elements are divided. They are tried in this order, until no pole is near
a frequency."""

_NEAR = 1e-4
"""Relative distance between a frequency and a pole of D below which elements are divided. Chosen by
judgement."""


def exact_frequencies(positions: Positions, count: int) -> Array:
    """Lowest `count` frequencies (m, count) in rad/s at m positions, in ascending order. Multiple frequencies
    are repeated."""
    m = len(positions.phase)
    all_positions, zero = np.arange(m), np.zeros(m)
    static = positions.dynamic_stiffness(all_positions, zero)
    low = roundoff_frequency(positions.dynamic_mass(all_positions, zero), static)
    high = _upper_bound(positions, count)
    grids = np.meshgrid(all_positions, np.arange(1, count + 1), indexing="ij")
    index, order = (grid.ravel() for grid in grids)
    elastic = np.flatnonzero(order > count_below(positions, all_positions, low)[index])
    index, order = index[elastic], order[elastic]
    omega = _roots(positions, index, order, low[index], high[index])
    _refine_near_poles(positions, index, order, omega)
    frequencies = np.zeros(m * count)
    frequencies[elastic] = omega
    return frequencies.reshape(m, count)


def _refine_near_poles(positions: Positions, index: Array, order: Array, omega: Array) -> None:
    """Recompute, in place, the frequencies near a pole. For this, elements are divided until no pole is
    near."""
    near = np.flatnonzero(near_clamped(positions, omega))
    for parts in PARTS:
        if len(near) == 0:
            break
        divided = Positions(positions.beams.divided(parts), positions.phase)
        still_near = near_clamped(divided, omega[near])
        distant = near[~still_near]
        low, high = (omega[distant] * (1 + 10 * sign * _NEAR) for sign in (-1, 1))
        omega[distant] = _roots(divided, index[distant], order[distant], low, high)
        near = near[still_near]


def near_clamped(positions: Positions, omega: Array) -> Array:
    """Return a mask (b,) of the frequencies that are close to a pole of D, that is, to a frequency of an
    element with clamped ends.

    Such frequencies and modes require divided elements (section 5.4.1 of the thesis)."""
    above, below = (positions.interior_count(omega * (1 + sign * _NEAR)) for sign in (1, -1))
    return above != below


def _roots(positions: Positions, index: Array, order: Array, low: Array, high: Array) -> Array:
    """Frequencies (b,) with the ordinal numbers `order` (b,) at the positions with indices `index` (b,).
    `low` and `high` (b,) bracket them."""
    from scipy.optimize.elementwise import find_root

    m = len(positions.phase)
    diagonal = np.einsum("mii->mi", positions.dynamic_stiffness(np.arange(m), np.zeros(m)))
    # The signs of the eigenvalues do not change if displacements and rotations are scaled to similar sizes.
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))

    def crossing(omega: Array, index: Array, order: Array) -> Array:
        """Function (b,) with values in −1 … 1 that changes from positive to negative at the frequency with
        the ordinal number `order`."""
        D = positions.dynamic_stiffness(index, omega) * (scale[index, :, None] * scale[index, None, :])
        eigenvalues = np.linalg.eigvalsh(D)
        number = order - positions.interior_count(omega) - 1
        value = np.where(number < 0, -1.0, 1.0)
        valid = np.flatnonzero((number >= 0) & (number < eigenvalues.shape[1]))
        selected = eigenvalues[valid, number[valid]]
        value[valid] = selected / (1 + np.abs(selected))
        return value

    tolerances = {"xatol": 0.0, "xrtol": 1e-13, "fatol": 0.0, "frtol": 0.0}
    root = find_root(crossing, (low, high), args=(index, order), tolerances=tolerances, maxiter=200)
    return np.asarray(root.x)


def count_below(positions: Positions, index: Array, omega: Array) -> Array:
    """Number J (b,) of frequencies below ω (b,) at the positions with indices `index` (b,)."""
    eigenvalues = np.linalg.eigvalsh(positions.dynamic_stiffness(index, omega))
    return positions.interior_count(omega) + (eigenvalues < 0).sum(axis=1)


def _upper_bound(positions: Positions, count: int) -> Array:
    """Upper bounds (m,) on the lowest `count` frequencies at m positions."""
    all_positions = np.arange(len(positions.phase))
    omega = np.ones(len(all_positions))
    for _ in range(_DOUBLINGS):
        few = count_below(positions, all_positions, omega) < count
        if not few.any():
            return omega
        omega[few] *= 2.0
    raise StructureError(
        f"fewer than {count} frequencies lie below {omega.max():.3g} rad/s; request fewer frequencies"
    )


_POINTS = 48
"""Minimum number of intervals between plotted points along a link. Chosen by judgement."""


def shapes(beams: Beams, phase: float, frequencies: Array) -> list[ModeShape]:
    """Mode shapes of the beams at a phase. `frequencies` (count,) contains the lowest natural frequencies."""
    if not beams.exact_links:
        positions = Positions(beams, np.array([phase]))
        vectors = positions.expanded(modes(*positions.matrices()).vectors)[0, :, : len(frequencies)]
        found_modes = [(positions, vector, 1.0) for vector in vectors.T]
    else:
        found_modes = [_exact_mode(beams, phase, frequencies, number) for number in range(len(frequencies))]
    return [shape(*mode, float(omega)) for mode, omega in zip(found_modes, frequencies, strict=True)]


def _exact_mode(
    beams: Beams, phase: float, frequencies: Array, number: int
) -> tuple[Positions, Array, float]:
    """Return the `Positions` of the divided links, and the vector (N,) and the modal mass of a mode.

    The links are divided so that no element with clamped ends has the natural frequency of the mode. Then
    every mode moves a node (section 5.4.1 of the thesis), and D has no pole."""
    # All modes of a multiple frequency are computed at its first value. At values with different round-off,
    # their order could change.
    frequency = max(float(frequencies[number]), np.finfo(float).tiny)
    before = np.count_nonzero(np.abs(frequencies[:number] / frequency - 1) < ROUNDING)
    omega = frequencies[number - before : number - before + 1]
    positions = Positions(beams, np.array([phase]))
    for parts in PARTS:
        if not near_clamped(positions, omega)[0]:
            break
        positions = Positions(beams.divided(parts), np.array([phase]))
    index = np.zeros(1, dtype=int)
    D, M = positions.dynamic_stiffness(index, omega)[0], positions.dynamic_mass(index, omega)[0]
    scale = 1 / np.sqrt(np.diag(M))
    values, vectors = np.linalg.eigh(D * np.outer(scale, scale))
    selected = np.argsort(np.abs(values), kind="stable")[before]
    vector = scale * vectors[:, selected]
    return positions, positions.expanded(vector[None, :, None])[0, :, 0], float(vector @ M @ vector)


def shape(positions: Positions, vector: Array, mass: float, omega: float) -> ModeShape:
    """Mode shape from a vector (N,) of all degrees of freedom, with its modal mass and frequency."""
    curves = [_curve(positions, number, vector, omega) for number in range(len(positions.beams.members))]
    largest = max(np.linalg.norm(displacement, axis=1).max() for _, displacement, _ in curves)
    points, displacements, transverse = zip(*curves, strict=True)
    return ModeShape(
        omega,
        mass / largest**2,
        points,
        tuple(displacement / largest for displacement in displacements),
        tuple(across / largest for across in transverse),
    )


def _curve(positions: Positions, number: int, vector: Array, omega: float) -> tuple[Array, Array, Array]:
    """Return the points of a link, their displacements, and their transverse displacements."""
    member = positions.beams.members[number]
    xi = np.linspace(0.0, 1.0, 1 + -(-_POINTS // member.count))
    values = member.local(positions.angle, vector[:, None])[0]
    u, v = (
        np.concatenate([shapes @ element for element in values]) for shapes in member.shapes(xi, 0, omega)
    )
    along = np.concatenate([member.L * (first + xi) for first in range(member.count)])
    direction = np.exp(1j * positions.angle[0, number])
    points, moved = positions.joints[0, member.start] + along * direction, (u + 1j * v) * direction
    return np.column_stack((points.real, points.imag)), np.column_stack((moved.real, moved.imag)), v
