"""python -m tests.benchmarks.optimisers [NAME …]: optima by SciPy's SLSQP and by IPOPT in CasADi.

Both solve the same epigraph problems with the same derivatives, in the same rounds, from the given design and
nine random ones. A start succeeds if its optimum fulfils all requirements and its objective is within 1e-3 of
the best of both optimisers.
"""

import sys
from collections.abc import Callable, Sequence
from time import process_time
from typing import Any, NamedTuple
from unittest import mock

import casadi
import numpy as np

import solve
from solve.arrays import Array
from solve.errors import SolveError
from solve.studies import minimax, optimum_search
from solve.studies.design_points import Design
from solve.studies.optimum_search import Search, State
from solve.studies.requirements import bounds_of, kept_of, real_quantity
from solve.units import speeds_given
from tests.solve.studies.test_optimise import manipulator_with_a_torque

STARTS, SUCCESS, RTOL = 10, 1e-3, 1e-6


class _Constraints(casadi.Callback):
    """Constraint values, or their derivatives, at z = (x, t); NaN where the model has no solution."""

    def __init__(self, values: Callable[[Array], Array], slopes: Callable[[Array], Array] | None, size: int):
        super().__init__()
        self.of, self.slopes, self.size = values, slopes, size
        self.inner: list[casadi.Callback] = []

    def build(self, rows: int, columns: int) -> "_Constraints":
        self.shape_out = rows, columns
        self.construct("constraints", {"enable_fd": False})
        return self

    def get_n_in(self) -> int:
        return 1 if self.slopes else 2

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        return casadi.Sparsity.dense(self.size if i == 0 else self.shape_out[0])

    def get_sparsity_out(self, i: int) -> casadi.Sparsity:
        return casadi.Sparsity.dense(*self.shape_out)

    def eval(self, arguments: Sequence[casadi.DM]) -> list[Any]:
        try:
            return [self.of(np.asarray(arguments[0]).ravel())]
        except SolveError:
            return [np.full(self.shape_out, np.nan)]

    def has_jacobian(self) -> bool:
        return self.slopes is not None

    def get_jacobian(self, name: str, inames: Any, onames: Any, opts: Any) -> casadi.Function:
        assert self.slopes
        self.inner.append(_Constraints(self.slopes, None, self.size).build(self.shape_out[0], self.size))
        return self.inner[-1]


def by_ipopt(
    objective: Sequence[Any],
    limits: Sequence[minimax.Excess],
    equations: minimax.Equations | None,
    x: Array,
    reach: float,
    rtol: float,
) -> tuple[Array, float]:
    """The function `solve.studies.minimax.minimised`, by IPOPT with an approximated Hessian."""
    scale = max(float(np.abs(each.values(x)).max()) for each in objective) or 1.0

    def values(z: Array) -> Array:
        rows = [each.values(z[:-1]) / scale - z[-1] for each in objective]
        rows += [each.values(z[:-1]) for each in limits]
        return np.concatenate(rows + ([equations.residuals(z[:-1])] if equations else []))

    def slopes(z: Array) -> Array:
        rows = [
            np.pad(each.slopes(z[:-1]) / scale, ((0, 0), (0, 1)), constant_values=-1) for each in objective
        ]
        others = [each.slopes(z[:-1]) for each in limits]
        others += [equations.slopes(z[:-1])] if equations else []
        return np.concatenate(rows + [np.pad(each, ((0, 0), (0, 1))) for each in others])

    largest = max(float(each.values(x).max()) for each in objective) / scale
    start = np.append(x, largest)
    count, equal = len(values(start)), len(equations.residuals(x)) if equations else 0
    constraints = _Constraints(values, slopes, len(start)).build(count, 1)
    z = casadi.MX.sym("z", len(start))
    options = {
        "print_time": False,
        "ipopt": {
            "sb": "yes",
            "print_level": 0,
            "tol": rtol,
            "max_iter": 60,
            "hessian_approximation": "limited-memory",
            "mu_strategy": "adaptive",
        },
    }
    solver = casadi.nlpsol("solver", "ipopt", {"x": z, "f": z[-1], "g": constraints(z)}, options)
    found = solver(
        x0=start,
        lbx=np.append(np.maximum(x - reach, 0), -np.inf),
        ubx=np.append(np.minimum(x + reach, 1), np.inf),
        lbg=np.r_[np.full(count - equal, -np.inf), np.zeros(equal)],
        ubg=np.zeros(count),
    )
    last = np.clip(np.asarray(found["x"]).ravel()[:-1], np.maximum(x - reach, 0), np.minimum(x + reach, 1))
    return last, float(found["x"][-1]) - largest


class Case(NamedTuple):
    """Search, by name of its case."""

    name: str
    search: Callable[[], Search]


def searched(
    model: Any, speed: str, minimise: str, free: dict[str, tuple[float, float]], **requirements: Sequence[str]
) -> Search:
    """Search for an optimum at one speed."""
    low, high = np.array(list(free.values())).T
    omega = speeds_given(speed)[0]
    design = Design(model, list(free), low, high, [float(omega)], "auto", RTOL, True)
    keep, subject = (requirements.get(name, ()) for name in ("keep", "subject"))
    return Search(design, real_quantity(model, minimise), bounds_of(model, subject), kept_of(model, keep))


def cam() -> Search:
    free = {"a1": (0.21, 0.23), "a3": (0.045, 0.065), "a5": (-0.03, 0.01), "a7": (-0.01, 0.01)}
    return searched(solve.load("cam"), "100 rpm", "q3.max_abs", free, keep=["lift.range"])


def torque() -> Search:
    names = [f"T{kind}{order}" for order in range(1, 7) for kind in "ab"]
    numbers = {**solve.case_numbers("manipulator").parameters, **dict.fromkeys(["T", *names], 0.0)}
    model = solve.load(manipulator_with_a_torque(), **numbers)
    free = dict.fromkeys(names, (-200.0, 200.0))
    return searched(model, "50 rpm", "q1.max_abs", free, subject=["torque.max_abs < 150 N m"])


CASES = [Case(each.__name__, each) for each in (cam, torque)]


def measured(case: Case, optimiser: Callable[..., Any]) -> tuple[list[State], int, float]:
    """Optima of all starts, number of solved systems, and processor time."""
    solved, at = [0], Design.at

    def counted(design: Design, x: Array, speeds: Sequence[float]) -> Any:
        solved[0] += len(speeds)
        return at(design, x, speeds)

    with mock.patch.object(Design, "at", counted), mock.patch.object(optimum_search, "minimised", optimiser):
        search = case.search()
        first = search.design.start
        starts = [first, *np.random.default_rng(0).random((STARTS - 1, len(first)))]
        begin, states = process_time(), []
        for x in starts:
            try:
                states.append(search.descended(x))
            except SolveError:
                states.append(State(x, np.inf, np.inf))
    return states, solved[0], process_time() - begin


def main() -> None:
    print("| case | optimiser | solutions | time (s) | violation | objective | successes |")
    print("|---|---|---|---|---|---|---|")
    for case in [each for each in CASES if each.name in (sys.argv[1:] or [each.name])]:
        results = {"SLSQP": measured(case, minimax.minimised), "IPOPT": measured(case, by_ipopt)}
        least = min(state.objective for states, *_ in results.values() for state in states if state.feasible)
        for name, (states, solved, seconds) in results.items():
            good = [each for each in states if each.feasible]
            best = min((each.objective for each in good), default=np.nan)
            worst = max((each.violation for each in good), default=np.nan)
            successes = sum(each.objective <= (1 + SUCCESS) * least for each in good)
            numbers = f"{solved} | {seconds:.1f} | {worst:.1e} | {best:.7g} | {successes}"
            print(f"| {case.name} | {name} | {numbers} |", flush=True)


if __name__ == "__main__":
    main()
