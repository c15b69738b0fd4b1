"""One period as a chain of affine maps: x at node k+1 = A_k x_k + b_k (chapter Eqs. (17), (38)).

The maps of neighbouring steps are multiplied pairwise, level by level, with one array operation a
level: a tree of about 2 m products instead of a loop over m steps. At most `BLOCKS` blocks are left;
their cyclic system is solved by structured orthogonal factorisation (S. J. Wright, SIAM J. Sci. Stat.
Comput. 13 (1992) 742-764), which keeps the digits that single shooting, chapter Eqs. (21), (40),
loses where a solution of the homogeneous system grows over the period.
"""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import ResonanceError

BLOCKS = 32
"""Number of blocks at which products stop and the orthogonal factorisation takes over."""

_SINGULAR = 1e-14
"""Reciprocal condition number of the closed cyclic system below which it counts as singular."""


@dataclass(frozen=True)
class Steps:
    """Affine maps of the steps of one period: A (m, N, N), b (m, N)."""

    A: Array
    b: Array


def monodromy(steps: Steps) -> Array:
    """Φ(T) = A_m … A_1 (N, N), chapter Eq. (8)."""
    A = steps.A
    while len(A) > 1:
        A = _halved_products(A)
    return A[0]


def affine_period(steps: Steps) -> Steps:
    """The map of the whole period, as one step."""
    while len(steps.b) > 1:
        steps = _halved(steps)
    return steps


def states_from(steps: Steps, start: Array) -> Array:
    """States x (m+1, N) at the nodes from the state at the first."""
    levels = [steps]
    while len(levels[-1].b) > 1:
        levels.append(_halved(levels[-1]))
    x = start[None]
    for level in reversed(levels[:-1]):
        x = _refined(level, x)
    end = steps.A[-1] @ x[-1] + steps.b[-1]
    return np.concatenate((x, end[None]))


def periodic_states(steps: Steps) -> tuple[Array, float]:
    """States x (m+1, N) of the periodic solution at the nodes, and the condition of the closed system.

    Raises ResonanceError where the closed system is singular: a multiplier at +1.
    """
    levels = [steps]
    while len(levels[-1].b) > BLOCKS:
        levels.append(_halved(levels[-1]))
    x, condition = _cyclic(levels[-1])
    for level in reversed(levels[:-1]):
        x = _refined(level, x)
    return np.concatenate((x, x[:1])), condition


def _halved_products(A: Array) -> Array:
    product = A[1::2] @ A[0 : len(A) - 1 : 2]
    return product if len(A) % 2 == 0 else np.concatenate((product, A[-1:]))


def _halved(steps: Steps) -> Steps:
    """Maps over pairs of steps; an odd last step stays as it is."""
    A, b = steps.A, steps.b
    pairs = len(b) // 2 * 2
    joined = np.squeeze(A[1:pairs:2] @ b[0:pairs:2, :, None], -1) + b[1:pairs:2]
    return Steps(_halved_products(A), joined if pairs == len(b) else np.concatenate((joined, b[-1:])))


def _refined(level: Steps, starts: Array) -> Array:
    """States at the start of every step of the level, from those at the start of every pair."""
    x = np.empty_like(level.b)
    x[0::2] = starts
    inner = len(level.b) // 2
    first = slice(0, 2 * inner, 2)
    x[1::2] = np.squeeze(level.A[first] @ starts[:inner, :, None], -1) + level.b[first]
    return x


def _cyclic(blocks: Steps) -> tuple[Array, float]:
    """Starts x (B, N) of the blocks of a closed chain x_{k+1} = A_k x_k + b_k, x_B = x_0.

    Each row G x_k + H x_{k+1} = r is joined with the next by an orthogonal elimination of the state
    between them, until one row G x_0 + H x_B = r is left.
    """
    N = blocks.b.shape[1]
    G, H, r = blocks.A, np.broadcast_to(-np.eye(N), blocks.A.shape), -blocks.b
    eliminated = []
    while len(r) > 1:
        pairs = len(r) // 2 * 2
        Q, R = np.linalg.qr(np.concatenate((H[0:pairs:2], G[1:pairs:2]), axis=1), mode="complete")
        upper, lower = np.swapaxes(Q[:, :N], 1, 2), np.swapaxes(Q[:, N:], 1, 2)
        g, h = upper @ G[0:pairs:2], lower @ H[1:pairs:2]
        s = np.squeeze(upper @ r[0:pairs:2, :, None] + lower @ r[1:pairs:2, :, None], -1)
        eliminated.append((R[:, :N], g[:, :N], h[:, :N], s[:, :N], len(r)))
        G, H, r = (np.concatenate((new[:, N:], old[pairs:])) for new, old in ((g, G), (h, H), (s, r)))
    closed = G[0] + H[0]
    singular_values = np.linalg.svd(closed, compute_uv=False)
    scale = np.linalg.norm(np.concatenate((G[0], H[0])), 2)
    if not singular_values[-1] > _SINGULAR * scale:
        raise ResonanceError(
            "I - Φ is singular: a Floquet multiplier is at +1, so that the forced motion grows without "
            "bound or is not unique; change the speed or add damping"
        )
    x = np.linalg.solve(closed, r[0])[None]
    for R, g, h, s, count in reversed(eliminated):
        ends = np.roll(x, -1, axis=0)
        inner = len(s)
        right = s - np.squeeze(g @ x[:inner, :, None] + h @ ends[:inner, :, None], -1)
        finer = np.empty((count, N))
        finer[0::2] = x
        finer[1::2] = np.squeeze(np.linalg.solve(R, right[..., None]), -1)
        x = finer
    return x, float(scale / singular_values[-1])
