"""The compared programs. Each is a function of a system that returns a function of the tolerance.

To add one, write such a function and name it in `CONTENDERS`. Libraries that are not installed are left out.
"""

import functools
import importlib.util
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

import solve
from solve.arrays import Array
from tests.benchmarks.suite.systems import FourierSystem

Solver = Callable[[float], tuple[Array, Array]]
"""Multipliers (2n,) and the state (q, q̇) (2n,) at φ = 0, for a tolerance."""


class UnsuitableError(Exception):
    """Raised if a program cannot solve a system; the text is the reason."""


def _ours(method: str, system: FourierSystem) -> Solver:
    names = [f"q{k + 1}" for k in range(system.n)]
    model = solve.PeriodicSystem(system.matrices, names)

    def run(tolerance: float) -> tuple[Array, Array]:
        orbit = solve.periodic(model, system.speed, method=method, rtol=tolerance)
        return orbit.multipliers, np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))

    return run


def _closed(system: FourierSystem, end: Array) -> tuple[Array, Array]:
    """Return multipliers and periodic state from [Φ | x] (2n, 2n+1) after a period."""
    Phi, x = end[:, :-1], end[:, -1]
    return np.linalg.eigvals(Phi), np.linalg.solve(np.eye(len(x)) - Phi, x)


def _scipy(method: str, system: FourierSystem) -> Solver:
    N = 2 * system.n
    start = np.eye(N, N + 1)

    def run(tolerance: float) -> tuple[Array, Array]:
        solution = solve_ivp(
            lambda phase, x: system.rate(phase, x.reshape(N, N + 1)).ravel(),
            (0.0, 2 * np.pi),
            start.ravel(),
            method=method,
            rtol=max(tolerance, 3e-14),
            atol=1e-3 * tolerance,
        )
        return _closed(system, solution.y[:, -1].reshape(N, N + 1))

    return run


def _casadi(system: FourierSystem) -> Solver:
    import casadi

    n, N = system.n, 2 * system.n
    phase, x = casadi.SX.sym("phase"), casadi.SX.sym("x", N, N + 1)
    M, C, K, d = (_symbolic(system, name, phase, casadi.cos, casadi.sin) for name in ("M", "C", "K", "d"))
    M, C, K = (casadi.vertcat(*(casadi.horzcat(*row) for row in A)) for A in (M, C, K))
    force = -C @ x[n:, :] - K @ x[:n, :]
    force[:, N] += casadi.vertcat(*d)
    rate = casadi.vertcat(x[n:, :], casadi.solve(M, force)) / system.speed
    problem = {"x": casadi.vec(x), "t": phase, "ode": casadi.vec(rate)}

    @functools.cache
    def integrator(tolerance: float):
        options = {"abstol": 1e-3 * tolerance, "reltol": tolerance, "max_num_steps": 200_000}
        return casadi.integrator("period", "cvodes", problem, 0.0, 2 * np.pi, options)

    def run(tolerance: float) -> tuple[Array, Array]:
        end = np.array(integrator(tolerance)(x0=np.eye(N, N + 1).ravel(order="F"))["xf"])
        return _closed(system, end.reshape(N, N + 1, order="F"))

    return run


def _jax(system: FourierSystem) -> Solver:
    import jax
    import jax.numpy as jnp
    from jax.experimental.ode import odeint

    jax.config.update("jax_enable_x64", True)
    n, N = system.n, 2 * system.n

    def total(name: str, phase):
        return sum(jnp.cos(k * phase) * A + jnp.sin(k * phase) * B for k, A, B in system.series[name])

    def rate(x, phase):
        force = -total("C", phase) @ x[n:] - total("K", phase) @ x[:n]
        force = force.at[:, -1].add(total("d", phase))
        return jnp.concatenate((x[n:], jnp.linalg.solve(total("M", phase), force))) / system.speed

    @functools.partial(jax.jit, static_argnums=0)
    def end(tolerance: float):
        ends = jnp.array([0.0, 2 * jnp.pi])
        return odeint(rate, jnp.eye(N, N + 1), ends, rtol=tolerance, atol=1e-3 * tolerance)[-1]

    return lambda tolerance: _closed(system, np.asarray(end(tolerance)))


def _heyoka(system: FourierSystem) -> Solver:
    import heyoka

    if system.n > 1 and len(system.series["M"]) > 1:
        raise UnsuitableError("needs M inverted in symbols")
    n, N = system.n, 2 * system.n
    M, C, K, d = (
        _symbolic(system, name, heyoka.time, heyoka.cos, heyoka.sin) for name in ("M", "C", "K", "d")
    )
    inverse = [[1.0 / M[0][0]]] if n == 1 else np.linalg.inv(system.series["M"][0][1]).tolist()
    equations = []
    for column in range(N + 1):
        q = [heyoka.make_vars(f"q{i}_{column}") for i in range(n)]
        v = [heyoka.make_vars(f"v{i}_{column}") for i in range(n)]
        force = [
            heyoka.sum([*(-C[i][j] * v[j] for j in range(n)), *(-K[i][j] * q[j] for j in range(n))])
            + (d[i] if column == N else 0.0)
            for i in range(n)
        ]
        equations += [(q[i], v[i] / system.speed) for i in range(n)]
        equations += [
            (v[i], heyoka.sum([inverse[i][j] * force[j] for j in range(n)]) / system.speed) for i in range(n)
        ]

    @functools.cache
    def compiled(tolerance: float):
        return heyoka.taylor_adaptive(equations, np.zeros(N * (N + 1)), tol=tolerance)

    def run(tolerance: float) -> tuple[Array, Array]:
        integrator = compiled(tolerance)
        integrator.time = 0.0
        integrator.state[:] = np.eye(N, N + 1).T.ravel()
        integrator.propagate_until(2 * np.pi)
        return _closed(system, integrator.state.reshape(N + 1, N).T)

    return run


def _symbolic(system: FourierSystem, name: str, phase, cos, sin) -> list:
    """Return nested lists of expressions of M, C, K (n, n) or d (n,)."""

    def total(*place: int):
        value = 0.0
        for k, A, B in system.series[name]:
            if A[place]:
                value = value + (float(A[place]) * cos(k * phase) if k else float(A[place]))
            if k and B[place]:
                value = value + float(B[place]) * sin(k * phase)
        return value

    if name == "d":
        return [total(i) for i in range(system.n)]
    return [[total(i, j) for j in range(system.n)] for i in range(system.n)]


CONTENDERS: dict[str, Callable[[FourierSystem], Solver]] = {
    **{method: functools.partial(_ours, method) for method in ("auto", "gauss", "radau", "fourier")},
    "SciPy DOP853": functools.partial(_scipy, "DOP853"),
    "SciPy Radau": functools.partial(_scipy, "Radau"),
    "CasADi CVODES": _casadi,
    **({"JAX odeint": _jax} if importlib.util.find_spec("jax") else {}),
    **({"heyoka": _heyoka} if importlib.util.find_spec("heyoka") else {}),
}
