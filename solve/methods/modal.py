"""Approximation by modal decoupling with the modes at each position (A. Midha, A. G. Erdman, D. A. Frohrib,
J. Mech. Des. 101 (1979) 154-162; section 6.3 of the thesis)."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array, solved
from solve.errors import MatricesError, SolveError
from solve.methods.hsu import Hsu
from solve.methods.method import Discretisation, OneStep
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.period_map import Steps
from solve.period.points import Points, Tables, matrices


@dataclass(frozen=True)
class Modal(OneStep):
    """Modal decoupling: each step uses the modes at its middle, normalised to unit modal masses.

    Damping between modes is neglected. From one step to the next, each modal coordinate continues as if the
    modes were constant."""

    name = "modal"
    order = 0
    curve_order = 0
    converges = False
    symmetric = True

    def discretise(self, points: Points, grid: Grid) -> Discretisation:
        n = points.n
        middles = grid.stages(np.array([0.5]))[:, 0]
        uncoupled = _Uncoupled(points, middles)
        modal = Hsu().discretise(uncoupled, grid)
        to_modal, to_physical = uncoupled.state_bases

        def curve(x: Array) -> Curve:
            from scipy.interpolate import make_interp_spline

            eta = (x[:, :-1] + x[:, 1:]) @ np.swapaxes(to_modal, 1, 2)[..., :n] / 2
            q = np.moveaxis(np.nan_to_num(np.squeeze(uncoupled.modes @ eta[..., None], -1)), 1, 0)
            closed = np.concatenate((middles, middles[:1] + grid.period))
            spline = make_interp_spline(closed, np.concatenate((q, q[:1])), k=5, bc_type="periodic")
            nodes = np.mod(grid.nodes - middles[0], grid.period) + middles[0]
            values, rates, second = (np.moveaxis(spline(nodes, nu=order), 0, 1) for order in range(3))
            return Curve.quintic(grid.nodes, values, rates, second[:, :-1], second[:, 1:])

        # The states must be in physical coordinates, because rigid-body modes are removed from them.
        A = to_physical[:, None] @ modal.steps.A @ to_modal[:, None]
        b = np.squeeze(to_physical[:, None] @ modal.steps.b[..., None], -1)
        return Discretisation(Steps(A, b), curve)

    def _no_map(self, point: Points, grid: Grid) -> SolveError:
        if _Uncoupled(point, grid.stages(np.array([0.5]))[:, 0]).complex[0]:
            return MatricesError(
                "modal requires real modes of M and K at every phase, and M⁻¹K of this system has "
                "complex eigenvalues; use radau or gauss"
            )
        return super()._no_map(point, grid)


class _Uncoupled(Points):
    """Points in modal coordinates at ascending phases (k,): M = I, C = diag δ, K = diag ω², and loads.

    Modes (P, k, n, n) are sorted by frequency, with φᵀMφ = 1 (thesis, Eq. (6.12)) and continuous signs. The
    mask `complex` (P,) marks the points with complex modes; their modes are NaN here. state_bases (P, 2n,
    2n): constant maps between physical and modal states, from the modes at the first phase."""

    def __init__(self, points: Points, phase: Array):
        super().__init__(points.n, points.period)
        M, C, K, d = matrices(points, phase)
        squares, modes = np.linalg.eig(np.nan_to_num(solved(M, K)))
        largest = np.abs(squares).max(axis=(1, 2))
        self.complex = np.abs(np.imag(squares)).max(axis=(1, 2)) > 1e-9 * largest
        order = np.argsort(np.real(squares), axis=-1)
        squares = np.take_along_axis(np.real(squares), order, axis=-1)
        modes = np.take_along_axis(np.real(modes), order[..., None, :], axis=-1)
        modes /= np.sqrt(np.abs(np.einsum("pkai,pkab,pkbi->pki", modes, M, modes)))[..., None, :]
        turned = np.einsum("pkai,pkab,pkbi->pki", modes[:, 1:], M[:, :-1], modes[:, :-1]) < 0
        modes[:, 1:] *= np.where(np.cumsum(turned, axis=1) % 2 == 1, -1.0, 1.0)[..., None, :]
        modes[self.complex] = np.nan
        eye = np.eye(self.n)
        left = solved(M @ modes, np.broadcast_to(eye, M.shape))
        damping = np.einsum("pkia,pkab,pkbi->pki", left, C, modes)
        unit, delta, omega2 = (
            np.broadcast_to(part, M.shape).reshape(*d.shape[:2], -1)
            for part in (eye, damping[..., None] * eye, squares[..., None] * eye)
        )
        load = np.squeeze(left @ d[..., None], -1)
        self.modes = modes
        self._entries = np.concatenate((unit, delta, omega2, load), axis=-1)
        self.state_bases = _of_states(left[:, 0] @ M[:, 0]), _of_states(modes[:, 0])

    def __len__(self) -> int:
        return len(self._entries)

    def __getitem__(self, positions: Array) -> "_Uncoupled":
        raise NotImplementedError

    def tables(self, phase: Array) -> Tables:
        return Tables.from_entries(self._entries, self.n)


def _of_states(coordinates: Array) -> Array:
    """Maps (P, 2n, 2n) of states from maps (P, n, n) of coordinates."""
    n = coordinates.shape[-1]
    states = np.zeros((len(coordinates), 2 * n, 2 * n))
    states[:, :n, :n] = states[:, n:, n:] = coordinates
    return states
