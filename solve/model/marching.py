"""A model in time from a state, turn by turn, by CVODES (A. C. Hindmarsh et al., ACM Trans. Math. Softw. 31
(2005) 363-396), which CasADi brings."""

from typing import TYPE_CHECKING

import numpy as np

from solve.arrays import Array
from solve.contracts import driven
from solve.errors import TransientError
from solve.model.sampling import folded, symbol

if TYPE_CHECKING:
    import casadi

_MOST_STEPS, _FEWEST = 2**22, 2**12
"""Of a turn, at the rate of any part of it between two states, and between these at least."""

_QUIET = {"show_eval_warnings": False, "disable_internal_warnings": True}


class ModelMarcher:
    """One period after another of r(φ, Ω, Ω̇, q, q̇, q̈) = 0, with `count` states a period, evenly in time.

    residual: a generated `residual_varying`. sizes (n,): by which coordinates are measured, so that rtol is
    relative to these.
    """

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
        M, rest = casadi.jacobian(r, a), casadi.substitute(r, a, 0)
        rate = casadi.vertcat(x[n:], casadi.solve(M, -rest) / scale)
        self._acceleration = casadi.Function("a", [s, first, last, offset, x], [rate[n:] * scale])
        grid = np.linspace(0.0, period, count + 1)
        most = max(_MOST_STEPS // count, _FEWEST)
        # At rest longer steps would pass over a load that begins later in the turn.
        options = {"reltol": rtol, "abstol": rtol, "max_num_steps": most, "max_step_size": grid[1], **_QUIET}
        problem = {"x": x, "t": s, "p": casadi.vertcat(first, last, offset), "ode": rate}
        self._integrator = casadi.integrator("march", "cvodes", problem, 0.0, grid[1:], options)
        self._sizes, self.nodes, self._n = np.tile(sizes, 2), grid, n

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """See `Marcher`. Raises TransientError where the motion cannot be followed."""
        drive = speed, speed if last is None else last, start
        try:
            found = self._integrator(x0=state / self._sizes, p=drive)["xf"].full()
        except RuntimeError as error:
            why = "; look at the start and the speed"
            if "TOO_MUCH_WORK" in str(error):
                why = f" with {_MOST_STEPS} steps a turn: its vibrations are too fast; give a higher speed"
            raise TransientError(f"the transient cannot be followed beyond phase {start:.6g}{why}") from None
        x = np.column_stack((state / self._sizes, found))
        a = self._acceleration(self.nodes[None], *drive, x).full()
        q, v = np.split(x * self._sizes[:, None], 2)
        return np.stack((q, v, a))
