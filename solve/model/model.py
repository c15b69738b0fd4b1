"""A periodic system whose matrices, outputs and bounds come from a generated module."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from solve.argument import first_is
from solve.arrays import Array, Plane
from solve.contracts import Columns, Dependence, Formulas, Marcher, Matrices, Motion
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.labels import SPEED, require_vibration
from solve.model.bounds import checked_parameters, clauses, holds, measured
from solve.model.cases import Case
from solve.model.checks import require_no_jump, require_sound, sound_at_all_speeds
from solve.model.damping import DampedSampler, beyond_critical, damped_residual
from solve.model.generated import model_module, module_of
from solve.model.many_points import ModelPoints, by_the_phase
from solve.model.sampling import MatrixSampler, Sampler, parted, tangent
from solve.model.setup import Setup
from solve.model.sketches import stated_lines
from solve.model.smooth import SmoothParameters
from solve.statistics import Limit, Statistics
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import casadi

    from solve.model.dependence import GeneratedSlopes


class Model(PeriodicSystem):
    """A system whose matrices, outputs and bounds come from a generated module."""

    def __init__(
        self,
        setup: Setup,
        matrices: Callable[[Array, float], Sequence[Array]],
        coordinates: Sequence[tuple[str, str, str]],
    ):
        """coordinates: name, unit and meaning of each."""
        module = setup.module
        super().__init__(matrices, [name for name, *_ in coordinates], module.PERIOD, setup.breaks)
        self.setup, self.module = setup, module
        self._formulas: dict[tuple[str, ...], Formulas | None] = {}
        self._slopes: dict[tuple[tuple[str, ...], bool], GeneratedSlopes] = {}
        self.name, self.title, self.model_hash = module.NAME, module.TITLE, module.FILE_SHA256
        self.case, self.case_speed, self.parameters = setup.case.name, setup.case.speed, setup.case.parameters
        self.parameter_sources = setup.case.sources
        self.equations = getattr(module, "EQUATIONS", (getattr(module, "NO_EQUATIONS", ""),))
        self.options = setup.options
        self.sketch_unit = next((unit for _, unit, _ in getattr(module, "SKETCH", ())), self.sketch_unit)
        self.parameter_labels = {name: (unit, meaning) for name, unit, meaning, _ in module.PARAMETERS}
        self.outputs = tuple(name for name, *_ in module.OUTPUTS)
        self.fits = setup.case.fits
        fitted = (fit.sentence for fit in self.fits.values())
        self.equation_warnings = (*self.left_out, *fitted)
        self.units = {name: unit for name, unit, _ in (*coordinates, *module.OUTPUTS)}
        self.meanings = {name: meaning for name, _, meaning in (*coordinates, *module.OUTPUTS)}
        self.validity = {name: module.VALIDITY[name] for name in self.coordinates if name in module.VALIDITY}

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """The model of a setup."""
        given = setup.function("linearised"), setup.p
        sampler = MatrixSampler(*given) if setup.ratios is None else DampedSampler(*given, setup.ratios)
        return cls(setup, sampler, setup.module.COORDINATES[: sampler.n])

    def _repr_html_(self) -> str:
        """Title and linearised equations, in a notebook."""
        return "".join(f"<p>{each}</p>" for each in (escape(self.title), *self.equations))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles are built anew: CasADi's memory serves one thread of one process."""
        origin = getattr(self.module, "CODE", None) or Path(self.module.__file__ or "")
        made_from = type(self), origin, self.setup.case, self.options
        return _rebuilt, made_from, {"speed_unit": self.speed_unit}

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> Self:
        """The same model with some parameters (SI units) and options changed. Raises UnknownNameError and
        ValueOutOfBoundsError."""
        made = self.of(self.setup.varied(parameters or {}, options or {}))
        made.speed_unit = self.speed_unit
        if not options:
            made._slopes = self._slopes
        return made

    def require_bounds(self, parameters: Mapping[str, float]) -> None:
        checked_parameters(self.module, {**self.parameters, **parameters})

    def entries(self, phase: Array, speed: float) -> Array:
        if not isinstance(self._matrices, MatrixSampler):
            return super().entries(phase, speed)
        found = self.entries_over(phase, np.array([speed]))[0]
        # The ordinary way says what is wrong.
        return found if np.isfinite(found).all() else super().entries(phase, speed)

    def terms(self, phase: Array, speeds: Array) -> tuple[Array, Array, Array] | None:
        found = self._matrices.terms(phase) if isinstance(self._matrices, MatrixSampler) else None
        if found is None:
            return None
        table, entry, power = found
        return table, speeds[:, None] ** power, entry

    def entries_over(self, phase: Array, speeds: Array) -> Array:
        sampler = self._matrices
        if not isinstance(sampler, MatrixSampler):
            return super().entries_over(phase, speeds)
        found = by_the_phase(sampler.entries(phase, speeds), speeds, self.n)
        found[~self.setup.exist(speeds)] = np.nan
        return found

    def require_desired_motion(self, speeds: Array) -> None:
        if len(missing := speeds[~self.setup.exist(speeds)]) and self.setup.domain:
            self.setup.domain.require(float(missing[0]), self.speed_unit.text(float(missing[0])))

    def many_points(self, names: Sequence[str]) -> ModelPoints | None:
        return ModelPoints(self.setup, self.n, names)

    def checked(self, speed: float) -> None:
        """Checks in addition to those of any system: the fundamental motion exists, generated matrices are
        periodic and jump at the breaks alone, and M is positive definite. Raises DesiredMotionError,
        MatricesError."""
        self.shown_in(speed).require_desired_motion(np.array([speed]))
        if not self._sound:
            require_no_jump(self, speed)
            super().checked(speed)
            require_sound(self, speed)

    @cached_property
    def _sound(self) -> bool:
        """Whether the matrices pass all checks at every speed."""
        return isinstance(self._matrices, MatrixSampler) and sound_at_all_speeds(self, self._matrices)

    def field(self, name: str, position: Array | float) -> Array:
        """Mode functions of a deflection at fractions (k,) of its link's length: (k, n).

        Times the coordinates it is the deflection there: `model.field("w", [0.25, 0.5]) @ orbit.q`.
        Raises UnknownNameError and ValueOutOfBoundsError.
        """
        known = [field for field, *_ in getattr(self.module, "FIELDS", ())]
        if name not in known:
            raise UnknownNameError(f"field of {self.name}", name, known)
        fraction = np.asarray(position, dtype=float)
        if not ((fraction >= 0) & (fraction <= 1)).all():
            raise ValueOutOfBoundsError(f"position is {position}; allowed: fractions of the length, 0 to 1")
        shapes = self.setup.function("fields").map(fraction.size)(fraction.reshape(1, -1))
        return shapes.full().T.reshape(*fraction.shape, self.n)

    def sketched(self, phase: Array, speed: float, q: Array) -> Mapping[str, Plane]:
        return stated_lines(self.setup, phase, speed, q) or super().sketched(phase, speed, q)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the linearised equations do not know of the nonlinear ones, a sentence each."""
        return getattr(self.module, "NONLINEAR", ())

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        ratios = self.setup.ratios
        too_large = [] if ratios is None or ratios.max() <= 1 else [beyond_critical(ratios.max())]
        every = [*super().warnings(speed), *too_large]
        return every if linear else [text for text in every if text not in self.left_out]

    @property
    def nonlinear(self) -> bool:
        return hasattr(self.module, "residual")

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        return ModelAlong(self, motion, compiled) if self.nonlinear else super().along(motion)

    @cached_property
    def _smooth(self) -> SmoothParameters:
        return SmoothParameters(self.setup, self.assembled)

    @property
    def smooth_parameters(self) -> tuple[str, ...]:
        return self._smooth.names

    @property
    def moves_breaks(self) -> bool:
        return self.setup.moves_breaks

    def break_slopes(self, names: Sequence[str]) -> Array:
        return self._smooth.break_slopes(names)

    def dependence(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        return self._dependence(names, compiled, False)

    def _dependence(self, names: Sequence[str], compiled: Columns | None, nonlinear: bool) -> Dependence:
        from solve.model.dependence import AssembledDependence, DampedDependence, GeneratedDependence

        self._smooth.require(names)
        damped = isinstance(self._matrices, DampedSampler)
        if self.assembled and not damped:
            return AssembledDependence(self, names)
        # One text for the compiler, whatever is asked for.
        every = tuple(names) if compiled is None else (*self.smooth_parameters, SPEED)
        slopes = self._slopes_by(every, nonlinear)
        if compiled is not None and not slopes.residual.text:
            slopes, compiled = self._slopes_by(tuple(names), nonlinear), None
        given = slopes, self.setup, self.n, names, compiled
        return DampedDependence(*given, self._damping_with) if damped else GeneratedDependence(*given)

    def _damping_with(self, parameters: Mapping[str, float], phase: Array) -> Array:
        """Modal damping (k, n, n) at phases (k,) with some parameters changed."""
        sampler = self.varied(parameters)._matrices
        assert isinstance(sampler, DampedSampler)
        return sampler.damping(phase)

    def _slopes_by(self, names: tuple[str, ...], nonlinear: bool) -> "GeneratedSlopes":
        from solve.model.dependence import GeneratedSlopes

        key = names, nonlinear
        if key not in self._slopes:
            self._slopes[key] = GeneratedSlopes(self.setup, self.n, names, nonlinear)
        return self._slopes[key]

    @property
    def assembled(self) -> bool:
        """Whether no formulas give the matrices: modal damping follows from their eigenvalues."""
        return self.setup.ratios is not None

    def marcher(self, sizes: Array, count: int, rtol: float) -> Marcher:
        if not self.nonlinear:
            return super().marcher(sizes, count, rtol)
        from solve.model.marching import ModelMarcher

        residual = self.setup.function("residual_varying")
        if isinstance(self._matrices, DampedSampler):
            residual = damped_residual(residual, self._matrices.damping, self.period)
        return ModelMarcher(residual, self.setup.p, self.module.PERIOD, sizes, count, rtol)

    def varying(self, phase: Array, speed: Array, acceleration: float) -> Matrices:
        still = np.zeros((3, len(phase), self.n))
        return self.with_damping(
            phase, self._varying(phase, speed, np.full(len(phase), acceleration), *still)
        )

    def with_damping(self, phase: Array, entries: Array) -> Matrices:
        """M, C, K and d of entries (k, 3n² + n) by rows at phases (k,), with the damping of ratios in C. It
        takes no part in d along a motion, where it stands in C q̇ as well as in the residual."""
        M, C, K, d = parted(entries, self.n)
        sampler = self._matrices
        return M, C + sampler.damping(phase) if isinstance(sampler, DampedSampler) else C, K, d

    @cached_property
    def _varying(self) -> Sampler:
        return Sampler(tangent(self.setup.function("residual_varying"), self.setup.p))

    @cached_property
    def tangent(self) -> Sampler:
        """M, C, K by rows and d of `along`, at phases, speeds and states q, qd, qdd (k, n)."""
        return Sampler(tangent(self.setup.function("residual"), self.setup.p))

    @cached_property
    def tangent_formulas(self) -> Formulas | None:
        """The same as C text; None where there is none."""
        return self.setup.formulas("residual", (), tangent)

    @cached_property
    def _outputs(self) -> "casadi.Function":
        return self.setup.function("outputs")

    @cached_property
    def _outputs_varying(self) -> "casadi.Function":
        return self.setup.function("outputs_varying")

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        if not self.outputs:
            return {}
        drive, state = (phase[None], np.atleast_2d(speed)), (q, qd, qdd, self.setup.p)
        if acceleration == 0:
            values = self._outputs.call([*drive, *state])
        else:
            values = self._outputs_varying.call([*drive, acceleration, *state])
        return {name: value.full()[0] for name, value in zip(self.outputs, values, strict=True)}

    def output_formulas(self, varied: Sequence[str] = ()) -> Formulas | None:
        names = tuple(sorted(varied))
        if names not in self._formulas:
            generated = self.outputs and hasattr(self.module, "outputs")
            self._formulas[names] = self.setup.formulas("outputs", names) if generated else None
        return self._formulas[names]

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.validity, *(name for name, *_ in self.module.LIMITS))))

    def limits(self, quantities: Iterable[str], linear: bool = True) -> list[Limit]:
        known = list(quantities)
        stated = [(name, bound, meaning) for name, bound, meaning in self.module.LIMITS if name in known]
        trusted = [(name, bound) for name, bound in self.validity.items() if linear and name in known]
        return [
            *super().limits(known, linear),
            *(_validity(name, bound, self.units[name]) for name, bound in trusted),
            *(
                _bound(name, meaning, self.units[name], clause)
                for name, bound, meaning in stated
                for clause in clauses(bound)
            ),
        ]


def _validity(name: str, bound: float, unit: str) -> Limit:
    """Beyond which the linearisation is not to be trusted."""

    def says(found: Statistics) -> str:
        reached = f"max|{name}| = {found.max_abs:.3g} {unit}, beyond {bound:g}"
        return f"the linearisation is not to be trusted: {reached}"

    return Limit(name, lambda found: found.max_abs > bound, says)


def _bound(name: str, meaning: str, unit: str, clause: str) -> Limit:
    """A clause of a bound that a generated module states."""

    def extreme(found: Statistics) -> Any:
        return found.min if clause.startswith(">") else found.max

    def left(found: Statistics) -> Any:
        return ~np.isnan(extreme(found)) & ~np.asarray(holds(clause, extreme(found)))

    def says(found: Statistics) -> str:
        return f"{meaning}: {name} reaches {measured(extreme(found), unit, 3)}, bound {clause}"

    return Limit(name, left, says)


of_model = first_is(Model, such_as="solve.load('cam')", demand=require_vibration)
"""Decorator of public functions that require a vibrating model."""


class ModelAlong(Model):
    """Model linearised along a motion, see `PeriodicSystem.along`. The bounds of validity of the
    linearisation about the fundamental motion, and the terms it omits, do not apply."""

    @property
    def left_out(self) -> tuple[str, ...]:
        return ()

    def __init__(self, model: Model, motion: Motion, compiled: Columns | None = None):
        super().__init__(model.setup, self._along, model.module.COORDINATES[: model.n])
        self.model, self.motion, self._compiled = model, motion, compiled
        turns = np.arange(round(motion.nodes[-1] / model.period)) * model.period
        self.breaks = tuple((turns[:, None] + np.array(model.breaks)).ravel().tolist())
        self.period, self.validity = float(motion.nodes[-1]), {}
        self.speed_unit = model.speed_unit

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.model, self.motion)

    def _along(self, phase: Array, speed: float) -> Matrices:
        return self.model.with_damping(phase, self._tangent(phase, speed).T)

    def _tangent(self, phase: Array, speed: float) -> Array:
        """M, C, K by rows and d (3n² + n, k) at phases (k,), but for the damping of ratios."""
        self.model.require_desired_motion(np.array([speed]))
        speeds, states = np.full(len(phase), speed), self._motion_states(phase, speed)
        formulas, found = self.model.tangent_formulas if self._compiled else None, None
        if self._compiled and formulas:
            found = self._compiled(formulas, (phase[None], speeds[None], *states))
        if found is None:
            found = self.model.tangent(phase, speeds, *(state.T for state in states)).T
        return found

    def _motion_states(self, phase: Array, speed: float) -> list[Array]:
        """q, q̇ and q̈ (n, k) of the motion."""
        of = getattr(self.motion, "states", None)
        motions = of(phase) if of else [self.motion(phase, derivative) for derivative in range(3)]
        return [speed**derivative * part for derivative, part in enumerate(motions)]

    def roundoff(self, phase: Array, speed: float) -> Array:
        states = (state.T for state in self._motion_states(phase, speed))
        return self.model.setup.residual_roundoff(phase, np.full(len(phase), speed), *states, self.setup.p)

    def entries(self, phase: Array, speed: float) -> Array:
        if self.model.assembled:
            return super().entries(phase, speed)
        made = by_the_phase(self._tangent(phase, speed).T[None], np.array([speed]), self.n)[0]
        # The ordinary way says what is wrong.
        return made if np.isfinite(made).all() else super().entries(phase, speed)

    def along(self, motion: Motion, compiled: Columns | None = None) -> PeriodicSystem:
        return self.model.along(motion, compiled)

    def break_slopes(self, names: Sequence[str]) -> Array:
        return np.tile(self.model.break_slopes(names), (round(self.period / self.model.period), 1))

    def dependence(self, names: Sequence[str], compiled: Columns | None = None) -> Dependence:
        return self.model._dependence(names, compiled, nonlinear=True)

    def varied(
        self, parameters: Mapping[str, float] | None = None, options: Mapping[str, Any] | None = None
    ) -> "ModelAlong":
        return ModelAlong(self.model.varied(parameters, options), self.motion)

    def many_points(self, names: Sequence[str]) -> None:
        return None


def _rebuilt(kind: type[Model], origin: str | Path, case: Case, options: Mapping[str, Any]) -> Model:
    module = model_module(origin) if isinstance(origin, Path) else module_of(origin)
    return kind.of(Setup.checked(module, case, options))
