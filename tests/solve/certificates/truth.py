"""What is true of a system, from nothing that is under test."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre

from tests.solve.witnesses import rate_matrices

PHASES = np.linspace(0.0, 2 * np.pi, 1000, endpoint=False) + 1e-3
"""At which orbits are compared."""

_NODES, _TURNED = 20, 1.5
"""Nodes a panel, and the angle that the fastest mode turns in one: the rest of the series is rounding."""

_BLOCKS = 16

OWN_ERROR = 5e-13
"""Error that the truth may have itself: of integrated orbits, as steps half as long show."""


@dataclass(frozen=True)
class Truth:
    """logarithms (2n,) of the multipliers; q (n, k) at `PHASES`; defective: whether a multiplier on the unit
    circle has fewer eigenvectors than it counts."""

    logarithms: np.ndarray
    q: np.ndarray
    defective: bool = False

    @property
    def multipliers(self) -> np.ndarray:
        return np.exp(self.logarithms)

    @property
    def growth(self) -> float:
        """ln max|ρ|."""
        return float(self.logarithms.real.max())


def integrated(system, speed) -> Truth:
    """Panels that follow every mode, each solved as an integral equation of the rates at Gauss's points
    (spectral integration: L. Greengard, SIAM J. Numer. Anal. 28 (1991) 1071-1080)."""
    nodes, weights = legendre.leggauss(_NODES)
    edges = _edges(system, speed)
    h = np.diff(edges)
    inner = edges[:-1, None] + h[:, None] * (nodes + 1) / 2
    P, f = rate_matrices(system, inner.ravel(), speed)
    N = P.shape[-1]
    P, f = P.reshape(len(h), _NODES, N, N), f.reshape(len(h), _NODES, N)
    series = np.linalg.inv(legendre.legvander(nodes, _NODES - 1))
    integral = _integrals(nodes) @ series / 2
    A = -np.einsum("k,ij,kjab->kiajb", h, integral, P)
    A = A.reshape(len(h), _NODES * N, _NODES * N) + np.eye(_NODES * N)
    start = np.broadcast_to(np.tile(np.eye(N), (_NODES, 1)), (len(h), _NODES * N, N))
    load = np.einsum("k,ij,kja->kia", h, integral, f).reshape(len(h), -1, 1)
    X = np.linalg.solve(A, np.concatenate((start, load), axis=-1)).reshape(len(h), _NODES, N, N + 1)
    rate = P @ X
    rate[..., -1] += f
    change = np.einsum("k,i,kiab->kab", h, weights / 2, rate)
    maps = change + np.eye(N, N + 1)
    starts = _closed(maps)
    at = np.clip(np.searchsorted(edges, PHASES % (2 * np.pi), side="right") - 1, 0, len(h) - 1)
    place = 2 * (PHASES % (2 * np.pi) - edges[at]) / h[at] - 1
    slopes = np.einsum("kiab,kb->kia", rate, np.pad(starts, ((0, 0), (0, 1)), constant_values=1.0))
    parts = np.einsum("pj,ji,pia->pa", _integrals(place), series, slopes[at])
    q = (starts[at] + h[at, None] / 2 * parts)[:, : N // 2]
    Phi = np.eye(N)
    for each in maps:
        Phi = each[:, :-1] @ Phi
    return Truth(np.log(np.linalg.eigvals(Phi).astype(complex)), q.T)


def _edges(system, speed):
    ends = np.unique(np.concatenate(([0.0, 2 * np.pi], np.remainder(system.breaks, 2 * np.pi))))
    edges = [ends[:1]]
    for left, right in pairwise(ends):
        phases = left + (right - left) * (np.arange(64) + 0.5) / 64
        fastest = np.abs(np.linalg.eigvals(rate_matrices(system, phases, speed)[0])).max()
        least = 24 if right - left > 1.0 else 4
        count = max(least, int(np.ceil(1.2 * fastest * (right - left) / _TURNED)))
        edges.append(np.linspace(left, right, count + 1)[1:])
    return np.concatenate(edges)


def _integrals(x):
    """Integrals (…, j) from -1 to x of Legendre's polynomials of degrees 0, 1, …"""
    values = legendre.legvander(x, _NODES)
    degree = np.arange(1, _NODES)
    return np.concatenate(
        ((x + 1)[..., None], (values[..., 2:] - values[..., :-2]) / (2 * degree + 1)), axis=-1
    )


def _closed(maps):
    """States (m, N) at the starts of a closed chain of maps (m, N, N+1): blocks of it in one linear system,
    so that growth over the period costs no digits."""
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
