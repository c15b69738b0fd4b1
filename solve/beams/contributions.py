"""What each mode of a moving structure of beams gives to a deflection or stress (thesis Fig. 6.4)."""

from dataclasses import dataclass, replace

import numpy as np

from solve.arrays import Array
from solve.beams.eigen import Modes, modes
from solve.beams.quantities import quantity
from solve.beams.state import State

LINEAR = ("deflection", "stress_plus", "stress_minus")
"""Kinds of outputs that are sums of what the modes give."""

_NEIGHBOURS = 4
"""Modes above those wanted that may take their place along the turn."""


@dataclass(frozen=True)
class Contributions:
    """Of the lowest modes, each followed along the turn, to an output: values (modes, k) and frequencies
    (modes, k) in rad/s at phases (k,); total (k,): of all modes together."""

    output: str
    phase: Array
    values: Array
    frequencies: Array
    total: Array


def contributions(
    state: State, output: str, kind: str, number: int, place: float, count: int
) -> Contributions:
    """q = Σ φ_i η_i with the modes φ_i of each position, η = Φᵀ M q; phases rise in small steps."""
    M, K = state.positions.matrices()
    found = followed(M, K, count)
    eta = np.einsum("kni,knm,mk->ik", found.vectors, M, state.q, optimize=True)
    parts = np.einsum("kni,ik->ink", found.vectors, eta)
    values = [quantity(replace(state, q=part), kind, number, place) for part in parts]
    total = quantity(state, kind, number, place)
    return Contributions(output, state.phase, np.array(values), found.frequencies.T, total)


def followed(M: Array, K: Array, count: int) -> Modes:
    """The lowest modes at the first of the positions (k, n, n), each followed to the others: the mode of the
    next position that is most like it (modal assurance criterion) continues it, with its sign."""
    from scipy.optimize import linear_sum_assignment

    pool = min(count + _NEIGHBOURS, M.shape[1])
    frequencies, vectors = (part[..., :pool].copy() for part in modes(M, K))
    for k in range(1, len(M)):
        likeness = vectors[k - 1].T @ M[k] @ vectors[k]
        _, order = linear_sum_assignment(-(likeness**2))
        sign = np.where(likeness[np.arange(pool), order] < 0, -1.0, 1.0)
        frequencies[k], vectors[k] = frequencies[k, order], vectors[k][:, order] * sign
    return Modes(frequencies[:, :count], vectors[:, :, :count])
