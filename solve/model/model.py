"""Periodic systems whose matrices, outputs and bounds come from a generated module."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import Any, Self

import numpy as np

from solve.arguments import first_is, matches_annotations
from solve.arrays import Array, Plane
from solve.capabilities import Capabilities, Evaluation, Nonlinear, Validity, Variation
from solve.contracts import Columns, Events, Integrator, Limit, Matrices, Motion
from solve.equations import require_desired_motion
from solve.errors import UnknownNameError, ValueOutOfBoundsError, require_name
from solve.labels import SPEED, Labels, require_vibration
from solve.matrices import by_the_phase
from solve.model.bounds import checked_parameters, stated_limits
from solve.model.cases import Case
from solve.model.checks import require_no_jump, require_valid, valid_at_all_speeds
from solve.model.derivatives import ModelDerivatives, SlopesCache
from solve.model.generated import model_module, module_of
from solve.model.many_points import ModelPoints
from solve.model.modes import DampedSampler, beyond_critical
from solve.model.outputs import ModelOutputs
from solve.model.sampling import MatrixSampler, Sampler, folded
from solve.model.setup import Setup, labels_of, left_out, stated_lines
from solve.model.tangent import Tangent
from solve.system import PeriodicSystem, shown_in


class Model(PeriodicSystem, Evaluation, Validity, Variation, Nonlinear):
    """System whose matrices, outputs and bounds come from a generated module; see `solve.load`.

    Parameters
    ----------
    setup : Setup
        Generated module, case and options.
    matrices : callable
        As for `PeriodicSystem`.
    coordinates : sequence of (str, str, str)
        Name, unit and meaning of each coordinate.
    labels : Labels, optional
        Labels of the model; by default those of the setup.

    Examples
    --------
    >>> import solve
    >>> solve.load("mathieu", delta=1.5).coordinates
    ('q',)
    """

    def __init__(
        self,
        setup: Setup,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[tuple[str, str, str]],
        labels: Labels | None = None,
    ):
        module = setup.module
        super().__init__(matrices, [name for name, *_ in coordinates], module.PERIOD, setup.breaks)
        self.setup, self.module = setup, module
        self._outputs = ModelOutputs(setup)
        self.slopes: SlopesCache = {}
        self._labels_along: dict[object, tuple[Labels, Labels]] = {}
        self.outputs = tuple(name for name, *_ in module.OUTPUTS)
        inputs = getattr(module, "INPUTS", ())
        self.inputs = tuple(name for name, *_ in inputs)
        self.fits = setup.case.fits
        self.labels = labels or labels_of(setup, (*coordinates, *module.OUTPUTS, *inputs))
        self.validity = {name: module.VALIDITY[name] for name in self.coordinates if name in module.VALIDITY}

    @classmethod
    def from_setup(cls, setup: Setup) -> Self:
        """Model from a setup."""
        linearised, p, ratios = setup.function("linearised"), setup.p, setup.ratios
        sampler = MatrixSampler(linearised, p) if ratios is None else DampedSampler(linearised, p, ratios)
        return cls(setup, sampler, setup.module.COORDINATES[: sampler.n])

    def _repr_html_(self) -> str:
        """HTML of the title and the linearised equations, for notebooks."""
        return "".join(f"<p>{line}</p>" for line in (escape(self.labels.title), *self.labels.equations))

    def __reduce__(self) -> tuple[Any, ...]:
        """Rebuild the model when it is copied or pickled, because CasADi's memory belongs to one thread of
        one process."""
        origin = getattr(self.module, "CODE", None) or Path(self.module.__file__ or "")
        arguments = type(self), origin, self.setup.case, self.labels.options
        return _rebuilt, arguments, {"labels": self.labels}

    @matches_annotations
    def varied(
        self, parameters: Mapping[str, Any] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """Model with changed parameters or options.

        Parameters
        ----------
        parameters : mapping, optional
            Mapping from names to new values in the units of the model.
        options : mapping, optional
            Mapping from names of options to new values.

        Returns
        -------
        Model

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        for name in parameters or {}:
            require_name(f"parameter of {self.labels.name}", name, self.labels.parameters)
        model = self.from_setup(self.setup.varied(parameters or {}, options or {}))
        model.labels = replace(model.labels, speed_unit=self.labels.speed_unit)
        if not options:
            model.slopes = self.slopes
        return model

    @property
    def parameters(self) -> Mapping[str, float]:
        """Values of the parameters, in the units declared by the model: the values of the case, unless they
        were changed."""
        return self.labels.parameters

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(
            input_matrix=self._inputs_at if self.inputs else None,
            outputs=self._outputs if self.outputs else None,
            validity=self,
            evaluation=self,
            variation=self,
            nonlinear=self if hasattr(self.module, "residual") else None,
            domain=self._require_desired_motion,
            sketch=self._sketched,
            varying=self._varying_at,
        )

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        checked_parameters(self.module, {**self.parameters, **parameters})

    @cached_property
    def sampler(self) -> MatrixSampler | None:
        """Sampler of the generated matrices; None if the matrices are assembled."""
        return self._matrices if isinstance(self._matrices, MatrixSampler) else None

    def entries(self, phase: Array, speed: float) -> Array | None:
        over = self.entries_over(phase, np.array([speed]))
        # If None is returned, the caller evaluates the matrices; this raises the error.
        return over[0] if over is not None and np.isfinite(over).all() else None

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        sampler = self.sampler
        terms = None if sampler is None else sampler.terms(phase)
        if terms is None:
            return None
        table, entry, power = terms
        return table, speeds[:, None] ** power, entry

    def entries_over(self, phase: Array, speeds: Array) -> Array | None:
        if self.sampler is None:
            return None
        entries = by_the_phase(self.sampler.entries(phase, speeds), speeds, self.n)
        entries[~self.setup.exist(speeds)] = np.nan
        return entries

    def _require_desired_motion(self, speeds: Array) -> None:
        if len(missing := speeds[~self.setup.exist(speeds)]) and self.setup.domain:
            self.setup.domain.require(float(missing[0]), self.labels.speed_unit.text(float(missing[0])))

    def many_points(self, names: Sequence[str]) -> ModelPoints | None:
        return None if self.sampler is None else ModelPoints(self.setup, self.n, names)

    def _check(self, speed: float) -> None:
        """Perform the checks of every system. Also check that the fundamental motion exists, that generated
        matrices jump only at breaks, and that M is positive definite. Raises DesiredMotionError,
        MatricesError."""
        require_desired_motion(shown_in(self, speed), np.array([speed]))
        if not self._valid_at_all_speeds:
            require_no_jump(self, speed)
            super()._check(speed)
            require_valid(self, speed)

    @cached_property
    def _valid_at_all_speeds(self) -> bool:
        """Whether the matrices pass all checks at every speed."""
        return self.sampler is not None and valid_at_all_speeds(self, self.sampler)

    @matches_annotations
    def field(self, name: str, position: Array | float) -> Array:
        """Evaluate the mode functions of a declared deflection field.

        The product with the coordinates is the deflection: `model.field("w", [0.25, 0.5]) @ orbit.q`.

        Parameters
        ----------
        name : str
            Name of the field.
        position : (k,) array or float
            Positions on the link as fractions of its length, 0 to 1.

        Returns
        -------
        (k, n) array

        Raises
        ------
        UnknownNameError, ValueOutOfBoundsError
        """
        fields = [field for field, *_ in getattr(self.module, "FIELDS", ())]
        if name not in fields:
            raise UnknownNameError(f"field of {self.labels.name}", name, fields)
        fraction = np.asarray(position, dtype=float)
        if not ((fraction >= 0) & (fraction <= 1)).all():
            raise ValueOutOfBoundsError(f"position is {position}; allowed: fractions of the length, 0 to 1")
        shapes = self.setup.function("fields").map(fraction.size)(fraction.reshape(1, -1))
        return shapes.full().T.reshape(*fraction.shape, self.n)

    def _sketched(self, phase: Array, speed: float, q: Array, fineness: float) -> Mapping[str, Plane]:
        return stated_lines(self.setup, phase, speed, q, fineness)

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        ratios = self.setup.ratios
        overdamped = [] if ratios is None or ratios.max() <= 1 else [beyond_critical(ratios.max())]
        texts = [*self.labels.equation_warnings, *overdamped]
        return texts if linear else [text for text in texts if text not in left_out(self.setup)]

    @property
    def labels_along(self) -> Labels:
        """Labels of the model linearised about a motion. They omit the terms that the linearisation about the
        fundamental motion neglects."""
        known, labels = self._labels_along.get(self.labels.speed_unit, (None, self.labels))
        if known is not self.labels:
            warnings = [each for each in self.labels.equation_warnings if each not in left_out(self.setup)]
            labels = replace(self.labels, equation_warnings=tuple(warnings))
            self._labels_along[self.labels.speed_unit] = self.labels, labels
        return labels

    def along(self, motion: Motion, compiled: Columns | None = None) -> "LinearisedModel":
        return LinearisedModel(self, motion, compiled)

    def along_events(
        self, motion: Motion, speed: float, compiled: Columns | None = None
    ) -> "LinearisedModel":
        linearised = self.along(motion, compiled)
        if self.setup.event_finder is not None:
            linearised.meet(self.setup.event_finder.along(motion, speed))
        return linearised

    @cached_property
    def derivatives(self) -> ModelDerivatives:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Derivatives of the equations with respect to parameters and speed."""
        return ModelDerivatives(self, self.setup, self.assembled, self.slopes)

    @property
    def moves_breaks(self) -> bool:
        return self.setup.moves_breaks

    @property
    def assembled(self) -> bool:
        """Whether the matrices are assembled numerically. This is also the case for modal damping, which
        requires eigenvalues."""
        return self.setup.ratios is not None

    def marcher(self, sizes: Array, count: int, rtol: float) -> Integrator:
        return self.tangent.integrator(sizes, count, rtol)

    @cached_property
    def tangent(self) -> Tangent:
        """Linearisation of the nonlinear equations about given states."""
        damping = self.sampler.damping if isinstance(self.sampler, DampedSampler) else None
        return Tangent(self.setup, self.n, damping)

    def _varying_at(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        return self.tangent.varying(phase, speed, acceleration, *np.zeros((2, len(phase), self.n)))

    def _inputs_at(self, phase: Array, speed: float) -> list[Array]:
        entries = self._input_entries(phase, np.full(len(phase), speed), np.zeros(0))
        return [entries.reshape(len(phase), self.n, -1)]

    @cached_property
    def _input_entries(self) -> Sampler:
        """Sampler of the input matrix B in row order at phases and speeds (k,), without free parameters."""
        return Sampler(folded(self.setup.function("inputs"), self.setup.p), shared=1)

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.validity, *(name for name, *_ in self.module.LIMITS))))

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        names = list(quantities)
        rows = [row for row in self.module.LIMITS if row[0] in names]
        validity = {name: bound for name, bound in self.validity.items() if linear and name in names}
        return stated_limits(rows, validity, self.labels.units)


of_model = first_is(Model, such_as="solve.load('cam')", demand=require_vibration)
"""Decorator for public functions of a model that can vibrate."""


_SHARED = "setup", "module", "coordinates", "inputs", "outputs", "fits", "_outputs", "_symbols"
"""Attributes that a model and its linearisations have in common."""


class LinearisedModel(Model):
    """Model linearised about a motion, as returned by `PeriodicSystem.along`.

    The bounds of validity and the neglected terms of the linearisation about the fundamental motion do not
    apply."""

    @cached_property
    def derivatives(self) -> ModelDerivatives:
        return self.model.derivatives.about_motion(round(self.period / self.model.period))

    def __init__(self, model: Model, motion: Motion, compiled: Columns | None = None):
        # Each correction of Newton's iteration creates an instance, for which the checks of the model hold.
        vars(self).update({name: vars(model)[name] for name in _SHARED})
        self._matrices, self.labels = self._along, model.labels_along
        self.slopes, self._labels_along = {}, {}
        self.model, self.motion, self._compiled, self.events = model, motion, compiled, Events()
        starts = np.arange(round(motion.nodes[-1] / model.period)) * model.period
        self.breaks = tuple((starts[:, None] + np.array(model.breaks)).ravel().tolist())
        self.period, self.validity = float(motion.nodes[-1]), {}

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.model, self.motion), {"breaks": self.breaks, "events": self.events}

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(linearisation=self)

    def meet(self, events: Events) -> None:
        """Add breaks at the phases at which the motion passes switches."""
        self.events, self.breaks = events, tuple(sorted({*self.breaks, *events.phases}))

    def along_events(
        self, motion: Motion, speed: float, compiled: Columns | None = None
    ) -> "LinearisedModel":
        return self.model.along_events(motion, speed, compiled)

    def _along(self, phase: Array, speed: float) -> Matrices:
        return self.model.tangent.with_damping(phase, self._tangent(phase, speed).T)

    def _tangent(self, phase: Array, speed: float) -> Array:
        """Entries (3n² + n, k) of M, C and K in row order, and of d, at phases (k,), without modal
        damping."""
        require_desired_motion(self.model, np.array([speed]))
        speeds, states = np.full(len(phase), speed), self._motion_states(phase, speed)
        return self.model.tangent.entries(phase, speeds, states, self._compiled)

    def _motion_states(self, phase: Array, speed: float) -> list[Array]:
        """States q, q̇ and q̈ of the motion, each (n, k)."""
        states_of = getattr(self.motion, "states", None)
        if states_of and self.events.phases:
            # Near an event, the two sides of a switch must be distinguished.
            states_of = partial(states_of, beside_nodes=True)
        states = states_of(phase) if states_of else [self.motion(phase, order) for order in range(3)]
        return [speed**order * state for order, state in enumerate(states)]

    def roundoff(self, phase: Array, speed: float) -> Array:
        states = (state.T for state in self._motion_states(phase, speed))
        return self.model.setup.residual_roundoff(phase, np.full(len(phase), speed), *states, self.setup.p)

    def entries(self, phase: Array, speed: float) -> Array | None:
        if self.model.assembled:
            return None
        entries = by_the_phase(self._tangent(phase, speed).T[None], np.array([speed]), self.n)[0]
        # If None is returned, the caller evaluates the matrices; this raises the error.
        return entries if np.isfinite(entries).all() else None

    def used_entries(self, phase: Array, speed: float) -> tuple[Array, Array] | None:
        if self.model.assembled:
            return None
        used, squared = self.model.tangent.used_entries, self.n**2
        entries = self._tangent(phase, speed)[used]
        entries *= np.array([speed**2, speed, 1.0, 1.0])[used // squared][:, None]
        # The evaluation of all entries raises the error.
        return (entries.T, used) if np.isfinite(entries).all() else None

    def along(self, motion: Motion, compiled: Columns | None = None) -> "LinearisedModel":
        return self.model.along(motion, compiled)

    def event_normals(self, motion: Motion, speed: float, phases: Array, names: Sequence[str] = ()) -> Array:
        finder = self.setup.event_finder
        if finder is None or not len(phases):
            return np.zeros((0, 1 + 2 * self.n + len(names)))
        normals, order = finder.normals(motion, speed, phases), list(self.setup.case.parameters)
        fixed = 2 + 2 * self.n
        columns = [fixed - 1 if name == SPEED else fixed + order.index(name) for name in names]
        return normals[:, [*range(fixed - 1), *columns]]

    def varied(
        self, parameters: Mapping[str, Any] | None = None, options: Mapping[str, Any] | None = None
    ) -> "LinearisedModel":
        varied = LinearisedModel(self.model.varied(parameters, options), self.motion)
        varied.meet(self.events)
        return varied


def _rebuilt(kind: type[Model], origin: str | Path, case: Case, options: Mapping[str, Any]) -> Model:
    module = model_module(origin) if isinstance(origin, Path) else module_of(origin)
    return kind.from_setup(Setup.checked(module, case, options))
