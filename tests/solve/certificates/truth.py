"""Reference solutions that use no code under test."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from tests.solve.references import rate_matrices

PHASES = np.linspace(0.0, 2 * np.pi, 1000, endpoint=False) + 1e-3
"""Phases at which orbits are compared."""

_NODES, _TURNED = 20, 1.5
"""Nodes per panel, and phase advance of the fastest mode per panel. The remainder of the series is below
round-off."""

_ENTRIES = 2**23
"""Number of matrix entries of the panels that are solved at a time."""

_BLOCKS = 16

OWN_ERROR = 5e-13
"""Error of an integrated reference, measured by halving the panels."""


@dataclass(frozen=True)
class Truth:
    """Reference solution. `logarithms` (2n,) are those of the multipliers, and `q` (n, k) is the orbit at
    `PHASES`. `defective` states whether a multiplier on the unit circle has fewer eigenvectors than its
    multiplicity."""

    logarithms: np.ndarray
    q: np.ndarray
    defective: bool = False

    @property
    def multipliers(self) -> np.ndarray:
        return np.exp(self.logarithms)

    @property
    def growth(self) -> float:
        """Return ln max|ρ|."""
        return float(self.logarithms.real.max())


def integrated(system, speed, edges=(), longest=np.inf, nodes=_NODES, scales=None) -> Truth:
    """Solve on panels that resolve every mode. On each panel, an integral equation for the rates is
    collocated at Gauss points (spectral integration: L. Greengard, SIAM J. Numer. Anal. 28 (1991) 1071-1080).

    `edges` are further phases at which panels end, and `longest` is the largest panel length; both resolve
    features of the matrices between sampled phases. `nodes` is the number of nodes per panel. `scales` (2n,)
    are the magnitudes of the states q and q′ to which round-off is relative.
    """
    edges = panel_edges(system, speed, edges, longest)
    h, N = np.diff(edges), 2 * system.n
    scales = np.ones(N) if scales is None else np.asarray(scales)
    size = max(1, _ENTRIES // (nodes * N) ** 2)
    batches = [_panels(system, speed, edges[k : k + size + 1], nodes, scales) for k in range(0, len(h), size)]
    rate, maps = (np.concatenate(each) for each in zip(*batches, strict=True))
    starts = _closed(maps)
    at = np.clip(np.searchsorted(edges, PHASES % (2 * np.pi), side="right") - 1, 0, len(h) - 1)
    place = 2 * (PHASES % (2 * np.pi) - edges[at]) / h[at] - 1
    slopes = np.einsum("kiab,kb->kia", rate, np.pad(starts, ((0, 0), (0, 1)), constant_values=1.0))
    parts = np.einsum("pj,ji,pia->pa", _integrals(place, nodes), _series(nodes), slopes[at])
    q = (scales * (starts[at] + h[at, None] / 2 * parts))[:, : N // 2]
    Phi = np.eye(N)
    for each in maps:
        Phi = each[:, :-1] @ Phi
    with np.errstate(divide="ignore"):
        # Modes that die within the turn may leave multipliers that are exactly 0.
        return Truth(np.log(np.linalg.eigvals(Phi).astype(complex)), q.T)


def _panels(system, speed, edges, nodes, scales):
    """Return rates (m, nodes, N, N+1) of the fundamental matrix and the forced state at the Gauss points of
    the panels between `edges` (m+1,), and the maps (m, N, N+1) across the panels."""
    points, weights = legendre.leggauss(nodes)
    h = np.diff(edges)
    inner = edges[:-1, None] + h[:, None] * (points + 1) / 2
    P, f = rate_matrices(system, inner.ravel(), speed)
    N = P.shape[-1]
    P, f = P * scales / scales[:, None], f / scales
    P, f = P.reshape(len(h), nodes, N, N), f.reshape(len(h), nodes, N)
    integral = _integrals(points, nodes) @ _series(nodes) / 2
    A = -np.einsum("k,ij,kjab->kiajb", h, integral, P)
    A = A.reshape(len(h), nodes * N, nodes * N) + np.eye(nodes * N)
    start = np.broadcast_to(np.tile(np.eye(N), (nodes, 1)), (len(h), nodes * N, N))
    load = np.einsum("k,ij,kja->kia", h, integral, f).reshape(len(h), -1, 1)
    X = np.linalg.solve(A, np.concatenate((start, load), axis=-1)).reshape(len(h), nodes, N, N + 1)
    rate = P @ X
    rate[..., -1] += f
    change = np.einsum("k,i,kiab->kab", h, weights / 2, rate)
    return rate, change + np.eye(N, N + 1)


def panel_edges(system, speed, further=(), longest=np.inf):
    """Return the phases (m+1,) from 0 to 2π at which panels end."""
    ends = np.unique(np.concatenate(([0.0, 2 * np.pi], np.remainder(system.breaks, 2 * np.pi))))
    edges = [ends[:1], np.remainder(further, 2 * np.pi)]
    for left, right in pairwise(ends):
        phases = left + (right - left) * (np.arange(64) + 0.5) / 64
        fastest = np.abs(np.linalg.eigvals(rate_matrices(system, phases, speed)[0])).max()
        least = 24 if right - left > 1.0 else 4
        shortest = min(_TURNED / (1.2 * fastest), longest) if fastest > 0 else longest
        count = max(least, int(np.ceil((right - left) / shortest)))
        edges.append(np.linspace(left, right, count + 1)[1:])
    return np.unique(np.concatenate(edges))


def _series(nodes):
    """Return the matrix that converts values at Gauss points into Legendre coefficients."""
    return np.linalg.inv(legendre.legvander(legendre.leggauss(nodes)[0], nodes - 1))


def _integrals(x, nodes):
    """Return the integrals (…, j) from -1 to x of the Legendre polynomials of degrees 0, 1, …"""
    values = legendre.legvander(x, nodes)
    degree = np.arange(1, nodes)
    return np.concatenate(
        ((x + 1)[..., None], (values[..., 2:] - values[..., :-2]) / (2 * degree + 1)), axis=-1
    )


def _closed(maps):
    """Return the states (m, N) at the starts of a closed chain of maps (m, N, N+1). Blocks of the chain form
    one linear system, so that growth over the period loses no digits."""
    m, N = len(maps), maps.shape[1]
    ends = np.unique(np.linspace(0, m, min(m, _BLOCKS) + 1).astype(int))
    count = len(ends) - 1
    system, load = np.eye(count * N), np.zeros(count * N)
    for k, (first, last) in enumerate(pairwise(ends)):
        block = np.eye(N, N + 1)
        for each in maps[first:last]:
            block = each[:, :-1] @ block + np.pad(each[:, -1:], ((0, 0), (N, 0)))
        rows, after = slice(k * N, (k + 1) * N), (k + 1) % count
        system[after * N : (after + 1) * N, rows] -= block[:, :-1]
        load[after * N : (after + 1) * N] = block[:, -1]
    blocks = np.linalg.solve(system, load).reshape(count, N)
    starts = np.empty((m, N))
    for k, (first, last) in enumerate(pairwise(ends)):
        x = blocks[k]
        for at in range(first, last):
            starts[at] = x
            x = maps[at, :, :-1] @ x + maps[at, :, -1]
    return starts
