"""How the equations and the outputs of a model depend on its parameters and its speed."""

from collections.abc import Mapping, Sequence
from functools import cached_property
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

    def __call__(self, phase: Array, speed: float, *states: Array) -> Array:
        """(k, rows, columns) at phases (k,) and states (n, k)."""
        made = np.zeros((len(phase), *self.shape))
        if self.sampler is not None:
            columns = (each.T for each in states)
            made[:, self.rows, self.columns] = self.sampler(phase, np.full(len(phase), speed), *columns)
        return made


class GeneratedDependence:
    """By automatic differentiation of the generated functions in CasADi (J. A. E. Andersson et al., Math.
    Program. Comput. 11 (2019) 1-36), each when it is first asked for; see `solve.system.Dependence`."""

    def __init__(self, setup: Setup, n: int, names: Sequence[str]):
        self._setup, self._n, self._names = setup, n, tuple(names)

    def entries(self, phase: Array, speed: float) -> Array:
        return self._entries(phase, speed)

    def output(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        slopes = self._outputs[name](phase, speed, *states)[:, 0]
        n, by_state = self._n, slopes[:, : 3 * self._n]
        return slopes[:, 3 * n :].T + np.einsum("kci,rcik->rk", by_state.reshape(-1, 3, n), moved)

    @cached_property
    def _entries(self) -> _Slopes:
        phase, speed, p = self._symbols(1, 1, len(self._setup.p))
        M, C, K, d = self._setup.function("linearised").call([phase, speed, p], True, False)
        return self._slopes([speed**2 * M, speed * C, K, d], [], [phase, speed], p)

    @cached_property
    def _outputs(self) -> Mapping[str, _Slopes]:
        n, names = self._n, [name for name, *_ in self._setup.module.OUTPUTS]
        phase, speed, p, *x = self._symbols(1, 1, len(self._setup.p), n, n, n)
        by_time = [speed**order * each for order, each in enumerate(x)]
        values = self._setup.function("outputs").call([phase, speed, *by_time, p], True, False)
        return {
            name: self._slopes([value], x, [phase, speed, *x], p)
            for name, value in zip(names, values, strict=True)
        }

    def _slopes(self, parts: Sequence[Any], states: Sequence[Any], inputs: Sequence[Any], p: Any) -> _Slopes:
        """Of parts by rows, one after another, by the states and by θ; all are symbols of CasADi."""
        import casadi

        order = list(self._setup.case.parameters)
        chosen = [inputs[1] if name == SPEED else p[order.index(name)] for name in self._names]
        # CasADi stores by columns; the transposes come by rows.
        rows = casadi.vertcat(*(casadi.vec(casadi.densify(part.T)) for part in parts))
        slopes = casadi.jacobian(rows, casadi.vertcat(*states, *chosen))
        at_rows, at_columns = (np.array(part, dtype=int) for part in slopes.sparsity().get_triplet())
        if not len(at_rows):
            return _Slopes(slopes.shape, at_rows, at_columns, None)
        function = casadi.Function("slopes", [*inputs, p], [casadi.vertcat(*slopes.nonzeros())])
        numbers = casadi.SX(casadi.DM(self._setup.p))
        (found,) = function.call([*inputs, numbers], True, False)
        sampler = Sampler(casadi.Function("slopes", [*inputs], [casadi.cse(found)]))
        return _Slopes(slopes.shape, at_rows, at_columns, sampler)

    @staticmethod
    def _symbols(*sizes: int) -> list[Any]:
        import casadi

        return [casadi.SX.sym(f"x{at}", size) for at, size in enumerate(sizes)]  # pyright: ignore[reportAttributeAccessIssue]


class AssembledDependence:
    """By differences of the matrices and outputs that are assembled; see `solve.system.Dependence`."""

    def __init__(self, system: PeriodicSystem, names: Sequence[str]):
        self._system, self._names = system, tuple(names)

    def entries(self, phase: Array, speed: float) -> Array:
        def column(name: str) -> Array:
            return self._slope(name, speed, lambda system, omega, _: system.entries(phase, omega))

        return np.stack([column(name) for name in self._names], axis=-1)

    def output(self, name: str, phase: Array, speed: float, states: Array, moved: Array) -> Array:
        def row(at: int) -> Array:
            def value(system: PeriodicSystem, omega: float, step: float) -> Array:
                q, v, a = states + step * moved[at]
                return np.asarray(system.output_values(phase, omega, q, omega * v, omega**2 * a)[name])

            return self._slope(self._names[at], speed, value)

        return np.stack([row(at) for at in range(len(self._names))])

    def _slope(self, name: str, speed: float, value: Any) -> Array:
        """value: of a system at a speed, when the quantity of this name has moved by a step."""
        at = speed if name == SPEED else self._system.parameters[name]

        def moved(number: float) -> Array:
            if name == SPEED:
                return value(self._system, number, number - at)
            return value(self._system.varied({name: number}), speed, number - at)

        return slope(moved, at)
