"""Branching points, at which symmetric orbits lose their symmetry, compared with shooting over half a
period."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import solve
from solve.results.branch import BRANCHING, KINDS
from tests.solve.newton.mechanisms import duffing, held_pendulum, model_of, pendulum

SWING = 2 / 3


def driven(F):
    """Pendulum q̈ + q̇/2 + sin q = F cos(2t/3) (G. L. Baker, J. P. Gollub, Chaotic Dynamics, 1996)."""
    return model_of(held_pendulum(), c=0.5, g=1.0, t=0.0, F=F)


def losing_symmetry(acceleration, jacobian, duration, start):
    """Displacement and velocity at phase 0, and parameter, at which symmetric orbits q(φ + π) = -q(φ) lose
    their symmetry. There, the half-period map -P has the multiplier -1, whose square is the multiplier +1 of
    the period.

    acceleration, jacobian: functions (t, q, v, p) of the parameter p, which return q̈ and ∂q̈/∂(q, q̇).
    duration: function of p that returns half a period. start: initial guess (3,)."""

    def half(x, p):
        def rate(t, y):
            (q, v), Phi = y[:2], y[2:].reshape(2, 2)
            A = np.array([[0.0, 1.0], jacobian(t, q, v, p)])
            return np.concatenate(([v, acceleration(t, q, v, p)], (A @ Phi).ravel()))

        first = np.append(x, np.eye(2).ravel())
        run = solve_ivp(rate, (0, duration(p)), first, "DOP853", rtol=3e-14, atol=1e-14)
        return run.y[:2, -1], run.y[2:, -1].reshape(2, 2)

    def equations(z):
        after, P = half(z[:2], z[2])
        return np.append(after + z[:2], np.linalg.det(P - np.eye(2)))

    found = fsolve(equations, start, xtol=1e-13)
    assert np.abs(equations(found)).max() < 1e-11
    return found


@pytest.fixture(scope="module")
def exact():
    """Displacement at phase 0, and load, at which the orbit of the driven pendulum loses its symmetry."""
    orbit = solve.nonlinear(driven(0.95), SWING)
    found = losing_symmetry(
        lambda t, q, v, F: F * np.cos(SWING * t) - 0.5 * v - np.sin(q),
        lambda t, q, v, F: [-np.cos(q), -0.5],
        lambda F: np.pi / SWING,
        [orbit.q[0, 0], orbit.qd[0, 0], 1.0],
    )
    return found[0], found[2]


@pytest.mark.parametrize(
    ("first", "last", "rtol"), [(0.801, 1.06, 1e-9), (0.97, 1.02, 1e-4), (1.03, 0.9, 1e-6)]
)
def test_symmetric_orbits_of_a_pendulum_lose_their_symmetry(exact, first, last, rtol):
    approach = solve.branch(driven(0.8), SWING, over=f"F=0.8:{first}")
    start = approach.curve(len(approach.values) - 1)
    found = solve.branch(driven(first), SWING, over=f"F={first}:{last}", start=start, rtol=rtol)
    (point,), (displacement, load) = found.branchings, exact
    assert point["F"] == pytest.approx(load, rel=1e-8)
    assert point["multiplier"] == 1
    assert (found.ended, found.folds, found.doublings, found.tori) == ("", [], [], [])
    at = int(np.flatnonzero(found.kinds)[0])
    before, after = ("asymptotically stable", "unstable")[:: 1 if last > first else -1]
    assert set(found.verdicts[:at]) == {before}
    assert set(found.verdicts[at + 1 :]) == {after}
    assert found.verdicts[at] == "undetermined"
    assert found.curve(at)(np.zeros(1))[0, 0] == pytest.approx(displacement, rel=1e-6)
    assert f"Another branch crosses this one at F = {load:.6g}" in found.summary


def test_the_branch_without_symmetry_turns_back_at_the_same_point(exact):
    """It has no fold there."""
    found = solve.branch(driven(1.05), SWING, over="F=1.05:0.9", rtol=1e-8)
    (point,) = found.branchings
    assert point["F"] == pytest.approx(exact[1], rel=1e-8)
    assert found.folds == []
    assert (found.ended, found.values[-1]) == ("", 1.05)
    # The last orbit is the mirrored one, -q(φ + π), apart from full revolutions.
    revolutions = found.figures[[0, -1], 0, 3].sum() / (2 * np.pi)
    assert revolutions == pytest.approx(round(revolutions), abs=1e-6)
    assert np.ptp(found.figures[:, 0, 3]) > 1


def test_edges_of_a_tongue_are_branching_points():
    """At rest, the pendulum obeys q̈ + c q̇ + (g - b Ω² cos φ) q = 0. Between the two speeds at which det(Φ -
    I) = 0, a vibration with the period of the pivot grows."""
    c, b, g = 0.2, 1.0, 1.0

    def closing(speed):
        def rate(phase, y):
            q, v = y.reshape(2, 2)
            return np.append(v, -(c / speed * v + (g / speed**2 - b * np.cos(phase)) * q))

        run = solve_ivp(rate, (0, 2 * np.pi), np.eye(2).ravel(), "DOP853", rtol=3e-14, atol=1e-14)
        return np.linalg.det(run.y[:, -1].reshape(2, 2) - np.eye(2))

    exact = [brentq(closing, *ends, xtol=1e-13) for ends in ((0.94, 0.96), (0.96, 0.98))]
    found = solve.branch(model_of(pendulum(), c=c, b=b, g=g), "0.9:1.3 rad/s", rtol=1e-9)
    assert [point["speed"] for point in found.branchings] == pytest.approx(exact, rel=1e-8)
    assert (found.folds, found.tori) == ([], [])


def test_folds_are_not_branching_points():
    found = solve.branch(model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.3), (0.9, 2.2))
    assert len(found.folds) == 2
    assert found.branchings == []


@pytest.mark.parametrize(("zeta", "f"), [(0.05, 2.0), (0.02, 3.0)])
def test_symmetric_orbits_of_a_buckled_beam_lose_their_symmetry(zeta, f):
    """q̈ + 2ζ q̇ - q + q³ = f cos φ. Real multipliers become complex near the point."""
    found = solve.branch(model_of(duffing(), zeta=zeta, k=-1.0, alpha=1.0, f=f), (2.5, 0.9), rtol=1e-8)
    (point,), (at,) = found.branchings, np.flatnonzero(found.kinds == KINDS.index(BRANCHING)).tolist()
    curve, speed, zero = found.curve(at), point["speed"], np.zeros(1)
    *_, expected = losing_symmetry(
        lambda t, q, v, speed: f * np.cos(speed * t) - 2 * zeta * v + q - q**3,
        lambda t, q, v, speed: [1 - 3 * q**2, -2 * zeta],
        lambda speed: np.pi / speed,
        [curve(zero)[0, 0], speed * curve(zero, 1)[0, 0], speed],
    )
    assert speed == pytest.approx(expected, rel=1e-8)
    assert np.iscomplex(found.multipliers[[at - 1, at + 1]]).any()
    assert (point["multiplier"], found.verdicts[at]) == (1, "undetermined")
