"""Modal damping of mechanisms: what the ratios of the frozen modes add to C."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.errors import MatricesError, TransientError
from solve.model.modes import modal_damping, vibrates
from solve.model.sampling import MatrixSampler, inputs_of, parted
from solve.trigonometric import Trigonometric, interpolated

if TYPE_CHECKING:
    import casadi

_STILL = np.zeros(1)


def beyond_critical(ratio: float) -> str:
    """A warning about a damping ratio above 1."""
    return f"damping ratio {ratio:g}: beyond 1 no mode vibrates; a ratio is 0.02, not 2 (percent)"


class DampedSampler(MatrixSampler):
    """M, C, K, d of a generated `linearised` function, C with modal damping of ratios (k,) of the modes of M
    and K at speed 0 at every phase. Raises MatricesError where there are no modes."""

    def __init__(self, linearised: "casadi.Function", parameters: Array, ratios: Array):
        super().__init__(linearised, parameters)
        self._ratios = ratios

    def entries(self, phase: Array, speeds: Array) -> Array:
        entries = super().entries(phase, speeds)
        entries[:, :, self.n**2 : 2 * self.n**2] += self.damping(phase).reshape(len(phase), -1)
        return entries

    def terms(self, phase: Array) -> None:
        return None

    def damping(self, phase: Array) -> Array:
        """What is added to C, (m, n, n)."""
        found = damped(super().entries(phase, _STILL)[0], self.n, self._ratios)
        without = np.isnan(found).any(axis=(1, 2))
        if without.any():
            raise MatricesError(
                f"damping ratios: at phase {phase[np.argmax(without)]:.4g} and speed 0 K is not symmetric or "
                "not positive, so that there are no modes; state the dissipation instead"
            )
        return found


def damped(entries: Array, n: int, ratios: Array) -> Array:
    """Modal damping (m, n, n) of M and K in entries (m, 3n² + n) by rows, ratios (k,) or (m, k); NaN where
    there are no modes."""
    M, _, K, _ = parted(entries, n)
    C, fit = np.full(M.shape, np.nan), vibrates(M, K)
    if fit.any():
        C[fit] = modal_damping(M[fit], K[fit], np.broadcast_to(ratios, (len(M), ratios.shape[-1]))[fit])
    return C


def damped_residual(
    residual: "casadi.Function", damping: Callable[[Array], Array], period: float
) -> "casadi.Function":
    """A generated `residual` with C(φ) q̇ added, C by its trigonometric interpolant. Raises TransientError
    where C is not smooth enough for one."""
    import casadi

    curve = interpolated(damping, period)
    if not isinstance(curve, Trigonometric):
        raise TransientError(
            "damping ratios of matrices that jump cannot be followed in time by the nonlinear equations; "
            "state the dissipation instead"
        )
    inputs = inputs_of(residual)
    C, n = curve.at(inputs["phase"], casadi.cos, casadi.sin), residual.size1_out("r")
    (r,) = residual.call([*inputs.values()], True, False)
    force = casadi.reshape(casadi.vertcat(*C), n, n).T @ inputs["qd"]
    return casadi.Function("residual", [*inputs.values()], [r + force], [*inputs], ["r"])
