"""Derivatives of quantities of an orbit, and of its multipliers, on one grid."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.contracts import Dependence
from solve.derivatives.figures import Figures, Starts
from solve.derivatives.multipliers import COALESCENCE, GridMultipliers
from solve.derivatives.orbit_sums import Adjoint, Forward, GridOrbit, WeightedSums, term_sizes
from solve.derivatives.periodic_problem import PeriodicProblem
from solve.equations import derivatives_of, output_values
from solve.errors import NoDerivativeError, ValueOutOfBoundsError
from solve.kernel.engines import COMPILED
from solve.kernel.formulas import columns_by
from solve.labels import SPEED
from solve.methods.collocated import Collocated
from solve.methods.free import mean_weights
from solve.period.curve import Curve
from solve.period.grid import Grid
from solve.period.named import EXPONENT, RADIUS, Named
from solve.period.points import SinglePoint
from solve.period.signals import samples_a_step
from solve.results.stability import Stability

_JUMP = 1e-9
"""Jump of an output, relative to its largest value, above which the output counts as discontinuous. Chosen by
judgement."""

_STEP = 1e-5
"""Relative step of a parameter in central differences of the inertia weights. The differences have errors of
about 1e-10."""


def dependence_of(solved: Stability, names: Sequence[str]) -> Dependence:
    """Dependence of the equations on the named parameters or on "speed". It is evaluated with the engine of
    the solution."""
    return derivatives_of(solved.system).by(names, columns_by(solved.certified.request.engine))


@dataclass(frozen=True, eq=False)
class GridDerivatives:
    """Derivatives on one grid with respect to the quantities `names`.

    adjoint: whether derivatives of the orbit are computed by adjoint problems. starts: see `Figures`."""

    solved: Stability
    rule: Collocated
    steps: int
    dependence: Dependence
    names: Sequence[str]
    adjoint: bool = False
    starts: Starts = field(default_factory=dict)

    @cached_property
    def problem(self) -> PeriodicProblem:
        """Linear periodic problem of the orbit or, for a free machine, of the anchored system."""
        system, engine = self.solved.system, self.solved.certified.request.engine
        grid = Grid.uniform(self.steps, system.period, system.breaks)
        point = SinglePoint(system, self.solved.speed)
        free = self.solved.certified.solutions.free
        known = None if free is not None else self._curve(grid, point, engine)
        return PeriodicProblem(point, self.rule, grid, engine, known, free)

    @cached_property
    def _original(self) -> PeriodicProblem:
        """Linear periodic problem without anchoring. The product of its one-step maps has all multipliers."""
        problem = self.problem
        if problem.free is None:
            return problem
        return PeriodicProblem(problem.point, self.rule, problem.grid, self.solved.certified.request.engine)

    def _curve(self, grid: Grid, point: SinglePoint, engine: str) -> Curve | None:
        """Periodic solution on a grid, if it is known or inexpensive to compute; otherwise None."""
        solutions = self.solved.certified.solutions
        # With jumps, a grid of as many steps may have other nodes, because numbers of steps are rounded.
        same_nodes = isinstance(solutions.curve, Curve) and np.array_equal(solutions.curve.nodes, grid.nodes)
        if not same_nodes or self.rule != self.solved.certified.method:
            if engine != COMPILED:
                return None
            solutions = self.rule.solutions(point, grid, True, engine)
        return solutions.curve[0] if isinstance(solutions.curve, Curve) and not solutions.failures else None

    @cached_property
    def orbit(self) -> GridOrbit:
        """Periodic orbit on this grid."""
        finest = self.solved.steps * samples_a_step(self.solved.steps)
        samples = finest * self.steps // self.solved.steps
        if self.rule != self.solved.certified.method:
            # With twice as many samples, the difference between grids includes the sampling error of sums.
            samples *= 2
        return GridOrbit(self.solved.system, self.solved.speed, self.problem, samples)

    @cached_property
    def forward(self) -> Forward:
        """Derivatives of the orbit."""
        return Forward(self.orbit, self.dependence, self.nodes, self._level)

    @cached_property
    def _level(self) -> Array | None:
        """Derivatives (modes, r) of the mean motion along rigid-body modes; None if there are no such modes.

        The mean with inertia weights is zero, but the weights depend on the parameters."""
        free, mean = self.problem.free, self.problem.curve.mean
        if free is None:
            return None
        system, speed = self.solved.system, self.solved.speed

        def weights(name: str, value: float) -> Array:
            try:
                at = (system, value) if name == SPEED else (system.varied({name: value}), speed)
                return mean_weights(SinglePoint(*at), free.modes)
            except ValueOutOfBoundsError:
                return mean_weights(SinglePoint(system, speed), free.modes)

        values = [speed if name == SPEED else system.labels.parameters[name] for name in self.names]
        levels = np.zeros((free.modes.references.shape[1], len(values)))
        for at, (name, value) in enumerate(zip(self.names, values, strict=True)):
            step = _STEP * (abs(value) or 1.0)
            before, after = (weights(name, value + side * step) for side in (-1, 1))
            levels[:, at] = -(after - before) @ mean / (2 * step)
        return levels

    @cached_property
    def nodes(self) -> Array:
        """Derivatives (m, r) of the starts of steps with respect to the quantities."""
        system = self.solved.system
        return self.problem.at_nodes(system.breaks, derivatives_of(system).of_breaks(self.names))

    @cached_property
    def figures(self) -> Figures:
        """Statistics of the orbit on this grid."""
        return Figures(self.orbit, self.starts, self.nodes)

    @cached_property
    def _multipliers(self) -> GridMultipliers:
        return GridMultipliers(self._original, self.solved.spectrum)

    def log_multiplier_derivatives(self, at: int, modulus: bool, sizes: bool = False) -> Array:
        """Derivatives (r,) of log ρ, or of log |ρ| if `modulus` is true, for the multiplier with index `at`.

        If `sizes` is true, return instead, for each derivative, the estimated size of the terms of its sum.
        """
        problem, multipliers = self.problem, self._multipliers
        n, phases = problem.point.n, problem.phases[:, problem.stages].ravel()
        vectors = multipliers.vectors(at)
        states, by_orbit = np.zeros((len(phases), 3, n)), None
        if not self.dependence.linear:
            states = problem.orbit.states[:, problem.stages, ..., 0].reshape(states.shape)
            by_orbit = self.forward.motions.states[:, problem.stages].reshape(-1, len(self.names))
        slopes, term = np.zeros(len(self.names), dtype=complex), np.abs if sizes else np.asarray
        for node in np.flatnonzero(self.nodes.any(axis=1)).tolist():
            slopes += term(multipliers.by_node(vectors, node) * self.nodes[node])
        along = partial(self.dependence.matrices, phases, self.solved.speed, states)
        for unit, weights in multipliers.weights(vectors, modulus and not sizes):
            weights = weights.reshape(-1, 3, n, n)
            by, by_states = along(weights)
            slopes += term(unit) * (term_sizes(lambda signed: along(signed)[0], weights) if sizes else by)
            if by_orbit is not None:
                slopes += term(unit) * (term(by_states.ravel()) @ term(by_orbit))
        return slopes

    def jumps(self, name: str) -> Array:
        """Return a mask (r,) of the quantities θ that move a jump of the output `name`."""
        system, speed = self.solved.system, self.solved.speed
        nodes = np.flatnonzero(self.nodes.any(axis=1))
        if name not in system.outputs or not len(nodes):
            return np.zeros(len(self.names), dtype=bool)
        rates, values = speed ** np.array([2.0, 1.0, 0.0])[:, None], []
        for at, place in ((nodes, 0), (nodes - 1, -1)):
            a, v, q = np.moveaxis(self.problem.orbit.states[at, place, ..., 0] * rates, 1, 0)
            phases = self.problem.phases[at, place]
            values.append(output_values(system, phases, speed, q.T, v.T, a.T)[name])
        jumps = np.abs(values[0] - values[1]) > _JUMP * np.abs(values).max()
        return (self.nodes[nodes[jumps]] != 0).any(axis=0)

    def slopes(self, quantities: Sequence[Named], sizes: bool = False) -> list[Array | NoDerivativeError]:
        """For each of `quantities`, return the derivatives (r,), or the reason why they do not exist.

        If `sizes` is true, return instead, for each derivative, the estimated size of the terms of its sum.
        """
        derivatives: list[Any] = []
        of_orbit = [quantity for quantity in quantities if quantity.of_orbit]
        if of_orbit:
            self.figures.find_extrema(of_orbit)
        for each in quantities:
            try:
                derivatives.append(
                    self.figures.sums(each) if each.of_orbit else self._of_multiplier(each, sizes)
                )
            except NoDerivativeError as reason:
                derivatives.append(reason)
        at = [place for place, each in enumerate(derivatives) if isinstance(each, WeightedSums)]
        if at:
            adjoint = self.adjoint and not self.nodes.any()
            solver = Adjoint(self.orbit, self.dependence) if adjoint else self.forward
            for place, slopes in zip(
                at, solver.derivatives_of([derivatives[k] for k in at], sizes), strict=True
            ):
                derivatives[place] = np.where(self.jumps(quantities[place].subject), np.nan, slopes)
        return derivatives

    def _of_multiplier(self, quantity: Named, sizes: bool) -> Array:
        """Derivatives (r,) of a quantity that depends on a multiplier. Raises NoDerivativeError.

        If `sizes` is true, return instead, for each derivative, the estimated size of the terms of its sum.
        """
        at = multiplier_position(self.solved, quantity)
        _require_simple(self.solved, at, quantity)
        modulus = quantity.subject == RADIUS or quantity.figure == "abs"
        slopes, rho = self.log_multiplier_derivatives(at, modulus, sizes), self.solved.spectrum.multiplier(at)
        if sizes:
            return np.real(slopes) * (1 / self.solved.period if quantity.subject == EXPONENT else abs(rho))
        if quantity.subject == EXPONENT:
            # λ = log ρ Ω / P, where P is the period in phase.
            logarithm = self.solved.spectrum.logarithm(at) / self.solved.speed
            along = np.array([name == SPEED for name in self.names])
            return quantity.part((slopes + logarithm * along) / self.solved.period)
        if modulus:
            return abs(rho) * np.real(slopes)
        return quantity.part(rho * slopes)


def multiplier_position(solved: Stability, quantity: Named) -> int:
    """Index of the multiplier on which a quantity depends. For the spectral radius, it is the first
    multiplier that does not belong to a rigid-body mode."""
    if quantity.number:
        return quantity.number - 1
    others = np.flatnonzero(~solved.spectrum.rigid)
    return int(others[0]) if len(others) else 0


def _multipliers(solved: Stability, at: int) -> Array:
    """The leading multipliers or, if they do not include index `at`, all multipliers."""
    leading = solved.spectrum.leading
    return leading if at < len(leading) else solved.multipliers


def _require_simple(solved: Stability, at: int, quantity: Named) -> None:
    """Raise NoDerivativeError for a multiplier that is unresolved, belongs to a rigid-body mode, or is
    multiple."""
    if solved.spectrum.rigid[at]:
        raise NoDerivativeError(
            f"{quantity.text} belongs to a rigid-body mode, whose multiplier is +1 for all parameters; "
            "request other multipliers"
        )
    multipliers = _multipliers(solved, at)
    rho = complex(multipliers[at])
    if at >= len(solved.spectrum.leading) and not solved.multiplier_errors[at] < 1:
        raise NoDerivativeError(
            f"{quantity.text} is not accurate to even one digit with {solved.steps} steps, so it "
            "has no derivative"
        )
    distance = np.delete(np.abs(multipliers - rho), at)
    if distance.min(initial=np.inf) <= COALESCENCE * abs(rho):
        raise NoDerivativeError(
            f"{quantity.text} has no derivative: another multiplier lies at a relative distance of "
            f"only {distance.min() / abs(rho):.1e}"
        )
    rivals = np.abs(np.abs(multipliers) - abs(rho)) <= COALESCENCE * abs(rho)
    rivals &= ~solved.spectrum.rigid[: len(multipliers)]
    if quantity.subject == RADIUS and (rivals & (multipliers != rho) & (multipliers != np.conj(rho))).any():
        raise NoDerivativeError(
            f"{quantity.text} has no derivative: two multipliers have the same modulus; request rho1.abs and "
            "rho2.abs"
        )
