"""Events: phases at which a motion passes the switches of the equations, such as stops, clearances and
contacts.

The switches are the arguments of |x|, sign, max, min and comparisons in the residual that depend on the
motion."""

from functools import cached_property, lru_cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from solve.arrays import Array, uniform_phases
from solve.contracts import Events, Motion
from solve.matrices import SAME_PHASE
from solve.model.formulas import operation_names
from solve.model.sampling import Sampler, inputs_of
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

MAX_CACHED = 64
"""Number of cached generated functions. They are reused if only parameter values change. Chosen by judgement:
few models are used at a time."""

_SAMPLES, _MIN_SAMPLES = 8, 512
"""Number of phases per step, and smallest total number of phases, at which the switching functions are
evaluated. Two events of one switch between neighbouring phases are not found; they are reported as grazing.
Chosen by judgement."""

_GRAZING = 1e-3
"""Threshold for grazing: modulus of a switching function, relative to its range over the period. The
threshold applies to the largest modulus between two events or, without events, to the modulus at an extremum.
Chosen by judgement."""

_REST = 1e-13
"""Range of a switching function, relative to its largest modulus, up to which the function counts as constant
and its changes as round-off."""


@lru_cache(MAX_CACHED)
@symbolic
def switches(module: ModuleType, options: tuple[tuple[str, Any], ...]) -> "casadi.Function | None":
    """Function that returns the s switching functions of a generated residual. Its inputs are the inputs of
    the residual. None if there are no switches."""
    import casadi

    residual, names = module.residual(**dict(options)), operation_names()
    inputs = inputs_of(residual)
    symbols, registers, candidates = list(inputs.values()), dict[int, Any](), list[Any]()
    for k in range(residual.n_instructions()):
        operation, code = names[residual.instruction_id(k)], residual.instruction_id(k)
        at, to = residual.instruction_input(k), residual.instruction_output(k)
        if operation == "CONST":
            registers[to[0]] = casadi.SX(residual.instruction_constant(k))
        elif operation == "INPUT":
            registers[to[0]] = symbols[at[0]].nz[at[1]]
        elif operation != "OUTPUT":
            arguments = [registers[register] for register in at]
            if operation in ("FABS", "SIGN"):
                candidates.append(arguments[0])
            elif operation in ("FMAX", "FMIN", "LT", "LE"):
                candidates.append(arguments[0] - arguments[1])
            combine = casadi.SX.unary if len(arguments) == 1 else casadi.SX.binary
            registers[to[0]] = combine(code, *arguments)
    states = casadi.vertcat(*(inputs[name] for name in ("q", "qd", "qdd")))
    moving = [switch for switch in candidates if any(casadi.which_depends(switch, states, 1))]
    if not moving:
        return None
    return casadi.Function("switches", symbols, [casadi.vertcat(*moving)], list(inputs), ["values"])


class EventFinder:
    """Switching functions of a model, evaluated along a motion at a speed (rad/s). p (p,): values of the
    parameters."""

    def __init__(self, function: "casadi.Function", p: Array):
        self._function, self._sampler, self._p = function, Sampler(function, shared=1), p

    def along(self, motion: Motion, speed: float) -> Events:
        """Events of a motion over its period."""
        count = max(_MIN_SAMPLES, _SAMPLES * (len(motion.nodes) - 1))
        phase = np.linspace(0.0, float(motion.nodes[-1]), count + 1)
        values = self._values(motion, speed, phase)
        largest = np.abs(values).max(axis=0)
        moves = np.ptp(values, axis=0) > _REST * largest
        columns = np.flatnonzero(moves & (values.min(axis=0) < 0) & (values.max(axis=0) > 0))
        phases = self._passed(motion, speed, phase, values, columns)
        grazing = [
            _grazed(phase, values[:, column], np.sort(passed))
            for column, passed in [
                *zip(columns.tolist(), phases, strict=True),
                *(
                    (column, np.zeros(0))
                    for column in np.flatnonzero(moves).tolist()
                    if column not in columns
                ),
            ]
        ]
        same = SAME_PHASE * float(phase[-1])
        sides = np.sign([values.min(axis=0), values.max(axis=0)]).T
        return Events(_ascending(phases, same), _ascending(grazing, same), tuple(map(tuple, sides.tolist())))

    def normals(self, motion: Motion, speed: float, phase: Array) -> Array:
        """Derivatives (k, 2 + 2n + p) of switching functions at phases (k,) of a motion. The derivatives are
        with respect to the phase, q, q' = dq/dφ, the speed and the parameters.

        At each phase, only the switching function nearest to zero is differentiated."""
        period, n = float(motion.nodes[-1]), len(motion(phase[:1]))
        ranges = np.ptp(self._values(motion, speed, uniform_phases(_MIN_SAMPLES, period)), axis=0)
        relative = np.abs(self._values(motion, speed, phase)) / np.where(ranges > 0, ranges, np.inf)
        passed = np.where(ranges > 0, relative, np.inf).argmin(axis=1)
        states = self._states(motion, speed, phase)
        entries = self._gradient(phase, np.full(len(phase), speed), *states, self._p)
        rows = entries.reshape(len(phase), 2 + 2 * n + len(self._p), -1)[
            np.arange(len(phase)), :, passed
        ].copy()
        velocity = slice(1 + n, 1 + 2 * n)
        rows[:, 1 + 2 * n] += (rows[:, velocity] * states[1]).sum(axis=1) / speed
        rows[:, velocity] *= speed
        return rows

    @cached_property
    @symbolic
    def _gradient(self) -> Sampler:
        """Derivatives of the switching functions, one column per quantity: the phase, q, q̇, the speed and
        the parameters."""
        import casadi

        inputs = inputs_of(self._function)
        (values,) = self._function.call(list(inputs.values()))
        moved = casadi.vertcat(*(inputs[name] for name in ("phase", "q", "qd", "speed", "p")))
        gradient = casadi.vec(casadi.densify(casadi.jacobian(values, moved)))
        return Sampler(casadi.Function("gradient", list(inputs.values()), [gradient]), shared=1)

    @staticmethod
    def _states(motion: Motion, speed: float, phase: Array) -> list[Array]:
        """States q, q̇ and q̈ of the motion, each (k, n)."""
        return [(speed**order * motion(phase, order)).T for order in range(3)]

    def _values(self, motion: Motion, speed: float, phase: Array) -> Array:
        """Switching functions (k, s) at phases (k,)."""
        speeds = np.full(len(phase), speed)
        return self._sampler(phase, speeds, *self._states(motion, speed, phase), self._p)

    def _passed(
        self, motion: Motion, speed: float, phase: Array, values: Array, columns: Array
    ) -> list[Array]:
        """Phases at which the switching functions change sign: one array for each of the selected
        functions."""
        from scipy.optimize.elementwise import find_root

        above = values[:, columns] > 0
        at, which = np.nonzero(above[1:] != above[:-1])
        if not len(at):
            return [np.zeros(0)] * len(columns)

        def switch(positions: Array, column: Array) -> Array:
            rows = self._values(motion, speed, positions.ravel())
            return rows[np.arange(len(rows)), column.astype(int).ravel()].reshape(positions.shape)

        found = find_root(switch, (phase[at], phase[at + 1]), args=(columns[which],))
        return [found.x[which == column] for column in range(len(columns))]


def _grazed(phase: Array, values: Array, passed: Array) -> Array:
    """Phases at which a switching function is near zero between two of its zeros or, if it has no zeros, at
    an extremum."""
    moduli, limit = np.abs(values[:-1]), _GRAZING * np.ptp(values)
    turns = (moduli <= np.roll(moduli, 1)) & (moduli < np.roll(moduli, -1)) & (moduli <= limit)
    same = (np.roll(values[:-1], 1) > 0) == (np.roll(values[:-1], -1) > 0)
    grazed = [float(at) for at in phase[:-1][turns & same]]
    for first, last in zip(passed, np.roll(passed, -1), strict=True) if len(passed) > 1 else ():
        between = (phase > first) & (phase < last) if first < last else (phase > first) | (phase < last)
        if np.abs(values[between]).max(initial=0.0) <= limit:
            grazed.append(float(first))
    return np.array(grazed)


def _ascending(groups: list[Array], same: float) -> tuple[float, ...]:
    """All phases in ascending order. Of phases that coincide within the tolerance `same`, only one is
    returned."""
    phases = np.sort(np.concatenate(groups)) if groups else np.zeros(0)
    return tuple(phases[np.diff(phases, prepend=-np.inf) > same].tolist())
