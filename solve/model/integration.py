"""Time integration of the nonlinear equations of a model."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from solve.approximation import Trigonometric, interpolated
from solve.arrays import Array
from solve.contracts import driven
from solve.errors import TransientError
from solve.model.sampling import folded, inputs_of, symbol
from solve.threads import release, symbolic

if TYPE_CHECKING:
    import casadi

_MAX_STEPS, _MIN_STEPS = 2**22, 2**12
"""Largest number of integrator steps per period, and smallest permitted limit on the number of steps between
two states. Chosen by judgement."""

_NO_WARNINGS = {"show_eval_warnings": False, "disable_internal_warnings": True}


class ModelIntegrator:
    """Time integration of r(φ, Ω, Ω̇, q, q̇, q̈) = 0 over periods, with `count` equidistant states per
    period.

    The integrator is CVODES (A. C. Hindmarsh et al., ACM Trans. Math. Softw. 31 (2005) 363-396), called
    through CasADi. residual: generated `residual_varying`. sizes (n,): scales of the coordinates; rtol is
    relative to them."""

    @symbolic
    def __init__(
        self,
        residual: "casadi.Function",
        parameters: Array,
        period: float,
        sizes: Array,
        count: int,
        rtol: float,
    ):
        import casadi

        n = residual.size1_in("q")
        s, first, last, offset = map(symbol, ("s", "first", "last", "offset"))
        phase, speed, acceleration = driven(s, first, last, period)
        mean = (first + last) / 2
        x, a = symbol("x", 2 * n), symbol("a", n)
        scale = casadi.DM(sizes)
        q, v = x[:n] * scale, x[n:] * scale
        inputs = [phase + offset, speed, acceleration, q, mean * v, mean**2 * a, casadi.SX(0, 1)]
        (r,) = folded(residual, parameters).call(inputs, True, False)
        M, remainder = casadi.jacobian(r, a), casadi.substitute(r, a, 0)
        rate = casadi.vertcat(x[n:], casadi.solve(M, -remainder) / scale)
        self._acceleration = casadi.Function("a", [s, first, last, offset, x], [rate[n:] * scale])
        grid = np.linspace(0.0, period, count + 1)
        most = max(_MAX_STEPS // count, _MIN_STEPS)
        # From rest, longer steps would skip a load that begins later in the period.
        options = {
            "reltol": rtol,
            "abstol": rtol,
            "max_num_steps": most,
            "max_step_size": grid[1],
            **_NO_WARNINGS,
        }
        problem = {"x": x, "t": s, "p": casadi.vertcat(first, last, offset), "ode": rate}
        self._integrator = casadi.integrator("march", "cvodes", problem, 0.0, grid[1:], options)
        self._sizes, self.nodes, self._n = np.tile(sizes, 2), grid, n

    _release = staticmethod(release)

    def __del__(self) -> None:
        self._release(vars(self))

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Integrate over a period, see `Integrator`. Raises TransientError if the integration fails."""
        drive = speed, speed if last is None else last, start
        try:
            later = self._integrator(x0=state / self._sizes, p=drive)["xf"].full()
        except RuntimeError as error:
            why = "; check the initial state and the speed"
            if "TOO_MUCH_WORK" in str(error):
                why = f" with {_MAX_STEPS} steps per period: its vibrations are too fast; give a higher speed"
            raise TransientError(
                f"the transient cannot be integrated beyond phase {start:.6g}{why}"
            ) from None
        x = np.column_stack((state / self._sizes, later))
        a = self._acceleration(self.nodes[None], *drive, x).full()
        q, v = np.split(x * self._sizes[:, None], 2)
        return np.stack((q, v, a))


@symbolic
def damped_residual(
    residual: "casadi.Function", damping: Callable[[Array], Array], period: float
) -> "casadi.Function":
    """Add C(φ) q̇ to a generated `residual`, with a trigonometric interpolant of C. Raises TransientError if
    C is not smooth."""
    import casadi

    curve = interpolated(damping, period)
    if not isinstance(curve, Trigonometric):
        raise TransientError(
            "the nonlinear equations cannot be integrated if matrices with damping ratios jump; state "
            "a dissipation function instead of the ratios"
        )
    inputs = inputs_of(residual)
    C, n = curve.at(inputs["phase"], casadi.cos, casadi.sin), residual.size1_out("r")
    (r,) = residual.call([*inputs.values()], True, False)
    force = casadi.reshape(casadi.vertcat(*C), n, n).T @ inputs["qd"]
    return casadi.Function("residual", [*inputs.values()], [r + force], [*inputs], ["r"])
