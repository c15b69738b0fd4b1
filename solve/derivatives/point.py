"""Sensitivities of one point: derivatives of quantities of an orbit, or of its stability, on the grid that
solved it, with errors estimated from one stage more."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, cast

import numpy as np

from solve.arguments import unique_names
from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.figures import Figures, Starts
from solve.derivatives.multipliers import MEET, MultipliersOnGrid
from solve.derivatives.sums import Adjoint, Forward, OrbitOnGrid, Sums, scattered
from solve.derivatives.turn import TurnOnGrid
from solve.errors import NoDerivativeError, ValueOutOfBoundsError
from solve.kernel.engines import COMPILED
from solve.kernel.formulas import columns_by
from solve.labels import SPEED
from solve.methods.choice import Rule
from solve.methods.collocation import Collocated
from solve.methods.free import mean_weights
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.named import EXPONENT, RADIUS, Named, Solved
from solve.period.points import OnePoint
from solve.period.quantities import samples_a_step
from solve.results.nonlinear import NonlinearOrbit
from solve.results.sensitivities import Sensitivities, Sensitivity
from solve.results.stability import Stability
from solve.single import floquet, periodic
from solve.system import PeriodicSystem, derivatives_of, of_system
from solve.threads import one_thread

_SAFETY = 2.0
"""Factor on the difference of derivatives to those with one stage more, as of solutions."""

_COARSER = 4
"""Fraction of the steps that show the sizes of the terms of which derivatives are sums."""

_A_FIGURE = 2
"""Parameters whose columns cost as much as the adjoint problem of a figure."""

_JUMP = 1e-9
"""Part of an output beyond which it jumps."""

_STEP = 1e-5
"""Relative step of a parameter for finite differences of the inertia weights."""

_ROUNDING = 1e-13
"""Part of the terms of which a derivative is a sum that rounding leaves."""


@of_system
def sensitivities(
    system: PeriodicSystem,
    speed: float | str,
    of: Sequence[str] | None = None,
    by: Sequence[str] | None = None,
    method: str | Rule = "auto",
    steps: int | None = None,
    rtol: float = 1e-8,
    engine: str = "auto",
    nonlinear: bool = False,
    periods: int | None = None,
) -> Sensitivities:
    """Derivatives of quantities of the periodic solution and of its stability at a speed (rad/s, or a text
    with unit), by parameters and the speed.

    of: quantities such as "q3.max_abs", "contact_force.harmonic5", "spectral_radius", "rho1" (complex),
    "rho1.abs", "exponent1.re"; by default max_abs of the coordinates and spectral_radius. by: names of
    parameters, "speed" among them; by default all by which there are derivatives. method (radau or gauss),
    steps, rtol, engine: as in `periodic`. nonlinear: of the orbit of the nonlinear equations, as
    `solve.nonlinear` finds it, over several periods, and of its multipliers. A quantity without a derivative,
    such as a multiplier that meets another, is NaN with the reason. Raises UnknownNameError,
    NoDerivativeError for systems without generated equations and for whole numbers, and what `periodic`
    raises.

    >>> import solve
    >>> found = sensitivities(solve.load("cam"), "600 rpm", of="q3.max_abs", by=["k1", "speed"])
    >>> round(found.elasticities("q3.max_abs")["k1"], 4)
    -2.6535
    """
    asked, names = quantities_by(system, of, by)
    given = system, speed
    settings: dict[str, Any] = {"method": method, "steps": steps, "rtol": rtol, "engine": engine}
    count = periods_of(nonlinear, periods)
    if nonlinear:
        solved = nonlinear_orbit(*given, periods=count, **settings)
    else:
        orbit = any(each.of_orbit for each in asked)
        solved = (periodic if orbit else floquet)(*given, **settings)
    return of_solution(solved, asked, names)


def periods_of(nonlinear: bool, periods: int | None) -> int:
    """How many periods an orbit has, 1 by default. Raises ValueOutOfBoundsError for several of a linear
    one."""
    if periods is not None and not nonlinear:
        raise ValueOutOfBoundsError(
            f"periods is {periods!r}, which is of nonlinear orbits; ask for nonlinear ones, or leave it out"
        )
    return 1 if periods is None else periods


def quantities_by(
    system: PeriodicSystem, of: Sequence[str] | None, by: Sequence[str] | None
) -> tuple[list[Named], list[str]]:
    """What is asked for, and by what, each once. Raises UnknownNameError, ValueOutOfBoundsError,
    NoDerivativeError."""
    texts, names = _different("of", of, _usual(system)), _different("by", by, _all(system))
    asked = [Named.of(system, text) for text in texts]
    derivatives_of(system).by(names)
    return asked, names


def of_solution(solved: Stability, asked: Sequence[Named], names: Sequence[str]) -> Sensitivities:
    """Of a solution that is known, an orbit where quantities need one. Raises ValueOutOfBoundsError for
    methods without stages."""
    rule, system, dependence = solved.certified.method, solved.system, dependence_of(solved, names)
    if not isinstance(rule, Collocated):
        raise ValueOutOfBoundsError(f"method is {rule.name}; sensitivities support radau, gauss and auto")
    free = solved.certified.solutions.free
    of_orbits = sum(each.of_orbit for each in asked)
    if free is not None and of_orbits and free.modes.conserving.any():
        raise NoDerivativeError(
            "orbit sensitivities are not available for a free machine with varying inertia or gyroscopic "
            "forces along its rigid-body mode; request sensitivities of multipliers, or add drag"
        )
    adjoint = dependence.partial_outputs and free is None and _A_FIGURE * of_orbits <= len(names)
    shared = dependence, names, adjoint, {}
    own, better = (OnGrid(solved, each, solved.steps, *shared) for each in (rule, rule.with_another_stage))
    coarse = OnGrid(solved, rule, max(1, solved.steps // _COARSER), *shared)
    with one_thread(system.n):
        slopes = list(zip(own.slopes(asked), better.slopes(asked), strict=True))
        found = _with_errors(asked, slopes, own, coarse)
    values = [solved.speed if name == SPEED else system.parameters[name] for name in names]
    by = dict(zip(names, values, strict=True))
    notes = [*solved.notes, *(solved.doubts if isinstance(solved, NonlinearOrbit) else [])]
    return Sensitivities(system, solved.speed, by, found, rule.name, solved.steps, notes)


def dependence_of(solved: Stability, names: Sequence[str]) -> Dependence:
    """On parameters, or "speed", with the engine that solved."""
    return derivatives_of(solved.system).by(names, columns_by(solved.certified.request.engine))


def _usual(system: PeriodicSystem) -> list[str]:
    return [*(f"{name}.max_abs" for name in system.coordinates), RADIUS]


def _all(system: PeriodicSystem) -> list[str]:
    return [*(system.derivatives.names if system.derivatives else ()), SPEED]


def _different(what: str, given: Sequence[str] | None, usual: Sequence[str]) -> list[str]:
    names = list(unique_names(usual if given is None else given))
    if not names:
        raise ValueOutOfBoundsError(f"{what} is empty; give names, or leave {what} out")
    return names


@dataclass(frozen=True, eq=False)
class OnGrid:
    """Derivatives on one grid. adjoint: whether orbit derivatives use adjoint problems; starts: see
    `Figures`."""

    solved: Stability
    rule: Collocated
    steps: int
    dependence: Dependence
    names: Sequence[str]
    adjoint: bool = False
    starts: Starts = field(default_factory=dict)

    @cached_property
    def turn(self) -> TurnOnGrid:
        system, engine = self.solved.system, self.solved.certified.request.engine
        grid = Grid.uniform(self.steps, system.period, system.breaks)
        point = OnePoint(system, self.solved.speed)
        free = self.solved.certified.solutions.free
        known = None if free is not None else self._curve(grid, point, engine)
        return TurnOnGrid(point, self.rule, grid, engine, known, free)

    @cached_property
    def _as_it_is(self) -> TurnOnGrid:
        """Derivatives of the original system of a free machine, not anchored: its one-step maps are those of
        all multipliers."""
        turn = self.turn
        if turn.free is None:
            return turn
        return TurnOnGrid(turn.point, self.rule, turn.grid, self.solved.certified.request.engine)

    def _curve(self, grid: Grid, point: OnePoint, engine: str) -> Curve | None:
        """The periodic solution on a grid, where it is known already, or quickly found."""
        solutions = self.solved.certified.solutions
        if self.steps != self.solved.steps or self.rule != self.solved.certified.method:
            if engine != COMPILED:
                return None
            solutions = self.rule.solutions(point, grid, True, engine)
        return solutions.curve[0] if isinstance(solutions.curve, Curve) and not solutions.failures else None

    @cached_property
    def orbit(self) -> OrbitOnGrid:
        finest = self.solved.steps * samples_a_step(self.solved.steps)
        samples = finest * self.steps // self.solved.steps
        if self.rule != self.solved.certified.method:
            # Sums over samples have an error of their own, which more samples show.
            samples *= 2
        return OrbitOnGrid(self.solved.system, self.solved.speed, self.turn, samples)

    @cached_property
    def forward(self) -> Forward:
        return Forward(self.orbit, self.dependence, self.nodes, self._level)

    @cached_property
    def _level(self) -> Array | None:
        """Derivatives of the means along rigid-body modes (modes, r). The inertia-weighted mean is zero, and
        its weights depend on the parameters."""
        free, mean = self.turn.free, self.turn.curve.mean
        if free is None:
            return None
        system, speed = self.solved.system, self.solved.speed

        def weights(name: str, value: float) -> Array:
            try:
                at = (system, value) if name == SPEED else (system.varied({name: value}), speed)
                return mean_weights(OnePoint(*at), free.modes)
            except ValueOutOfBoundsError:
                return mean_weights(OnePoint(system, speed), free.modes)

        values = [speed if name == SPEED else system.parameters[name] for name in self.names]
        found = np.zeros((free.modes.references.shape[1], len(values)))
        for at, (name, value) in enumerate(zip(self.names, values, strict=True)):
            step = _STEP * (abs(value) or 1.0)
            before, after = (weights(name, value + side * step) for side in (-1, 1))
            found[:, at] = -(after - before) @ mean / (2 * step)
        return found

    @cached_property
    def nodes(self) -> Array:
        """How far the starts of steps move with the quantities, (m, r)."""
        system = self.solved.system
        return self.turn.at_nodes(system.breaks, derivatives_of(system).of_breaks(self.names))

    @cached_property
    def figures(self) -> Figures:
        return Figures(self.orbit, self.starts, self.nodes)

    @cached_property
    def _multipliers(self) -> MultipliersOnGrid:
        return MultipliersOnGrid(self._as_it_is, self.solved.spectrum)

    def logarithm(self, at: int, modulus: bool, sizes: bool = False) -> Array:
        """Derivatives (r,) of log ρ of one of the solution's multipliers, or of log |ρ|; or the sizes of the
        terms of which they are sums."""
        turn, found = self.turn, self._multipliers
        n, phases = turn.point.n, turn.phases[:, turn.stages].ravel()
        vectors = found.vectors(at)
        states, moved = np.zeros((len(phases), 3, n)), None
        if not self.dependence.linear:
            states = turn.orbit.states[:, turn.stages, ..., 0].reshape(states.shape)
            moved = self.forward.moved.states[:, turn.stages].reshape(-1, len(self.names))
        slopes, term = np.zeros(len(self.names), dtype=complex), np.abs if sizes else np.asarray
        for node in np.flatnonzero(self.nodes.any(axis=1)).tolist():
            slopes += term(found.by_node(vectors, node) * self.nodes[node])
        along = partial(self.dependence.matrices, phases, self.solved.speed, states)
        for unit, weights in found.weights(vectors, modulus and not sizes):
            weights = weights.reshape(-1, 3, n, n)
            by, by_states = along(weights)
            slopes += term(unit) * (scattered(lambda each: along(each)[0], weights) if sizes else by)
            if moved is not None:
                slopes += term(unit) * (term(by_states.ravel()) @ term(moved))
        return slopes

    def jumps(self, name: str) -> Array:
        """Whether quantities (r,) move a jump of an output."""
        system, speed = self.solved.system, self.solved.speed
        nodes = np.flatnonzero(self.nodes.any(axis=1))
        if name not in system.outputs or not len(nodes):
            return np.zeros(len(self.names), dtype=bool)
        rates, values = speed ** np.array([2.0, 1.0, 0.0])[:, None], []
        for at, place in ((nodes, 0), (nodes - 1, -1)):
            a, v, q = np.moveaxis(self.turn.orbit.states[at, place, ..., 0] * rates, 1, 0)
            phases = self.turn.phases[at, place]
            values.append(system.output_values(phases, speed, q.T, v.T, a.T)[name])
        apart = np.abs(values[0] - values[1]) > _JUMP * np.abs(values).max()
        return (self.nodes[nodes[apart]] != 0).any(axis=0)

    def slopes(self, asked: Sequence[Named], sizes: bool = False) -> list[Array | NoDerivativeError]:
        """Of each quantity its derivatives (r,), or the sizes of the terms of which they are sums, or why it
        has none."""
        found: list[Any] = []
        of_orbit = [each for each in asked if each.of_orbit]
        if of_orbit:
            self.figures.settle(of_orbit)
        for each in asked:
            try:
                found.append(self.figures.sums(each) if each.of_orbit else self._of_multiplier(each, sizes))
            except NoDerivativeError as reason:
                found.append(reason)
        at = [place for place, each in enumerate(found) if isinstance(each, Sums)]
        if at:
            adjoint = self.adjoint and not self.nodes.any()
            way = Adjoint(self.orbit, self.dependence) if adjoint else self.forward
            for place, slopes in zip(at, way.of([found[k] for k in at], sizes), strict=True):
                found[place] = np.where(self.jumps(asked[place].subject), np.nan, slopes)
        return found

    def _of_multiplier(self, asked: Named, sizes: bool) -> Array:
        """Derivatives (r,) of a quantity of a multiplier, or the sizes of their terms. Raises
        NoDerivativeError."""
        at = _place(self.solved, asked)
        _require_alone(self.solved, at, asked)
        modulus = asked.subject == RADIUS or asked.figure == "abs"
        slopes, rho = self.logarithm(at, modulus, sizes), self.solved.spectrum.multiplier(at)
        if sizes:
            return np.real(slopes) * (1 / self.solved.period if asked.subject == EXPONENT else abs(rho))
        if asked.subject == EXPONENT:
            # λ = log ρ Ω / P, P the period in phase.
            logarithm = self.solved.spectrum.logarithm(at) / self.solved.speed
            along = np.array([name == SPEED for name in self.names])
            return asked.part((slopes + logarithm * along) / self.solved.period)
        if modulus:
            return abs(rho) * np.real(slopes)
        return asked.part(rho * slopes)


def _error_of_factor(solved: Stability, asked: Named) -> float:
    """Relative error of the multiplier that the derivative of its logarithm is multiplied by, which is the
    solution's with every number of stages; 0 where there is none."""
    if asked.of_orbit or asked.subject == EXPONENT:
        return 0.0
    at = _place(solved, asked)
    leading = solved.spectrum.leading
    if at < len(leading):
        return float(solved.certified.absolute[0] / np.abs(leading[at]))
    return float(solved.multiplier_errors[at])


def _place(solved: Stability, asked: Named) -> int:
    """Index of the multiplier in question; for the spectral radius the largest one without rigid-body
    modes."""
    if asked.number:
        return asked.number - 1
    others = np.flatnonzero(~solved.spectrum.rigid)
    return int(others[0]) if len(others) else 0


def _every(solved: Stability, at: int) -> Array:
    """Multipliers, all of them unless the largest are enough."""
    leading = solved.spectrum.leading
    return leading if at < len(leading) else solved.multipliers


def _require_alone(solved: Stability, at: int, asked: Named) -> None:
    """Raise NoDerivativeError for a multiplier that is not known, or meets another."""
    if solved.spectrum.rigid[at]:
        raise NoDerivativeError(
            f"{asked.text} is of a rigid-body mode: its multiplier is +1 whatever the parameters"
        )
    every = _every(solved, at)
    rho = complex(every[at])
    if at >= len(solved.spectrum.leading) and not solved.multiplier_errors[at] < 1:
        raise NoDerivativeError(f"{asked.text} has no digit on {solved.steps} steps, and so no derivative")
    distance = np.delete(np.abs(every - rho), at)
    if distance.min(initial=np.inf) <= MEET * abs(rho):
        raise NoDerivativeError(
            f"{asked.text} has no derivative: the multiplier meets another, apart by "
            f"{distance.min() / abs(rho):.1e} of itself"
        )
    rivals = np.abs(np.abs(every) - abs(rho)) <= MEET * abs(rho)
    rivals &= ~solved.spectrum.rigid[: len(every)]
    if asked.subject == RADIUS and (rivals & (every != rho) & (every != np.conj(rho))).any():
        raise NoDerivativeError(
            f"{asked.text} has no derivative: two multipliers have the same modulus; ask for rho1.abs and "
            "rho2.abs"
        )


Slopes = tuple[Array | NoDerivativeError, ...]


def _with_errors(
    asked: Sequence[Named], slopes: Sequence[Sequence[Array | NoDerivativeError]], own: OnGrid, coarse: OnGrid
) -> dict[str, Sensitivity]:
    """From the derivatives by the method and with one stage more, those of each quantity with errors. What
    rounding leaves is estimated on a coarse grid."""
    sizes = coarse.slopes(asked, sizes=True)
    whys = [next((str(why) for why in each if isinstance(why, NoDerivativeError)), "") for each in slopes]
    whys = [
        why or (str(size) if isinstance(size, NoDerivativeError) else "")
        for why, size in zip(whys, sizes, strict=True)
    ]
    errors = {}
    for at, why in enumerate(whys):
        if not why:
            found, better = map(np.asarray, slopes[at])
            made = _SAFETY * np.abs(found - better) + _error_of_factor(own.solved, asked[at]) * np.abs(found)
            errors[at] = np.maximum(made, _ROUNDING * np.asarray(sizes[at]))
    return {
        each.text: _sensitivity(each, np.asarray(slopes[at][0]), errors[at], own)
        if at in errors
        else _without(each, whys[at], own)
        for at, each in enumerate(asked)
    }


def _without(asked: Named, reason: str, own: OnGrid) -> Sensitivity:
    """A quantity without derivatives."""
    nothing = np.full(len(own.names), np.nan)
    return Sensitivity(asked.value(cast(Solved, own.solved)), asked.unit, nothing, nothing, reason)


def _sensitivity(asked: Named, fine: Array, errors: Array, own: OnGrid) -> Sensitivity:
    """Of a quantity with derivatives, or with none by some parameters and the reason."""
    moved = own.jumps(asked.subject)
    whys = {
        "several extrema are equally large, and change differently": np.isnan(fine) & ~moved,
        f"{asked.subject} jumps where they move, which the sums over its samples do not see": moved,
    }
    reason = "; ".join(
        f"{asked.text} has no derivative by {', '.join(np.array(own.names)[at])}: {why}"
        for why, at in whys.items()
        if at.any()
    )
    return Sensitivity(asked.value(cast(Solved, own.solved)), asked.unit, fine, errors, reason)
