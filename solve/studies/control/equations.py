"""Riccati equations of regulators and filters, from weights and noise intensities, and the gains as
curves."""

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
    """Solution X of the regulator's Riccati equation, curve of the gain K, and curve of the feedforward."""
    weight, inputs = _state_weight(plant, Q), plant.system.inputs
    if isinstance(R, Mapping):
        numbers = named_numbers("R", R, inputs, positive=True)
        if missing := [name for name in inputs if name not in numbers]:
            raise MissingValueError(f"R has no number for the input {missing[0]}; give one for every input")
        R = np.diag([numbers[name] for name in inputs])
    cost = matrix_function("R", R, len(inputs), plant.system.period, definite=True)

    def coefficients(phase: Array) -> tuple[Array, Array, Array]:
        A, B, _ = plant.dynamics(phase)
        # B R⁻¹ Bᵀ = E Eᵀ with R = L Lᵀ and E = B L⁻ᵀ.
        factor = np.linalg.solve(np.linalg.cholesky(cost(phase)), np.swapaxes(B, 1, 2))
        return A, np.swapaxes(factor, 1, 2), weight(phase)

    solved = _solved(plant, coefficients, rtol)

    def gain(phase: Array) -> Array:
        B = plant.input_matrix(phase)
        return np.linalg.solve(cost(phase), np.swapaxes(B, 1, 2) @ symmetric_of(solved.curve(phase)))

    gains = through_points(gain, solved.grid)
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
    breaks = [(system.period - each) % system.period for each in system.breaks]
    adjoints = FirstOrderSystem(adjoint, plant.states, system.period, breaks)
    orbit = periodic(adjoints, plant.speed, rtol=rtol)

    def ahead(phase: Array) -> Array:
        B = plant.input_matrix(phase)
        along = np.einsum("kir,ik->kr", B, orbit.at(system.period - phase))
        return -np.linalg.solve(cost(phase), along[..., None])[..., 0]

    return solved, gains, through_points(ahead, solved.grid)


def _state_weight(plant: Plant, Q: Weight) -> Function:
    """Weight Q (k, N, N) as a function of the phase. A mapping gives the weights of squared states and
    outputs by name."""
    if not isinstance(Q, Mapping):
        return matrix_function("Q", Q, plant.N, plant.system.period)
    plant.rows(list(Q), np.zeros(1))
    numbers = named_numbers("Q", Q, list(Q), positive=False)
    names, weights = list(numbers), np.array(list(numbers.values()))

    def weight(phase: Array) -> Array:
        rows = plant.rows(names, phase)
        return np.swapaxes(rows, 1, 2) @ (weights[:, None] * rows)

    return weight


def filter_of(plant: Plant, W: Weight, V: Weight, rtol: float) -> tuple[Solved, Curve, tuple[str, ...]]:
    """Solution P of the filter's Riccati equation, curve of the gain L, and names of the measured
    quantities."""
    system = plant.system
    noise = _state_noise(plant, W)
    if isinstance(V, Mapping):
        measured = tuple(V)
        plant.rows(measured, np.zeros(1))
        V = np.diag(list(named_numbers("V", V, measured, positive=True).values()))
    else:
        of_states = len(system.states) == system.n and system.outputs
        measured = tuple(system.outputs if of_states else system.coordinates)
    cost = matrix_function("V", V, len(measured), system.period, definite=True)

    def coefficients(phase: Array) -> tuple[Array, Array, Array]:
        C, A = plant.rows(measured, phase), plant.dynamics(phase)[0]
        return A, noise(phase), np.swapaxes(C, 1, 2) @ np.linalg.solve(cost(phase), C)

    solved = _solved(plant, coefficients, rtol, filters=True)

    def gain(phase: Array) -> Array:
        shown = plant.rows(measured, phase) @ symmetric_of(solved.curve(phase))
        return np.swapaxes(np.linalg.solve(cost(phase), shown), 1, 2)

    return solved, through_points(gain, solved.grid), measured


def _state_noise(plant: Plant, W: Weight) -> Function:
    """Factor E (k, N, r) of the process-noise intensity W = E Eᵀ as a function of the phase. A mapping gives
    the intensities of inputs and states by name."""
    if not isinstance(W, Mapping):
        intensity = matrix_function("W", W, plant.N, plant.system.period)

        def factor(phase: Array) -> Array:
            values, vectors = np.linalg.eigh(intensity(phase))
            return vectors * np.sqrt(np.maximum(values, 0.0))[:, None]

        return factor
    inputs, states = plant.system.inputs, plant.states
    numbers = named_numbers("W", W, [*inputs, *states], positive=False)
    along = np.sqrt([numbers[name] for name in inputs if name in numbers])
    columns = [inputs.index(name) for name in inputs if name in numbers]
    direct = np.diag(np.sqrt([numbers.get(name, 0.0) for name in states]))
    direct = direct[:, direct.any(axis=0)]

    def noise(phase: Array) -> Array:
        B = plant.input_matrix(phase)[..., columns] * along
        return np.concatenate((B, np.broadcast_to(direct, (len(phase), *direct.shape))), axis=-1)

    return noise


def _solved(
    plant: Plant,
    coefficients: Callable[[Array], tuple[Array, Array, Array]],
    rtol: float,
    filters: bool = False,
) -> Solved:
    system = plant.system
    with one_thread(system.n):
        equation = Riccati(coefficients, plant.speed, system.period, system.breaks, filters, rtol=rtol)
        return solve_riccati(equation)


def error_equations(plant: Plant, gain: Curve, measured: tuple[str, ...]) -> PeriodicSystem:
    """Equations e′ = (A − LC) e of the estimation error."""

    def matrices(phase: Array, speed: float) -> tuple[Array, Array]:
        here = Plant(plant.system, speed)
        L = gain(phase).T.reshape(len(phase), plant.N, -1)
        A = here.dynamics(phase)[0] - L @ here.rows(measured, phase)
        return A, np.zeros((len(phase), plant.N))

    system = FirstOrderSystem(matrices, plant.states, plant.system.period, plant.system.breaks)
    labels = plant.system.labels
    return relabelled(system, name=f"error of the estimates of {labels.name}", speed_unit=labels.speed_unit)
