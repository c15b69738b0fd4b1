"""How the equations and the outputs of a model depend on its parameters and its speed."""

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.differences import slope
from solve.model.sampling import Sampler
from solve.model.setup import Setup
from solve.system import SPEED, PeriodicSystem


class _Slopes(NamedTuple):
    """Derivatives of a generated function: those that are not always 0, with row and column of each."""

    shape: tuple[int, int]
    rows: Array
    columns: Array
    sampler: Sampler | None

    def __call__(self, phase: Array, speed: float, *inputs: Array) -> Array:
        """(k, rows, columns) at phases (k,), other inputs (k, …), and parameters (p,)."""
        made = np.zeros((len(phase), self.shape[0] * self.shape[1]))
        if self.sampler is not None:
            places = self.rows * self.shape[1] + self.columns
            made[:, places] = self.sampler(phase, np.full(len(phase), speed), *inputs)
        return made.reshape(-1, *self.shape)


class GeneratedSlopes:
    """Derivatives of the generated functions by automatic differentiation in CasADi (J. A. E. Andersson et
    al., Math. Program. Comput. 11 (2019) 1-36), for any values of the parameters, each built when it is first
    asked for. nonlinear: of the nonlinear equations, rather than of those linearised about the desired
    motion."""

    def __init__(self, setup: Setup, n: int, names: Sequence[str], nonlinear: bool):
        self._setup, self._n, self._names, self.nonlinear = setup, n, tuple(names), nonlinear
        self.output = cache(self._output)

    @cached_property
    def _symbols(self) -> list[Any]:
        """Phase, speed, q″, q′, q and the parameters."""
        return [_symbol(f"x{at}", size) for at, size in enumerate((1, 1, *[self._n] * 3, len(self._setup.p)))]

    @cached_property
    def _equations(self) -> Any:
        phase, speed, a, v, q, p = self._symbols
        if self.nonlinear:
            given = [phase, speed, q, speed * v, speed**2 * a, p]
            return self._setup.function("residual").call(given, True, False)[0]
        M, C, K, d = self._setup.function("linearised").call([phase, speed, p], True, False)
        return speed**2 * M @ a + speed * C @ v + K @ q - d

    @cached_property
    def residual(self) -> _Slopes:
        """Of the residual, by θ."""
        return self._slopes(self._equations, [])

    @cached_property
    def matrices(self) -> _Slopes:
        """Of a weighted sum of the entries, by θ and the states; the weights are an input."""
        import casadi

        n, states = self._n, self._symbols[2:5]
        weights = _symbol("weights", 3 * n**2)
        # CasADi stores by columns; the transposes come by rows.
        entries = [casadi.vec(casadi.densify(casadi.jacobian(self._equations, x)).T) for x in states]
        return self._slopes(casadi.dot(weights, casadi.vertcat(*entries)), states, weights)

    def _output(self, name: str) -> _Slopes:
        """Of an output, by θ and the states."""
        phase, speed, a, v, q, p = self._symbols
        given = [phase, speed, q, speed * v, speed**2 * a, p]
        values = self._setup.function("outputs").call(given, True, False)
        names = [each for each, *_ in self._setup.module.OUTPUTS]
        return self._slopes(values[names.index(name)], [a, v, q])

    def _slopes(self, value: Any, states: Sequence[Any], *further: Any) -> _Slopes:
        """Of a column by θ, and behind these by states; all are symbols of CasADi."""
        import casadi

        *inputs, p = self._symbols
        order = list(self._setup.case.parameters)
        chosen = [inputs[1] if name == SPEED else p[order.index(name)] for name in self._names]
        slopes = casadi.jacobian(value, casadi.vertcat(*chosen, *states))
        rows, columns = (np.array(part, dtype=int) for part in slopes.sparsity().get_triplet())
        if not len(rows):
            return _Slopes(slopes.shape, rows, columns, None)
        found = casadi.cse(casadi.vertcat(*slopes.nonzeros()))
        sampler = Sampler(casadi.Function("slopes", [*inputs, *further, p], [found]), shared=1)
        return _Slopes(slopes.shape, rows, columns, sampler)


class GeneratedDependence:
    """By derivatives of the generated functions, at the parameters of a setup; see
    `solve.system.Dependence`."""

    parted = True

    def __init__(self, slopes: GeneratedSlopes, setup: Setup, n: int, count: int):
        """count: how many quantities θ there are."""
        self._slopes, self._p, self._n, self._count = slopes, setup.p, n, count
        self.linear = not slopes.nonlinear

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        return self._slopes.residual(phase, speed, *_parts(states), self._p)

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        inputs = *_parts(states), weights.reshape(len(phase), -1), self._p
        return self._parted(self._slopes.matrices(phase, speed, *inputs))

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        return self._parted(self._slopes.output(name)(phase, speed, *_parts(states), self._p))

    def output_along(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        by_parameters, by_states = self.output(name, phase, speed, states)
        return by_parameters + np.einsum("kcn,kcnr->kr", by_states, moved)

    def _parted(self, found: Array) -> tuple[Array, Array]:
        return found[:, 0, : self._count], found[:, 0, self._count :].reshape(-1, 3, self._n)


def _symbol(name: str, size: int) -> Any:
    import casadi

    return casadi.SX.sym(name, size)  # pyright: ignore[reportAttributeAccessIssue]


def _parts(states: Array) -> tuple[Array, Array, Array]:
    a, v, q = (states[:, part] for part in range(3))
    return a, v, q


class AssembledDependence:
    """By differences of the matrices and outputs that are assembled; see `solve.system.Dependence`."""

    linear, parted = True, False

    def __init__(self, system: PeriodicSystem, names: Sequence[str]):
        self._system, self._names = system, tuple(names)
        self._kept: dict[tuple[bytes, float], Array] = {}

    def residual(self, phase: Array, speed: float, states: Array) -> Array:
        n, entries = self._system.n, self._entries(phase, speed)
        by_row = entries[:, : 3 * n**2].reshape(-1, 3, n, n, entries.shape[-1])
        return np.einsum("kcijr,kcj->kir", by_row, states) - entries[:, 3 * n**2 :]

    def matrices(self, phase: Array, speed: float, states: Array, weights: Array) -> tuple[Array, Array]:
        entries = self._entries(phase, speed)[:, : 3 * self._system.n**2]
        return np.einsum("ke,ker->kr", weights.reshape(len(phase), -1), entries), np.zeros_like(states)

    def output(self, name: str, phase: Array, speed: float, states: Array) -> tuple[Array, Array]:
        raise NotImplementedError

    def output_along(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        def column(at: int) -> Array:
            def value(system: PeriodicSystem, omega: float, step: float) -> Array:
                a, v, q = (each.T for each in _parts(states + step * moved[..., at]))
                return np.asarray(system.output_values(phase, omega, q, omega * v, omega**2 * a)[name])

            return self._slope(self._names[at], speed, value)

        return np.stack([column(at) for at in range(len(self._names))], axis=-1)

    def _entries(self, phase: Array, speed: float) -> Array:
        """Of Ω²M, ΩC, K by rows and d, (k, 3n² + n, r); those of the last phases are kept."""
        key = phase.tobytes(), speed
        if key not in self._kept:
            columns = [
                self._slope(name, speed, lambda system, omega, _: system.entries(phase, omega))
                for name in self._names
            ]
            self._kept = {key: np.stack(columns, axis=-1)}
        return self._kept[key]

    def _slope(
        self, name: str, speed: float, value: Callable[[PeriodicSystem, float, float], Array]
    ) -> Array:
        """value: of a system at a speed, when the quantity of this name has moved by a step."""
        at = speed if name == SPEED else self._system.parameters[name]

        def moved(number: float) -> Array:
            if name == SPEED:
                return value(self._system, number, number - at)
            return value(self._system.varied({name: number}), speed, number - at)

        return slope(moved, at)
