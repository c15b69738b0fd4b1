"""Riccati equations of regulators and filters, from weights and noise intensities; and curves of the
gains."""

from collections.abc import Callable, Mapping

import numpy as np

from solve.arrays import Array, symmetric_of
from solve.errors import MissingValueError
from solve.first_order import FirstOrderSystem
from solve.period.curve import Curve
from solve.single import periodic
from solve.studies.control.plant import Plant
from solve.studies.control.riccati import Riccati, Solved, solve_riccati, through_points
from solve.studies.control.weights import Weight, matrix_function, named_numbers
from solve.system import PeriodicSystem, relabelled
from solve.threads import one_thread

Function = Callable[[Array], Array]


def regulator(
    plant: Plant, Q: Weight, R: Weight, rtol: float, feedforward: bool
) -> tuple[Solved, Curve, Curve | None]:
    """Return the solution X of the regulator's Riccati equation, the curve of the gain K, and the curve of
    the feedforward if it is requested."""
    weight, inputs = _state_weight(plant, Q), plant.system.inputs
    if isinstance(R, Mapping):
        numbers = named_numbers("R", R, inputs, positive=True)
        if missing := [name for name in inputs if name not in numbers]:
            raise MissingValueError(f"R has no number for the input {missing[0]}; give one for every input")
        R = np.diag([numbers[name] for name in inputs])
    cost = matrix_function("R", R, len(inputs), plant.system, definite=True)

    def coefficients(phase: Array) -> tuple[Array, Array, Array]:
        A, B, _ = plant.dynamics(phase)
        return A, _factor(B, cost(phase)), weight(phase)

    solved = _solved(plant, coefficients, rtol)

    def gain(phase: Array) -> Array:
        B = plant.input_matrix(phase)
        return _inverse(cost(phase)) @ np.swapaxes(B, 1, 2) @ symmetric_of(solved.curve(phase))

    gains = through_points(gain, solved.grid, rtol)
    if not feedforward:
        return solved, gains, None

    system = plant.system

    def adjoint(mirrored: Array, speed: float) -> tuple[Array, Array]:
        phase = system.period - mirrored
        A, B, b = plant.dynamics(phase)
        closed = A - B @ gains(phase).T.reshape(len(phase), len(inputs), plant.N)
        load = np.einsum("kij,kj->ki", symmetric_of(solved.curve(phase)), b)
        return np.swapaxes(closed, 1, 2), load

    # The adjoint decays backwards in time.
    adjoints = FirstOrderSystem(adjoint, plant.states, system.period, mirrored_breaks(system))
    orbit = periodic(adjoints, plant.speed, rtol=rtol)

    def ahead(phase: Array) -> Array:
        B = plant.input_matrix(phase)
        along = np.einsum("kir,ik->kr", B, orbit.at(system.period - phase))
        return -np.einsum("krs,ks->kr", _inverse(cost(phase)), along)

    return solved, gains, through_points(ahead, solved.grid, rtol)


def _factor(B: Array, R: Array) -> Array:
    """Return the factor E = B L⁻ᵀ (k, N, r) of B R⁻¹ Bᵀ = E Eᵀ, where R = L Lᵀ (k, r, r)."""
    return B @ np.swapaxes(_inverse(np.linalg.cholesky(R)), 1, 2)


def _inverse(R: Array) -> Array:
    """Return the inverses of matrices (k, r, r). If all matrices are equal, a single inverse (1, r, r) is
    returned."""
    return np.linalg.inv(R[:1] if R.strides[0] == 0 else R)


def _state_weight(plant: Plant, Q: Weight) -> Function:
    """Return the weight Q (k, N, N) as a function of phases (k,). In a mapping, the numbers are the weights
    of the squared states and outputs."""
    if not isinstance(Q, Mapping):
        return matrix_function("Q", Q, plant.N, plant.system)
    plant.require_names(list(Q))
    numbers = named_numbers("Q", Q, list(Q), positive=False)
    if all(name in plant.states for name in numbers):
        diagonal = np.diag([numbers.get(name, 0.0) for name in plant.states])
        return lambda phase: np.broadcast_to(diagonal, (len(phase), plant.N, plant.N))
    plant.rows(list(numbers), np.zeros(1))
    names, weights = list(numbers), np.array(list(numbers.values()))

    def weight(phase: Array) -> Array:
        rows = plant.rows(names, phase)
        return np.swapaxes(rows, 1, 2) @ (weights[:, None] * rows)

    return weight


def filter_of(plant: Plant, W: Weight, V: Weight, rtol: float) -> tuple[Solved, Curve, tuple[str, ...]]:
    """Return the solution P of the filter's Riccati equation, the curve of the gain L, and the names of the
    measured quantities."""
    system = plant.system
    noise = _state_noise(plant, W)
    if isinstance(V, Mapping):
        measured = tuple(V)
        if not measured:
            raise MissingValueError("V contains no measured quantity; give numbers for states or outputs")
        plant.rows(measured, np.zeros(1))
        V = np.diag(list(named_numbers("V", V, measured, positive=True).values()))
    else:
        of_states = len(system.states) == system.n and system.outputs
        measured = tuple(system.outputs if of_states else system.coordinates)
    cost = matrix_function("V", V, len(measured), system, definite=True)

    def coefficients(phase: Array) -> tuple[Array, Array, Array]:
        rows, A = plant.rows(measured, phase), plant.dynamics(phase)[0]
        return np.swapaxes(A, 1, 2), _factor(np.swapaxes(rows, 1, 2), cost(phase)), noise(phase)

    solved = _solved(plant, coefficients, rtol, filters=True)

    def gain(phase: Array) -> Array:
        rows = np.swapaxes(plant.rows(measured, phase), 1, 2)
        return symmetric_of(solved.curve(phase)) @ rows @ _inverse(cost(phase))

    return solved, through_points(gain, solved.grid, rtol), measured


def _state_noise(plant: Plant, W: Weight) -> Function:
    """Return the intensity W (k, N, N) of the process noise as a function of phases (k,). If W is a mapping,
    its keys are names of inputs and states, and its values are noise intensities."""
    if not isinstance(W, Mapping):
        return matrix_function("W", W, plant.N, plant.system)
    inputs, states = plant.system.inputs, plant.states
    numbers = named_numbers("W", W, [*inputs, *states], positive=False)
    along, direct = (np.array([numbers.get(name, 0.0) for name in each]) for each in (inputs, states))

    def noise(phase: Array) -> Array:
        B = plant.input_matrix(phase)
        return B * along @ np.swapaxes(B, 1, 2) + np.diag(direct)

    return noise


def _solved(
    plant: Plant,
    coefficients: Callable[[Array], tuple[Array, Array, Array]],
    rtol: float,
    filters: bool = False,
) -> Solved:
    system, period = plant.system, plant.system.period
    with one_thread(system.n):
        if not filters:
            return solve_riccati(Riccati(coefficients, plant.speed, period, system.breaks, rtol=rtol))
        dual = Riccati(
            lambda mirrored: coefficients(period - mirrored),
            plant.speed,
            period,
            mirrored_breaks(system),
            rtol=rtol,
            filters=True,
        )
        return solve_riccati(dual).mirrored


def mirrored_breaks(system: PeriodicSystem) -> tuple[float, ...]:
    """Return the phases of the breaks of a system whose phase is reversed."""
    return tuple((system.period - each) % system.period for each in system.breaks)


def error_equations(plant: Plant, gain: Curve, measured: tuple[str, ...]) -> PeriodicSystem:
    """Return the equations e′ = (A − LC) e of the estimation error."""

    def matrices(phase: Array, speed: float) -> tuple[Array, Array]:
        here = Plant(plant.system, speed)
        L = gain(phase).T.reshape(len(phase), plant.N, -1)
        A = here.dynamics(phase)[0] - L @ here.rows(measured, phase)
        return A, np.zeros((len(phase), plant.N))

    system = FirstOrderSystem(matrices, plant.states, plant.system.period, plant.system.breaks)
    labels = plant.system.labels
    return relabelled(system, name=f"error of the estimates of {labels.name}", speed_unit=labels.speed_unit)
