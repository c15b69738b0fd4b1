"""Modal uncoupling with the modes of each position (A. Midha, A. G. Erdman, D. A. Frohrib, J. Mech. Des.
101 (1979) 154-162; thesis 6.3): the approximation that it is."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError
from solve.methods.hsu import Hsu
from solve.methods.method import Discretisation, OneStep
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Modal(OneStep):
    """In every step the modes are those of its middle, each of unit modal mass; the damping between them is
    left out, and each modal coordinate is carried over to the next step as if the modes did not turn."""

    name = "modal"
    order = 0
    curve_order = 0
    l_stable = False

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation:
        n = system.n
        middles = grid.stages(np.array([0.5]))[:, 0]
        uncoupled = PeriodicSystem(
            lambda phase, _: _modal_matrices(system, phase, speed)[0], system.coordinates, system.period
        )
        modal = Hsu().discretise(uncoupled, 1.0, grid)
        modes = _modal_matrices(system, middles, speed)[1]

        def curve(x: Array) -> Curve:
            from scipy.interpolate import make_interp_spline

            eta = (x[:-1, :n] + x[1:, :n]) / 2
            q = np.squeeze(modes @ eta[..., None], -1)
            closed = np.concatenate((middles, middles[:1] + grid.period))
            spline = make_interp_spline(closed, np.concatenate((q, q[:1])), k=5, bc_type="periodic")
            nodes = np.mod(grid.nodes - middles[0], grid.period) + middles[0]
            values, rates, second = (spline(nodes, nu=order) for order in range(3))
            return Curve.quintic(grid.nodes, values, rates, second[:-1], second[1:])

        return Discretisation(modal.steps, curve)


def _modal_matrices(system: PeriodicSystem, phase: Array, speed: float) -> tuple[tuple[Array, ...], Array]:
    """I, diag δ, diag ω², loads (m, n) and the modes (m, n, n), sorted by frequency, φᵀMφ = 1 (thesis
    (6.12)), signs continued."""
    M, C, K, d = system.in_phase(phase, speed)
    squares, modes = np.linalg.eig(np.linalg.solve(M, K))
    if np.abs(np.imag(squares)).max() > 1e-9 * np.abs(squares).max():
        raise MatricesError(
            "modal needs real frozen modes, and M⁻¹K has complex eigenvalues here; use radau or gauss"
        )
    order = np.argsort(np.real(squares), axis=1)
    squares = np.take_along_axis(np.real(squares), order, axis=1)
    modes = np.take_along_axis(np.real(modes), order[:, None], axis=2)
    modes /= np.sqrt(np.abs(np.einsum("kai,kab,kbi->ki", modes, M, modes)))[:, None]
    turned = np.einsum("kai,kab,kbi->ki", modes[1:], M[:-1], modes[:-1]) < 0
    modes[1:] *= np.where(np.cumsum(turned, axis=0) % 2 == 1, -1.0, 1.0)[:, None]
    left = np.linalg.inv(M @ modes)
    damping = np.einsum("kia,kab,kbi->ki", left, C, modes)
    load = np.squeeze(left @ d[..., None], -1)
    eye = np.eye(system.n)
    unit = np.broadcast_to(eye, M.shape)
    return (unit, damping[..., None] * eye, squares[..., None] * eye, load), modes
