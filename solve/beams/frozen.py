"""Frequencies and modes of a structure of beams that is held at its positions.

Finite elements have those of M q̈ + K q = 0 (thesis (4.40)). With exact elements the stiffness depends on
frequency (Wittrick and Williams; thesis 5.3): J(ω) = J0(ω) + s{D(ω)}, the number of frequencies below ω, is
what the elements have below ω with their ends clamped, and the number of negative eigenvalues of D. The
r-th frequency is therefore where the eigenvalue of number r − J0 passes through zero: its sign is the
count's, and its size lets a bracketing method converge fast. Frequencies at which no joint moves are
the places where J0 jumps.
"""

import numpy as np

from solve.arrays import Array
from solve.beams.assembly import Beams, Positions
from solve.contracts import ModeShape
from solve.errors import StructureError
from solve.model.modes import at_rest, lowest_frequencies, modes


def lowest(positions: Positions, count: int) -> Array:
    """The lowest `count` frequencies at every position, (m, count) in rad/s, rising."""
    if positions.beams.exact_links:
        return exact_frequencies(positions, count)
    return lowest_frequencies(*positions.matrices(), count)


_DOUBLINGS = 60

PARTS = (2, 3, 5)
"""Into how many parts exact elements are cut, in turn, until none has a pole near a frequency."""

_NEAR = 1e-4
"""Relative distance from a pole of D within which a frequency is better found with divided elements."""


def exact_frequencies(positions: Positions, count: int) -> Array:
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
    omega = _roots(positions, index, order, low[index], above[index])
    _separate(positions, index, order, omega)
    frequencies = np.zeros(m * count)
    frequencies[moving] = omega
    return frequencies.reshape(m, count)


def _separate(positions: Positions, index: Array, order: Array, omega: Array) -> None:
    """Find those of the frequencies again that lie near a pole, with elements divided until it is away."""
    near = np.flatnonzero(near_clamped(positions, omega))
    for parts in PARTS:
        if len(near) == 0:
            break
        divided = Positions(positions.beams.divided(parts), positions.phase)
        still_near = near_clamped(divided, omega[near])
        apart = near[~still_near]
        low, high = (omega[apart] * (1 + 10 * sign * _NEAR) for sign in (-1, 1))
        omega[apart] = _roots(divided, index[apart], order[apart], low, high)
        near = near[still_near]


def near_clamped(positions: Positions, omega: Array) -> Array:
    """Whether each frequency (b,) is close to one of an element with its ends clamped, a pole of D: it is
    then better found and drawn with the elements divided (thesis 5.4.1)."""
    above, below = (positions.interior_count(omega * (1 + sign * _NEAR)) for sign in (1, -1))
    return above != below


def _roots(positions: Positions, index: Array, order: Array, low: Array, high: Array) -> Array:
    """The frequencies (b,) of the given orders at positions `index`, each between low and high."""
    from scipy.optimize.elementwise import find_root

    m = len(positions.phase)
    diagonal = np.einsum("mii->mi", positions.dynamic_stiffness(np.arange(m), np.zeros(m)))
    # Displacements and rotations are brought together, which changes no sign.
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))

    def crossing(omega: Array, index: Array, order: Array) -> Array:
        """For each (b,) a number that falls through zero at the frequency of that order, within −1 … 1."""
        D = positions.dynamic_stiffness(index, omega) * (scale[index, :, None] * scale[index, None, :])
        eigenvalues = np.linalg.eigvalsh(D)
        place = order - positions.interior_count(omega) - 1
        value = np.where(place < 0, -1.0, 1.0)
        inside = np.flatnonzero((place >= 0) & (place < eigenvalues.shape[1]))
        chosen = eigenvalues[inside, place[inside]]
        value[inside] = chosen / (1 + np.abs(chosen))
        return value

    tolerances = {"xatol": 0.0, "xrtol": 1e-13, "fatol": 0.0, "frtol": 0.0}
    root = find_root(crossing, (low, high), args=(index, order), tolerances=tolerances, maxiter=200)
    return np.asarray(root.x)


def count_below(positions: Positions, index: Array, omega: Array) -> Array:
    """J (b,): number of frequencies below ω (b,) at the positions of number `index` (b,)."""
    eigenvalues = np.linalg.eigvalsh(positions.dynamic_stiffness(index, omega))
    return positions.interior_count(omega) + (eigenvalues < 0).sum(axis=1)


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


_POINTS = 48
"""Points along a link, at least."""

_SAME = 1e-9
"""Relative difference of frequencies that count as one that occurs several times."""


def shapes(beams: Beams, phase: float, frequencies: Array) -> list[ModeShape]:
    """The modes of the lowest frequencies (count,) of the beams at a phase."""
    if not beams.exact_links:
        positions = Positions(beams, np.array([phase]))
        vectors = positions.expanded(modes(*positions.matrices()).vectors)[0, :, : len(frequencies)]
        each = [(positions, vector, 1.0) for vector in vectors.T]
    else:
        each = [_exact_mode(beams, phase, frequencies, number) for number in range(len(frequencies))]
    return [shape(*mode, float(omega)) for mode, omega in zip(each, frequencies, strict=True)]


def _exact_mode(
    beams: Beams, phase: float, frequencies: Array, number: int
) -> tuple[Positions, Array, float]:
    """Positions, vector (N,) and modal mass of one of the modes.

    The links are divided so that none of the elements vibrates with clamped ends at this frequency:
    then every mode moves a node (thesis 5.4.1), and D has no pole.
    """
    # All of a repeated frequency are taken at its first copy: another rounding reorders the modes.
    own = max(float(frequencies[number]), np.finfo(float).tiny)
    before = np.count_nonzero(np.abs(frequencies[:number] / own - 1) < _SAME)
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
    chosen = np.argsort(np.abs(values), kind="stable")[before]
    vector = scale * vectors[:, chosen]
    return positions, positions.expanded(vector[None, :, None])[0, :, 0], float(vector @ M @ vector)


def shape(positions: Positions, vector: Array, mass: float, omega: float) -> ModeShape:
    curves = [_curve(positions, number, vector, omega) for number in range(len(positions.beams.members))]
    largest = max(np.linalg.norm(displacement, axis=1).max() for _, displacement, _ in curves)
    places, displacements, transverse = zip(*curves, strict=True)
    return ModeShape(
        omega,
        mass / largest**2,
        places,
        tuple(each / largest for each in displacements),
        tuple(each / largest for each in transverse),
    )


def _curve(positions: Positions, number: int, vector: Array, omega: float) -> tuple[Array, Array, Array]:
    """Places, displacements and their transverse part along a link."""
    member = positions.beams.members[number]
    xi = np.linspace(0.0, 1.0, 1 + -(-_POINTS // member.count))
    values = member.local(positions.angle, vector[:, None])[0]
    u, v = (np.concatenate([shapes @ each for each in values]) for shapes in member.shapes(xi, 0, omega))
    along = np.concatenate([member.L * (first + xi) for first in range(member.count)])
    direction = np.exp(1j * positions.angle[0, number])
    places, moved = positions.joints[0, member.start] + along * direction, (u + 1j * v) * direction
    return np.column_stack((places.real, places.imag)), np.column_stack((moved.real, moved.imag)), v
