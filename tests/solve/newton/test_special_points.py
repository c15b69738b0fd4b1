"""Folds, period doublings and torus bifurcations, compared with shooting by SciPy."""

import numpy as np
import pytest

import solve
from derive import Max, Mechanism, cos, rate
from tests.solve.newton.mechanisms import autoparametric, duffing, held_pendulum, model_of
from tests.solve.newton.shooting import doubling, fold, located, period_map, settled, torus

DUFFING = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.3}


@pytest.fixture(scope="module")
def duffing_branch():
    """Branch of q̈ + 0.1 q̇ + q + q³ = 0.3 cos φ from 0.9 to 2.2 rad/s."""
    return solve.branch(model_of(duffing(), **DUFFING), (0.9, 2.2), rtol=1e-9)


def test_folds_of_duffing_equal_shooting(duffing_branch):
    zeta, k, alpha, f = DUFFING.values()

    def mapped(x, speed):
        return period_map(
            lambda phase, q, v, _: f * np.cos(phase) - 2 * zeta * v - k * q - alpha * q**3,
            lambda phase, q, v, _: np.array([[-k - 3 * alpha * q[0] ** 2, -2 * zeta]]),
            speed,
            x,
            1,
            None,
        )

    assert len(duffing_branch.folds) == 2
    for found in duffing_branch.folds:
        at = int(np.flatnonzero(duffing_branch.values == found["speed"])[0])
        A, speed = duffing_branch.peaks[at, 0], found["speed"]
        # One harmonic: phase of q = Re(z e^{iφ}) with modulus A.
        z = f / (k - speed**2 + 0.75 * alpha * A**2 + 2j * zeta * speed)
        z *= A / abs(z)
        exact, _ = located(fold, mapped, [z.real, -z.imag * speed], speed)
        assert speed == pytest.approx(exact, rel=1e-8)
        assert found["spectral_radius"] == pytest.approx(1.0, abs=1e-3)


def test_duffing_branch_is_unstable_between_folds(duffing_branch):
    first, last = np.flatnonzero(duffing_branch.turns)
    verdicts = np.array(duffing_branch.verdicts)
    assert set(verdicts[first + 1 : last]) == {"unstable"}
    assert set(verdicts[:first]) == set(verdicts[last + 1 :]) == {"asymptotically stable"}


def test_slow_sweep_jumps_at_folds(duffing_branch):
    up, down = duffing_branch.jumps
    assert (up["direction"], down["direction"]) == ("up", "down")
    assert [up["speed"], down["speed"]] == [each["speed"] for each in duffing_branch.folds]
    assert up["to"] < up["from"]
    assert down["to"] > down["from"]
    for jump in (up, down):
        beyond = jump["speed"] * (1.001 if jump is up else 0.999)
        orbit = solve.nonlinear(model_of(duffing(), **DUFFING), beyond)
        assert orbit.statistics("q").max_abs == pytest.approx(jump["to"], rel=0.05)


@pytest.mark.slow
def test_jump_states_the_coordinate_with_the_largest_change():
    """A mass hits a stop in one of two uncoupled directions. In the other direction, the motion does not
    change at the folds."""
    made = Mechanism("sieve", "Mass on springs with a stop across")
    x, y = made.coordinates(x=("m", "along"), y=("m", "across"))
    m, c, F, gap = made.parameters(m=("kg", "mass"), c=("N s/m", "damper"), F=("N", "load"), gap=("m", "gap"))
    k, soft = made.parameters(k=("N/m", "spring and stop"), soft=("N/m", "spring along"))
    made.kinetic, made.dissipation = (factor * (rate(x) ** 2 + rate(y) ** 2) / 2 for factor in (m, c))
    made.potential = soft * x**2 / 2 + k * y**2 / 2 + k * Max(0, y - gap) ** 2 / 2
    made.force(F * cos(made.phase), along=x + y / 4)
    sieve = solve.load(made, m=1.0, c=0.05, k=1.0, soft=0.1, F=1.0, gap=1.0)
    branch = solve.branch(sieve, "0.9:1.6 rad/s", rtol=1e-3)
    up, down = branch.jumps
    assert (up["coordinate"], down["coordinate"]) == ("y", "y")
    assert up["from"] > 3 * up["to"] > 0
    assert down["to"] > 3 * down["from"] > 0
    assert branch.summary.count("max|y| from") == 2
    assert branch.plot().axes[-1].get_yscale() == "linear"


PENDULUM = {"c": 0.5, "g": 1.0, "t": 0.0}
SWING = 2 / 3


@pytest.mark.slow
def test_four_doublings_of_a_driven_pendulum_equal_shooting():
    """q̈ + q̇/2 + sin q = F cos(2t/3) (G. L. Baker, J. P. Gollub, Chaotic Dynamics, 1996, chapter 3)."""
    model = model_of(held_pendulum(), **PENDULUM, F=1.05)
    found = solve.branch(model, SWING, over="F=1.05:1.085", switch=True, rtol=1e-9, points=30)
    assert [each["periods"] for each in found.doublings] == [1, 2, 4, 8]

    def acceleration(phase, q, v, F):
        return F * np.cos(phase) - 0.5 * v - np.sin(q)

    def jacobian(phase, q, v, F):
        return np.array([[-np.cos(q[0]), -0.5]])

    # Below each doubling the orbit of that period is stable. Other orbits coexist with it.
    state = np.array([0.1, 0.0])
    for point, below in zip(found.doublings[:3], (1.064, 1.079, 1.08195), strict=True):
        periods = point["periods"]
        state = settled(acceleration, SWING, state, 400, below)
        state[0] = np.remainder(state[0], 2 * np.pi)

        def mapped(x, F, periods=periods):
            after, Phi = period_map(acceleration, jacobian, SWING, x, periods, F)
            return after - [2 * np.pi * np.round((after[0] - x[0]) / 2 / np.pi), 0], Phi

        exact, _ = located(doubling, mapped, state, below)
        assert point["F"] == pytest.approx(exact, rel=1e-8)


COUPLED = {"c": 0.02, "k": 4.0, "ky": 0.85, "alpha": 0.3}
DRIVEN = 1.95


@pytest.mark.slow
def test_torus_of_two_coordinates_equals_shooting():
    """It is on the branch of orbits of two periods that begins at a period doubling, at which ẍ + 0.02 ẋ + 4
    x = F cos φ excites ÿ + 0.02 ẏ + (0.85 + 0.6 x) y = 0 parametrically."""
    model = model_of(autoparametric(), **COUPLED, F=0.04)
    found = solve.branch(model, DRIVEN, over="F=0.04:0.12", switch=True, rtol=1e-9, points=40)
    (point,), (first,) = found.tori, found.doublings
    assert (first["periods"], point["periods"]) == (1, 2)
    c, k, ky, alpha = COUPLED.values()

    def acceleration(phase, q, v, F):
        x, y = q
        return np.array([F * np.cos(phase) - k * x - alpha * y**2, -(ky + 2 * alpha * x) * y]) - c * v

    def jacobian(phase, q, v, F):
        x, y = q
        return np.array([[-k, -2 * alpha * y, -c, 0], [-2 * alpha * y, -ky - 2 * alpha * x, 0, -c]])

    below = 0.0775
    start = settled(acceleration, DRIVEN, [0.0, 0.3, 0.0, 0.0], 1200, below)
    exact, _ = located(torus, lambda x, F: period_map(acceleration, jacobian, DRIVEN, x, 2, F), start, below)
    assert point["F"] == pytest.approx(exact, rel=1e-8)
    assert abs(point["multiplier"].imag) > 0.1
