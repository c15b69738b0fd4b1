"""python -m tests.benchmarks.four_bar: the elastic four-bar with many coordinates; processor times of one
thread.

The first problem is an orbit with 90 degrees of freedom and its multipliers. The second is a map of stresses
at 200 speeds with 3 elements per link, compared with SciPy's Radau at one speed. SciPy receives x′ = P x + f
as splines, and the Jacobian P. It integrates 2n + 1 revolutions for the periodic solution with its
multipliers; or it integrates until the transient has decayed, which does not yield multipliers.
"""

import math
import resource

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import solve
from solve.arrays import Array
from solve.period.points import SinglePoint, state_rate
from solve.system import PeriodicSystem
from tests.benchmarks.timing import median

RTOL = 1e-5
STRESS = "follower_midpoint_stress_plus"
SPEEDS = np.linspace(20.0, 60.0, 200)
_NODES = 2048


def model(elements: int) -> solve.PeriodicSystem:
    return solve.load("four_bar", options={"elements": elements})


class Marching:
    """Integration by SciPy's Radau over periods at one speed, with the phase as time."""

    def __init__(self, system: PeriodicSystem, speed: float, rtol: float):
        phase = np.linspace(0.0, system.period, _NODES + 1)
        rate = state_rate(SinglePoint(system, speed), phase)[0]
        rate[-1] = rate[0]
        self.spline, self.period = CubicSpline(phase, rate, bc_type="periodic"), system.period
        self.rtol = rtol

    def turn(self, x: Array) -> Array:
        """Return the state (2n,) one period later."""
        scale = np.abs(x).reshape(2, -1).max(axis=1).repeat(len(x) // 2)

        def rate(phase: float, x: Array) -> Array:
            P = self.spline(phase)
            return P[:, :-1] @ x + P[:, -1]

        return solve_ivp(
            rate,
            (0.0, self.period),
            x,
            "Radau",
            jac=lambda phase, x: self.spline(phase)[:, :-1],
            rtol=self.rtol,
            atol=self.rtol * scale,
        ).y[:, -1]


def start_of(orbit: solve.Orbit) -> Array:
    """Return the state (2n,) at the beginning of the period, with derivatives with respect to the phase."""
    return np.concatenate((orbit.q[:, 0], orbit.qd[:, 0] / orbit.speed))


def map_of_stress(count: int) -> solve.Sweep:
    return solve.sweep(model(3), SPEEDS[:count], rtol=RTOL, quantities=[STRESS])


def main() -> None:
    large, _ = median(lambda: solve.periodic(model(10), 30.0, rtol=RTOL), 1)
    print(f"90 freedoms, one period with multipliers: {large:.2f} s")
    ours = median(lambda: map_of_stress(200), 1)[0] / 200
    print(f"3 elements, {STRESS} at 200 speeds with multipliers: {ours * 1e3:.0f} ms a speed")
    system = model(3)
    orbit = solve.periodic(system, 40.0, rtol=RTOL)
    marching = Marching(system, 40.0, RTOL)
    turn, _ = median(lambda: marching.turn(start_of(orbit)), 3)
    until_steady = math.ceil(math.log(RTOL) / math.log(orbit.spectral_radius))
    for what, turns in (("marching", until_steady), ("shooting, with multipliers", 2 * system.n + 1)):
        ratio = turns * turn / ours
        print(f"SciPy's Radau at 40 rad/s, {what}: {turns} turns of {turn:.2f} s, {ratio:.0f} times as long")
    print(f"largest resident memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
