"""Time integration of the nonlinear equations of a model."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from solve.approximation import Trigonometric, interpolated
from solve.arrays import EPS, Array
from solve.contracts import driven
from solve.errors import TransientError
from solve.matrices import SAME_PHASE
from solve.model.sampling import folded, inputs_of, symbol
from solve.model.setup import Setup
from solve.threads import FunctionOwner, symbolic

if TYPE_CHECKING:
    import casadi

_MAX_STEPS, _MIN_STEPS = 2**22, 2**12
"""Largest number of integrator steps per period, and smallest permitted limit on the number of steps between
two states. Chosen by judgement."""

_NO_WARNINGS = {"show_eval_warnings": False, "disable_internal_warnings": True}


class ModelIntegrator(FunctionOwner):
    """Time integration of r(φ, Ω, Ω̇, q, q̇, q̈) = 0 over periods, with `count` equidistant states per
    period.

    The integrator is CVODES (A. C. Hindmarsh et al., ACM Trans. Math. Softw. 31 (2005) 363-396), called
    through CasADi. It restarts at the breaks of the setup: its steps could otherwise pass over a short load
    between two breaks. residual: `residual_varying` of the setup, possibly with added damping. sizes (n,):
    scales of the coordinates; rtol is relative to them."""

    @symbolic
    def __init__(self, residual: "casadi.Function", setup: Setup, sizes: Array, count: int, rtol: float):
        import casadi

        n, period = residual.size1_in("q"), setup.module.PERIOD
        s, first, last, offset, low, high = map(symbol, ("s", "first", "last", "offset", "low", "high"))
        phase, speed, acceleration = driven(s, first, last, period)
        phase = casadi.fmin(casadi.fmax(phase + offset, low), high)
        mean = (first + last) / 2
        x, a = symbol("x", 2 * n), symbol("a", n)
        scale = casadi.DM(sizes)
        q, v = x[:n] * scale, x[n:] * scale
        inputs = [phase, speed, acceleration, q, mean * v, mean**2 * a, casadi.SX(0, 1)]
        (r,) = folded(residual, setup.p).call(inputs, True, False)
        M, remainder = casadi.jacobian(r, a), casadi.substitute(r, a, 0)
        rate = casadi.vertcat(x[n:], casadi.solve(M, -remainder) / scale)
        drive = [first, last, offset, low, high]
        self._acceleration = casadi.Function("a", [s, *drive, x], [rate[n:] * scale])
        t, begin, length = map(symbol, ("t", "begin", "length"))
        later = casadi.substitute(rate, s, begin + length * t) * length
        self._problem = {"x": x, "t": t, "p": casadi.vertcat(*drive, begin, length), "ode": later}
        self._options = {
            "reltol": rtol,
            "abstol": rtol,
            "max_num_steps": max(_MAX_STEPS // count, _MIN_STEPS),
            **_NO_WARNINGS,
        }
        self._integrators: dict[int, casadi.Function] = {}
        self.nodes = np.linspace(0.0, period, count + 1)
        self._sizes, self._n, self._period, self._breaks = np.tile(sizes, 2), n, period, setup.breaks

    def __call__(self, state: Array, start: float, speed: float, last: float | None = None) -> Array:
        """Integrate over a period, see `Integrator`. Raises TransientError if the integration fails."""
        drive = speed, speed if last is None else last, start
        states, x = np.empty((2 * self._n, len(self.nodes))), state / self._sizes
        try:
            for begin, end, low, high in self._smooth_pieces(*drive):
                x = self._integrate(x, (begin, end), (*drive, low, high), states)
        except RuntimeError as error:
            why = "; check the initial state and the speed"
            if "TOO_MUCH_WORK" in str(error):
                why = f" with {_MAX_STEPS} steps per period: its vibrations are too fast; give a higher speed"
            raise TransientError(
                f"the transient cannot be integrated beyond phase {start:.6g}{why}"
            ) from None
        a = self._acceleration(self.nodes[None], *drive, -np.inf, np.inf, states).full()
        q, v = np.split(states * self._sizes[:, None], 2)
        return np.stack((q, v, a))

    def _smooth_pieces(self, first: float, last: float, start: float) -> list[tuple[float, ...]]:
        """Intervals between breaks. Each row contains the two ends of an interval, as values of the
        independent variable, and the phases just inside these ends."""
        phases = np.unique(np.mod(np.subtract(self._breaks, start), self._period))
        phases = np.array([0.0, *phases, self._period])
        phases = phases[np.append(np.diff(phases) > 4 * SAME_PHASE * self._period, True)]
        phases[0] = 0.0
        mean, slope = (first + last) / 2, (last - first) / self._period
        # The inverse of the phase in `driven`.
        root = np.sqrt(np.maximum(first**2 + 2 * slope * mean * phases[1:], 0.0))
        ends = np.append(0.0, 2 * mean * phases[1:] / (first + root))
        ends[-1] = self._period
        inset = SAME_PHASE * self._period + 4 * EPS * start
        return list(zip(ends, ends[1:], start + phases + inset, start + phases[1:] - inset, strict=False))

    def _integrate(
        self, x: Array, ends: tuple[float, float], drive: tuple[float, ...], states: Array
    ) -> Array:
        """Integrate the scaled state x (2n,) over an interval without breaks. Set the columns of `states`
        that belong to the nodes in the interval, and return the state at the end of the interval."""
        begin, end = ends
        same, step = SAME_PHASE * self._period, self.nodes[1]
        low, high = np.searchsorted(self.nodes, [begin - same, end + same])
        if low == high:
            return self._march(x, 1, (*drive, begin, end - begin))[:, -1]
        before, after = self.nodes[low] - begin, end - self.nodes[high - 1]
        states[:, low] = self._march(x, 1, (*drive, begin, before))[:, -1] if before > same else x
        if high - low > 1:
            intervals = (*drive, self.nodes[low], step)
            states[:, low + 1 : high] = self._march(states[:, low], high - low - 1, intervals)
        x = states[:, high - 1]
        return self._march(x, 1, (*drive, self.nodes[high - 1], after))[:, -1] if after > same else x

    def _march(self, x: Array, count: int, p: tuple[float, ...]) -> Array:
        """States (2n, count) at the ends of intervals of equal length. p: parameters of the equations; the
        last two are the beginning and the length of the intervals."""
        if count not in self._integrators:
            self._integrators[count] = self._integrator(count)
        return self._integrators[count](x0=x, p=p)["xf"].full()

    @symbolic
    def _integrator(self, count: int) -> "casadi.Function":
        """Integrator over a number of intervals."""
        import casadi

        # From rest, longer steps would skip a load that begins later in the period.
        options = {**self._options, "max_step_size": 1.0}
        grid = np.arange(1.0, count + 1)
        return casadi.integrator("march", "cvodes", self._problem, 0.0, grid, options)


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
