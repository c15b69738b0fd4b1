"""python -m tests.benchmarks.heyoka_shooting: a nonlinear orbit compared with shooting by heyoka's
variational equations.

The program follows heyoka's documentation: equations of motion as symbols, variational equations by
`var_ode_sys`, compiled once. Shooting begins at the state of the linear orbit; corrections are halved until
the residual decreases. The program computes the state at the start of the period and the monodromy matrix,
without error estimates. Run it with OMP_NUM_THREADS=1.
"""

import functools

import heyoka as hy
import numpy as np

import solve
from solve.arrays import Array
from tests.benchmarks import peers
from tests.benchmarks.heyoka_peers import cam, processor
from tests.benchmarks.timing import median

SPEED = 10 * np.pi
RTOL = 1e-6
TOLERANCE = 1e-5
"""The loosest power of ten with which the state is right to 1e-6."""

_CLOSED, _MOST = 1e-8, 40


@functools.cache
def nonlinear_cam(tolerance: float):
    """The cam's nonlinear equations of motion with the phase as independent variable and θ = φ + q1, and
    their variational equations: I1 q̈1 + c1 q̇1 + k1 q1 = U′(θ) (c2 q̇2 + k2 q2), accelerations of the others
    by their forces."""
    speed, phase = hy.par[0], hy.time
    q1, q2, q3, v1, v2, v3 = hy.make_vars("q1", "q2", "q3", "v1", "v2", "v3")
    angle, law = phase + q1, [(order, peers.LAW[order - 1]) for order in (1, 3, 5)]
    U1 = sum(a * hy.cos(k * angle) for k, a in law)
    U2 = sum(-a * k * hy.sin(k * angle) for k, a in law)
    held2, held3 = peers.C2 * speed * v2 + peers.K2 * q2, peers.C3 * speed * v3 + peers.K3 * q3
    a1 = (U1 * held2 - peers.C1 * speed * v1 - peers.K1 * q1) / (peers.I1 * speed**2)
    y1 = U2 * (1.0 + v1) ** 2 + U1 * a1
    y2 = (held3 - held2) / (peers.M2 * speed**2)
    y3 = -(held3 + peers.F) / (peers.M3 * speed**2)
    rates = [v1, v2, v3, a1, y2 - y1, y3 - y2]
    system = list(zip([q1, q2, q3, v1, v2, v3], rates, strict=True))
    return hy.taylor_adaptive(hy.var_ode_sys(system, hy.var_args.vars), np.zeros(6), tol=tolerance)


def period_map(integrator, x: Array, speed: float = SPEED) -> tuple[Array, Array]:
    """Return the state one period after x (6,) and its derivative with respect to x."""
    integrator.time, integrator.pars[0] = 0.0, speed
    integrator.state[:6], integrator.state[6:] = x, np.eye(6).ravel()
    integrator.propagate_until(2 * np.pi)
    return integrator.state[:6].copy(), integrator.state[6:].reshape(6, 6).copy()


def start() -> Array:
    """Return the state (6,) of the linear orbit."""
    integrator = cam(1e-7)
    integrator.time, integrator.pars[0] = 0.0, SPEED
    integrator.state[:] = np.eye(6, 7).T.ravel()
    integrator.propagate_until(2 * np.pi)
    maps = integrator.state.reshape(7, 6).T
    return np.linalg.solve(np.eye(6) - maps[:, :6], maps[:, 6])


def shooting(tolerance: float = TOLERANCE) -> tuple[Array, Array, int]:
    """Return q (3,) and dq/dφ at phase 0, the multipliers, and the number of integrated periods."""
    integrator, x = nonlinear_cam(tolerance), start()
    sizes = np.maximum(np.abs(x), 1e-3 * np.abs(x).max())
    end, Phi = period_map(integrator, x)
    size, part = np.abs((end - x) / sizes).max(), 1.0
    for turns in range(1, _MOST):
        if size < _CLOSED:
            return x, np.linalg.eigvals(Phi), turns
        trial = x + part * np.linalg.solve(np.eye(6) - Phi, end - x)
        after, changed = period_map(integrator, trial)
        then = np.abs((after - trial) / sizes).max()
        if then < size:
            x, end, Phi, size, part = trial, after, changed, then, min(1.0, 2 * part)
        else:
            part /= 2
    raise ArithmeticError(f"shooting does not close: {size:.1e} after {_MOST} turns")


def fold(x: Array, speed: float) -> float:
    """Return the speed (rad/s) at which det(Φ - I) = 0 on the orbit. Newton's method with central differences
    starts from a state `x` (6,), q and dq/dφ, and a speed near the fold."""
    integrator, z = nonlinear_cam(1e-14), np.append(x, speed)
    unit = np.abs(z)

    def equations(z: Array) -> Array:
        after, Phi = period_map(integrator, z[:6] * unit[:6], z[6] * unit[6])
        return np.append(after / unit[:6] - z[:6], np.linalg.det(Phi - np.eye(6)))

    z = z / unit
    for _ in range(8):
        beside = [(equations(z + d) - equations(z - d)) / 2e-7 for d in 1e-7 * np.eye(7)]
        step = np.linalg.solve(np.array(beside).T, -equations(z))
        z = z + step
        if np.abs(step).max() < 1e-11:
            break
    return float(z[6] * unit[6])


def main() -> None:
    model = solve.load("cam", case="1")
    seconds, orbit = median(lambda: solve.nonlinear(model, SPEED, rtol=RTOL))
    theirs, (x, _, turns) = median(shooting)
    off = np.abs(x[:3] - orbit.q[:, 0]) / np.abs(orbit.q).max(axis=1)
    print(processor())
    print(f"ours, certified:   {1e3 * seconds:.1f} ms, {orbit.iterations} corrections at first")
    print(f"heyoka's shooting: {1e3 * theirs:.1f} ms, {turns} turns, ratio {theirs / seconds:.2f}")
    print(f"apart by {off.max():.1e} of the orbit")


if __name__ == "__main__":
    main()
