"""Stability for M, C and K that are constant over the period: closed forms, single solutions, and number of
solutions."""

import numpy as np
import pytest

import solve
from solve.batch.batch import Batch
from solve.batch.family import over_speed
from solve.batch.task import task_of
from solve.studies.constant_coefficients import constant_coefficients
from tests.solve.period.test_rigid_body import CHAIN, chain
from tests.solve.systems import system

INERTIA = np.diag([3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05])
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def system_of(matrices, n):
    """System with M, C, K = matrices(speed), and a load with harmonics 0 to 2."""

    def at(phase, speed):
        load = np.zeros((len(phase), n))
        load[:, 0] = 1 + np.cos(phase) + np.sin(2 * phase)
        return (*(np.broadcast_to(A, (len(phase), n, n)).astype(float) for A in matrices(speed)), load)

    return system(at, n)


def free_chain(anchor=0.0):
    K = chain(CHAIN) + np.diag([anchor, 0, 0, 0, 0])
    return system_of(lambda speed: (INERTIA, 0 * K, K), 5)


def shaft(k2):
    """Unbalanced shaft with the stiffnesses 1 and k2 in rotating coordinates, unstable between √1 and √k2 (S.
    H. Crandall, P. J. Brosens, J. Appl. Mech. 28 (1961) 567-570)."""
    return system_of(
        lambda speed: (np.eye(2), 2 * speed * TURN, np.diag([1.0, k2]) - speed**2 * np.eye(2)), 2
    )


@pytest.fixture
def solutions(monkeypatch):
    """Counter of the points that are solved on grids."""
    counted = [0]
    solved = Batch.solved

    def counting(self, points):
        counted[0] += len(points)
        return solved(self, points)

    monkeypatch.setattr(Batch, "solved", counting)
    return counted


@pytest.mark.parametrize("anchor", [0.0, 0.1])
def test_bands_of_a_chain_require_no_solution(solutions, anchor):
    bands = solve.bands(free_chain(anchor), "500:3000:30 rpm")
    assert list(bands) == []
    assert bands.constant_matrices
    assert [text.split(":")[0] for text in bands.notes] == ["rigid-body modes"] * (anchor == 0)
    assert solutions == [0]
    np.testing.assert_allclose(bands.spectral_radius, 1.0, atol=1e-11)


@pytest.mark.parametrize("k2", [1.5, 1.01, 1.0001])
def test_shaft_of_two_stiffnesses_is_unstable_between_its_critical_speeds(solutions, k2):
    (band,) = solve.bands(shaft(k2), [0.3, 2.0])
    assert (band.low, band.high) == pytest.approx((1.0, np.sqrt(k2)), rel=2e-7)
    assert band.kind == "+1"
    middle = (1 + np.sqrt(k2)) / 2
    assert band.spectral_radius == pytest.approx(
        solve.floquet(shaft(k2), middle).spectral_radius, rel=0.05 * (np.sqrt(k2) - 1)
    )
    assert solutions[0] <= 1


def test_internal_damping_makes_a_rotor_unstable_above_its_threshold():
    """The threshold is ω0 (1 + outer / inner damping) (E. J. Gunter, NASA SP-113, 1966)."""
    outer, inner = 0.02, 0.03

    def matrices(speed):
        return np.eye(2), (outer + inner) * np.eye(2), np.eye(2) - inner * speed * TURN

    (band,) = solve.bands(system_of(matrices, 2), [0.3, 4.0])
    assert band.low == pytest.approx(1 + outer / inner, rel=2e-7)
    assert (band.kind, band.open_high) == ("complex", True)
    growth = np.real(np.roots([1, outer + inner, 1 - 4j * inner])).max()
    assert band.spectral_radius == pytest.approx(np.exp(growth * 2 * np.pi / 4.0), rel=1e-9)


def test_narrow_band_of_flutter_is_found():
    """K = [[1, p], [-p, 1.2]] leads to flutter for p > 0.1. Near speed 2, p exceeds this value."""

    def matrices(speed):
        p = 0.1001 * np.exp(-50 * (speed - 2) ** 2)
        return np.eye(2), np.zeros((2, 2)), np.array([[1.0, p], [-p, 1.2]])

    (band,) = solve.bands(system_of(matrices, 2), [0.3, 4.0])
    half = np.sqrt(np.log(1.001) / 50)
    assert (band.low, band.high) == pytest.approx((2 - half, 2 + half), abs=4e-7)


@pytest.mark.parametrize("seed", range(8))
def test_verdicts_agree_with_the_solver(seed):
    """Damped, gyroscopic, circulatory and free systems at five speeds each."""
    draw = np.random.default_rng(seed)
    n = 3
    A, B, G, P = draw.standard_normal((4, n, n))
    M, K = A @ A.T + np.eye(n), B @ B.T + 0.3 * np.eye(n)
    C = 0.05 * np.eye(n) * draw.integers(0, 2) + 0.3 * (G - G.T)
    K = K + 0.3 * draw.integers(0, 2) * (P - P.T)
    if seed % 4 == 3:
        M, C, K = np.eye(n), np.zeros((n, n)), chain(draw.uniform(0.5, 5, n - 1))
    made = system_of(lambda speed: (M, speed * C, K), n)
    points = draw.uniform(0.5, 3.0, 5)[:, None]
    task, _ = task_of(over_speed(made), "auto", 1e-10, "auto", orbit=False)
    steady = constant_coefficients(task.batch(points))
    assert steady is not None
    stability = steady.evaluate(points)
    for at, speed in enumerate(points[:, 0].tolist()):
        rate = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, speed * C)]]
        )
        modulus = np.exp(np.linalg.eigvals(rate).real.max() * 2 * np.pi / speed)
        assert not stability.failed[at]
        assert stability.unstable[at] == (modulus > 1 + 1e-5)
        assert abs(stability.multipliers[at, 0]) == pytest.approx(modulus, rel=1e-6)


def test_slightly_varying_matrices_are_not_constant():
    K = chain([1.0, 2.0]) + np.eye(3)

    def at(phase, speed):
        wave = (1 + 1e-11 * np.cos(phase))[:, None, None]
        return (
            np.broadcast_to(np.eye(3), (len(phase), 3, 3)),
            0 * wave * K,
            wave * K,
            np.zeros((len(phase), 3)),
        )

    task, _ = task_of(over_speed(system(at, 3)), "auto", 1e-8, "auto", orbit=False)
    assert constant_coefficients(task.batch(np.array([[1.0], [2.0]]))) is None


def test_approximate_methods_give_their_own_verdict():
    task, _ = task_of(over_speed(shaft(1.5)), "modal", 1e-8, "auto", orbit=False)
    assert constant_coefficients(task.batch(np.array([[1.0], [2.0]]))) is None


def test_chart_of_a_chain_searches_no_tongues(solutions):
    def build(k1, anchor):
        K = chain([k1, *CHAIN[1:]]) + np.diag([anchor, 0, 0, 0, 0])
        return system_of(lambda speed: (INERTIA, 0 * K, K), 5)

    chart = solve.chart(build, "k1=11e3:13e3:5", "anchor=1:10:4", "1000 rpm")
    assert chart.boundaries == []
    assert solutions == [20]


def test_chart_of_rotors_finds_the_threshold():
    """The threshold ω0 (1 + outer / inner) as a function of the outer damping."""

    def build(outer, speed):
        K = np.eye(2) - 0.03 * speed * TURN
        return system_of(lambda _: (np.eye(2), (outer + 0.03) * np.eye(2), K), 2)

    chart = solve.chart(lambda outer, w: build(outer, w), "outer=0.01:0.03:5", "w=1:3:9", 1.0)
    (curve,) = chart.boundaries
    np.testing.assert_allclose(curve.points[:, 1], 1 + curve.points[:, 0] / 0.03, rtol=1e-8)
