"""Derivatives of the breaks and equations of a model with respect to its parameters, and the conditions for
their existence."""

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property

import numpy as np

from solve.approximation import slope
from solve.arrays import Array
from solve.contracts import Columns, Dependence
from solve.errors import NoDerivativeError, ValueOutOfBoundsError, require_name
from solve.labels import SPEED
from solve.matrices import SAME_PHASE
from solve.model.bounds import clauses
from solve.model.dependence import (
    AssembledDependence,
    DampedDependence,
    GeneratedDependence,
    GeneratedSlopes,
)
from solve.model.modes import DampedSampler
from solve.model.setup import Setup
from solve.system import PeriodicSystem

_BREAK_STEP = 1e-2
"""Largest relative change of a parameter in the finite differences of the breaks. Chosen by judgement."""

_FEW = 2
"""Number of parameters up to which the derivatives of nonlinear equations have compiled code of their own.
Chosen by judgement: branches vary one or two parameters."""

SlopesCache = dict[tuple[tuple[str, ...], bool], GeneratedSlopes]


class ModelDerivatives:
    """Derivatives of the linearised or nonlinear equations of a model; see `ParameterDerivatives`.

    assembled: whether the matrices are assembled numerically and therefore differentiated by finite
    differences. slopes: cache of the derivatives of generated functions. Its keys are the names of the
    parameters, and whether the nonlinear equations are differentiated."""

    def __init__(self, system: PeriodicSystem, setup: Setup, assembled: bool, slopes: SlopesCache):
        self._system, self._setup, self._assembled, self._slopes = system, setup, assembled, slopes
        self._nonlinear, self._periods = False, 1
        self._of_breaks: dict[str, Array | None] = {}
        self._about_motion: dict[int, ModelDerivatives] = {}

    def about_motion(self, periods: int) -> "ModelDerivatives":
        """Derivatives of the nonlinear equations. The period is `periods` periods of the model."""
        if periods not in self._about_motion:
            derivatives = copy(self)
            derivatives._nonlinear, derivatives._periods = True, periods
            self._about_motion[periods] = derivatives
        return self._about_motion[periods]

    @cached_property
    def _integers(self) -> set[str]:
        parameters = self._setup.module.PARAMETERS
        return {name for name, _, _, bound in parameters if "integer" in clauses(bound)}

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Parameters with respect to which the equations are differentiable."""
        return tuple(
            name
            for name, value in self._setup.case.parameters.items()
            if name not in self._integers and (value or not self._assembled) and self._has_smooth_breaks(name)
        )

    def of_breaks(self, names: Sequence[str]) -> Array:
        """Derivatives (b, r) of the phases of the breaks, with respect to the named parameters or, for the
        name "speed", to the speed."""
        zero = np.zeros(len(self._setup.breaks))
        columns = [None if name == SPEED else self._of_break(name) for name in names]
        slopes = np.array([zero if column is None else column for column in columns])
        return np.tile(slopes.reshape(len(names), -1).T, (self._periods, 1))

    def by(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        """Derivatives of the equations, with respect to the named parameters or, for the name "speed", to the
        speed.

        compiled: evaluation of formulas by compiled code, if available. Raises UnknownNameError,
        NoDerivativeError.
        """
        self._require(names)
        damped = self._setup.ratios is not None
        if self._assembled and not damped:
            return AssembledDependence(self._system, names)
        # Compiled code includes all parameters, so that one function serves any selection. Nonlinear
        # equations with one or two parameters are an exception, because branches evaluate their derivatives
        # many times.
        few = compiled is None or (self._nonlinear and len(names) <= _FEW)
        included = tuple(names) if few else (*self.names, SPEED)
        slopes = self._slopes_by(included)
        if compiled is not None and not slopes.residual.text:
            slopes, compiled = self._slopes_by(tuple(names)), None
        arguments = slopes, self._setup, self._system.n, names, compiled
        return DampedDependence(*arguments, self._damping) if damped else GeneratedDependence(*arguments)

    def _require(self, names: Sequence[str]) -> None:
        """Raise UnknownNameError for unknown parameters, and NoDerivativeError for parameters without
        derivatives."""
        parameters, smooth = self._setup.case.parameters, {SPEED, *self.names}
        for name in names:
            require_name(f"quantity of {self._setup.module.NAME}", name, [SPEED, *parameters])
            if self._assembled and parameters.get(name) == 0:
                raise NoDerivativeError(
                    f"{name} is 0, but derivatives of assembled matrices and of modal damping use "
                    f"relative changes of a parameter; give a small value, such as --set {name}=1e-6"
                )
            if name not in smooth:
                raise NoDerivativeError(
                    f"derivatives with respect to {name} are not available: {name} {self._obstacle(name)}; "
                    f"omit {name}"
                )

    def _obstacle(self, name: str) -> str:
        """Reason why the derivatives with respect to a parameter do not exist."""
        if name in self._integers:
            return "is an integer"
        if self._of_break(name) is None:
            return "moves a jump that coincides with another"
        return "moves a jump of a model with damping ratios"

    def _slopes_by(self, names: tuple[str, ...]) -> GeneratedSlopes:
        key = names, self._nonlinear
        if key not in self._slopes:
            self._slopes[key] = GeneratedSlopes(self._setup, self._system.n, names, self._nonlinear)
        return self._slopes[key]

    def _damping(self, parameters: Mapping[str, float], phase: Array) -> Array:
        """Modal damping matrix (k, n, n) at phases (k,) for changed parameters."""
        setup = self._setup.varied(parameters, {})
        assert setup.ratios is not None
        return DampedSampler(setup.function("linearised"), setup.p, setup.ratios).damping(phase)

    def _has_smooth_breaks(self, name: str) -> bool:
        """Whether the phases of the breaks, and the equations at the breaks, are differentiable with respect
        to a parameter."""
        slopes = self._of_break(name)
        return slopes is not None and not (self._assembled and slopes.any())

    def _of_break(self, name: str) -> Array | None:
        """Derivatives (b,) of the phases of the breaks with respect to a parameter; None if the breaks merge
        or split."""
        if name not in self._of_breaks:
            self._of_breaks[name] = self._difference(name)
        return self._of_breaks[name]

    def _difference(self, name: str) -> Array | None:
        setup, breaks = self._setup, np.array(self._setup.breaks)
        if not setup.moves_breaks:
            return np.zeros(len(breaks))
        x, p, index = setup.case.parameters[name], setup.p, list(setup.case.parameters).index(name)

        def moved(value: float) -> Array:
            changed = np.where(np.arange(len(p)) == index, value, p)
            return _moved_breaks(breaks, np.array(setup.breaks_with(changed)), setup.module.PERIOD)

        try:
            return slope(moved, x, _BREAK_STEP * (abs(x) or 1.0))
        except ValueOutOfBoundsError:
            return None


def _moved_breaks(breaks: Array, moved: Array, period: float) -> Array:
    """New phases (b,) of the breaks: for each of `breaks` (b,), the nearest of `moved` (c,). Raises
    ValueOutOfBoundsError if breaks have merged or split."""
    ends = _distinct(moved, period)
    distances = (ends - breaks[:, None] + period / 2) % period - period / 2
    nearest = np.abs(distances).argmin(axis=1)
    if not len(set(nearest.tolist())) == len(ends) == len(_distinct(breaks, period)):
        raise ValueOutOfBoundsError(
            "jumps of the matrices merge or split at these parameters; change the parameters slightly"
        )
    return breaks + distances[np.arange(len(breaks)), nearest]


def _distinct(breaks: Array, period: float) -> Array:
    """Breaks without repetitions. Breaks that coincide within round-off, modulo the period, appear once."""
    phases = np.sort(breaks % period)
    return phases[np.diff(phases, append=phases[:1] + period) > SAME_PHASE * period]
