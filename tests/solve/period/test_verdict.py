"""The four verdicts, also for defective multipliers on the unit circle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import mathieu_a, mathieu_b

from solve import Newmark, PeriodicSystem, floquet
from tests.solve.systems import cam, constant, seeds, system

METHODS = ["auto", "radau", "gauss", "fourier", "hill"]


def free(M, C, K):
    M, C, K = (np.asarray(A, dtype=float) for A in (M, C, K))
    return constant(M, C, K, lambda phase: np.zeros((len(phase), len(M))))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("M", "C", "K", "verdict"),
    [
        ([[1]], [[0.1]], [[2]], "asymptotically stable"),
        ([[1]], [[0]], [[2]], "stable"),
        ([[1]], [[-0.1]], [[2]], "unstable"),
        ([[1]], [[0]], [[-2]], "unstable"),
        ([[1]], [[0]], [[0]], "stable"),  # q = a + bt: a rigid-body mode only
        (
            [[1]],
            [[0.3]],
            [[0]],
            "asymptotically stable",
        ),  # q = a + b exp(-ct): a is a rigid-body mode and excluded
        ([[1]], [[0]], [[1]], "stable"),  # Φ = I: a semisimple double multiplier at +1
        ([[1]], [[0]], [[0.25]], "stable"),  # Φ = -I: at -1
        (np.eye(2), np.zeros((2, 2)), 2 * np.eye(2), "stable"),  # a pair twice, semisimple
        (np.eye(2), np.zeros((2, 2)), np.diag([2, 2 + 1e-7]), "stable"),  # nearly so
        (np.eye(2), np.zeros((2, 2)), [[2, 1], [0, 2]], "undetermined"),  # the same pair, defective
        (np.eye(2), np.diag([0.1, 0]), np.diag([2, 3]), "stable"),
        (np.diag([1, 2, 3]), np.zeros((3, 3)), [[1, -1, 0], [-1, 2, -1], [0, -1, 1]], "stable"),  # a chain
        (np.eye(2), np.diag([0.1, -1e-3]), np.diag([2, 3]), "unstable"),
        (np.eye(3), np.zeros((3, 3)), np.diag([1, 4, 0.3]), "stable"),
    ],
)
def test_verdicts_of_constant_coefficients(method, M, C, K, verdict):
    stability = floquet(free(M, C, K), 1.0, method)
    assert stability.verdict == verdict or is_inaccurate(stability)


def is_inaccurate(computed):
    """Whether the verdict is undetermined because round-off splits multiple exponents of a series."""
    error = computed.error_estimate.multipliers * computed.spectral_radius
    return computed.method in {"fourier", "hill"} and computed.verdict == "undetermined" and error > 1e-6


@pytest.mark.parametrize(("method", "steps"), [("radau", 2), ("rk4", 16), ("newmark", 24)])
def test_unresolved_growth_is_never_called_stable(method, steps):
    """|ρ| = exp(0.2π) = 1.874."""
    growing = free([[1]], [[-0.2]], [[30.3]])
    assert floquet(growing, 1.0, method, steps=steps, rtol=0.9).verdict in {"undetermined", "unstable"}
    assert floquet(growing, 1.0).spectral_radius == pytest.approx(np.exp(0.2 * np.pi), rel=1e-8)


def test_units_do_not_hide_growth():
    """q1 grows as exp(0.1 t), whatever the unit of q2."""
    scaled = free(np.eye(2), np.diag([-0.2, 0.1]), [[4.3, 1e18], [0, 9.7]])
    stability = floquet(scaled, 1.0)
    assert stability.verdict == "unstable"
    assert stability.unresolved == 0
    moduli = np.exp(2 * np.pi * np.array([0.1, 0.1, -0.05, -0.05]))
    np.testing.assert_allclose(np.abs(stability.multipliers), moduli, rtol=1e-8)


@pytest.mark.parametrize(
    ("growth", "verdict"), [(-1e-7, "asymptotically stable"), (1e-7, "unstable"), (1e-12, "stable")]
)
def test_multiplier_within_1e_9_of_one_counts_as_one(growth, verdict):
    stability = floquet(free([[1]], [[-2 * growth]], [[2]]), 1.0, rtol=1e-10)
    assert stability.verdict == verdict
    assert stability.stable == (verdict != "unstable")


def test_growth_below_the_grid_error_leaves_the_verdict_undetermined():
    slow = free([[1]], [[-2e-4]], [[2]])
    coarse = floquet(slow, 1.0, "rk4", steps=12, rtol=0.5)
    assert (coarse.verdict, coarse.stable) == ("undetermined", None)
    assert floquet(slow, 1.0, "rk4", steps=2000, rtol=0.5).verdict == "unstable"


@pytest.mark.parametrize("growth", [-5e-7, 5e-7])
def test_growth_near_1e_6_leaves_the_verdict_undetermined(growth):
    """|ρ| = 1 + growth; the error with 76 steps is slightly below 1e-6."""
    slow = free([[1]], [[-growth / np.pi]], [[0.5]])
    stability = floquet(slow, 1.0, "rk4", steps=76)
    assert stability.spectral_radius == pytest.approx(1 + growth, abs=1e-7)
    assert 6e-7 < stability.error_estimate.multipliers < 1e-6
    assert stability.verdict == "undetermined"


@pytest.mark.parametrize("stiffness", [3e3, 2e4])
def test_undamped_system_is_stable_even_with_a_loose_tolerance(stiffness):
    """The multipliers of an undamped system lie on the unit circle. They are computed to 1e-6 with any
    tolerance."""
    stability = floquet(free([[1.0]], [[0.0]], [[stiffness]]), 1.0, "gauss", rtol=1e-3)
    assert stability.verdict == "stable"
    assert stability.error_estimate.multipliers <= 1e-6


def test_huge_multipliers_give_a_verdict_without_numerical_warnings():
    """The product of the relative error 1e272 and the spectral radius 1e265 exceeds the range of floating
    point."""
    chosen = floquet(cam(), "100 rpm", Newmark(0.25, 1 / 6), steps=10_000, rtol=0.5)
    assert chosen.spectral_radius > 1e100
    assert chosen.verdict in {"undetermined", "unstable"}
    assert any("gives the multipliers to" in text for text in chosen.warnings)


def mathieu(delta, epsilon):
    def matrices(phase, speed):
        one, zero = np.ones((len(phase), 1, 1)), np.zeros((len(phase), 1, 1))
        return one, zero, (delta + epsilon * np.cos(2 * phase))[:, None, None], zero[:, 0]

    return system(matrices, 1, period=np.pi)


@pytest.mark.parametrize("epsilon", [0.3, 2.0, 8.0])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_mathieus_equation_is_unstable_inside_its_tongues_only(order, epsilon):
    """It is unstable between b_k and a_k (q = ε/2), and stable outside."""
    low, high = mathieu_b(order, epsilon / 2), mathieu_a(order, epsilon / 2)
    inside = min(1e-3, (high - low) / 4)
    assert low < high
    for delta in (low + inside, (low + high) / 2, high - inside):
        assert floquet(mathieu(delta, epsilon), 1.0).verdict == "unstable"
    for delta in (low - 1e-3, high + 1e-3):
        assert floquet(mathieu(delta, epsilon), 1.0).verdict == "stable"


@pytest.mark.parametrize("method", ["auto", "fourier", "hill"])
@pytest.mark.parametrize("epsilon", [0.5, 3.0])
@pytest.mark.parametrize("characteristic", [mathieu_a, mathieu_b])
@pytest.mark.parametrize("order", [1, 2])
def test_double_multiplier_on_a_boundary_is_defective(characteristic, order, epsilon, method):
    """One solution is periodic, and the other one grows linearly with time. A change of δ by 1e-16 would
    change this."""
    stability = floquet(mathieu(characteristic(order, epsilon / 2), epsilon), 1.0, method, rtol=1e-11)
    np.testing.assert_allclose(stability.multipliers, (-1.0) ** order, rtol=0, atol=1e-5)
    assert np.abs(stability.multipliers - (-1.0) ** order).max() <= 10 * stability.error_estimate.multipliers
    assert stability.verdict == "undetermined"
    assert is_inaccurate(stability) or any(
        "lie on the unit circle or coincide on it" in warning for warning in stability.warnings
    )


@pytest.mark.parametrize(
    "method", [*METHODS[:3], *(pytest.param(m, marks=pytest.mark.slow) for m in METHODS[3:])]
)
@pytest.mark.parametrize(
    ("K", "verdict"),
    [([[0, 1], [0, 0]], "unstable"), (np.diag([0, 1e4]), "stable"), (np.diag([1, 0]), "stable")],
)
def test_motion_relative_to_a_rigid_body_mode_may_drift(method, K, verdict):
    """The drift q = a + bt of one coordinate is excluded. In the second case, it drives another drift."""
    stability = floquet(free(np.eye(2), np.zeros((2, 2)), K), 1.0, method)
    assert stability.verdict == verdict or is_inaccurate(stability)


@given(seeds, st.integers(1, 3))
@settings(max_examples=25, deadline=None)
def test_sign_of_the_damping_decides_the_verdict(seed, n):
    rng = np.random.default_rng(seed)
    A, B = rng.standard_normal((2, n, n))
    K, C = A @ A.T + np.eye(n), B @ B.T + 0.1 * np.eye(n)
    assert floquet(free(np.eye(n), C, K), 1.0).verdict == "asymptotically stable"
    assert floquet(free(np.eye(n), 0 * C, K), 1.0).verdict == "stable"
    assert floquet(free(np.eye(n), -C, K), 1.0).verdict == "unstable"


def test_rigid_body_mode_with_a_stiff_mode_is_excluded():
    """The motion q1 = a + bt occurs together with an undamped stiff mode."""
    for stiffness in (1e2, 1e4, 1e6):
        stability = floquet(free(np.eye(2), np.zeros((2, 2)), np.diag([0.0, stiffness])), 1.0)
        assert stability.verdict == "stable"
        assert stability.rigid_body_modes[0].vector == (1.0, 0.0)


def test_multipliers_are_sorted_by_modulus_and_imaginary_part():
    computed = floquet(free(np.eye(3), np.diag([0.3, 0.1, 0.9]), np.diag([2.0, 3.0, 0.01])), 1.0).multipliers
    assert (np.diff(np.abs(computed)) <= 1e-12).all()
    complex_ones = np.flatnonzero(np.abs(computed.imag) > 1e-9)
    assert len(complex_ones) == 4
    assert (computed.imag[complex_ones[::2]] > 0).all()
    np.testing.assert_array_equal(computed[complex_ones[::2]].conj(), computed[complex_ones[1::2]])


@pytest.mark.parametrize("speed", [1e5, 1e6])
def test_undamped_slow_mode_is_stable(speed):
    """The multipliers exp(±2πi ω/Ω) are near +1 and near each other, but their distance exceeds their
    errors."""
    assert floquet(free([[1.0]], [[0.0]], [[3.3]]), speed).verdict == "stable"


@pytest.mark.parametrize(
    ("detuning", "verdict"),
    [(1e-4, "stable"), (1e-5, "stable"), (1e-6, "stable"), (1e-15, "undetermined"), (0.0, "undetermined")],
)
def test_one_way_coupling_is_stable_if_detuning_exceeds_round_off(detuning, verdict):
    """K = [[3.3, 1], [0, 3.3 + detuning]]: linear growth at resonance, bounded motion otherwise."""
    K = np.array([[3.3, 1.0], [0.0, 3.3 + detuning]])
    assert floquet(free(np.eye(2), np.zeros((2, 2)), K), 1.0).verdict == verdict


@given(seeds, st.integers(2, 4), st.sampled_from([0.0, 1e-6]))
@settings(max_examples=25, deadline=None)
def test_drift_of_a_free_chain_is_excluded(seed, n, ground):
    """Masses are connected by springs and dampers, in units of any size. In the drift, q = v t is the same
    for all masses."""
    rng = np.random.default_rng(seed)
    k, c = rng.uniform(0.5, 2, n - 1), rng.uniform(0, 0.2, n - 1)
    joints = np.eye(n - 1, n) - np.eye(n - 1, n, k=1)
    held = np.zeros((n, n))
    held[0, 0] = ground
    unit = 10 ** rng.uniform(-4, 4, n)
    M, C, K = (
        np.outer(unit, unit) * each
        for each in (np.diag(rng.uniform(0.5, 2, n)), joints.T * c @ joints, joints.T * k @ joints + held)
    )
    stability = floquet(free(M, C, K), 1.0)
    assert stability.verdict != "unstable"
    assert len(stability.rigid_body_modes) == (ground == 0)
    for mode in stability.rigid_body_modes:
        assert not mode.damped
        np.testing.assert_allclose(np.array(mode.vector) * unit, mode.vector[0] * unit[0], rtol=1e-10)


def test_short_stiffness_pulse_prevents_a_rigid_body_drift():
    """K is 1e-3 during 1e-4 of a revolution: ρ = 1 ± 7.9e-4 i."""
    start = 2 * np.pi * 10.1 / 128

    def matrices(phase, speed):
        one, zero = np.ones((len(phase), 1, 1)), np.zeros((len(phase), 1, 1))
        pulse = 1e-3 * ((phase >= start) & (phase < start + 1e-4))
        return one, zero, pulse[:, None, None], zero[:, 0]

    held = PeriodicSystem(matrices, ["q"], breaks=(start, start + 1e-4))
    assert floquet(held, 1.0).verdict == "stable"


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6])
def test_drift_coupled_to_another_coordinate_is_excluded(unit):
    """q = (v t, 0.35 v) is a solution."""
    D = np.diag([1.0, unit])
    stability = floquet(free(D @ D, D @ [[0, 0.7], [-0.7, 0]] @ D, D @ np.diag([0.0, 2.0]) @ D), 1.0)
    assert stability.verdict == "stable"
    assert stability.rigid_body_modes[0].vector == (1.0, 0.0)


@pytest.mark.parametrize("seed", [0, 11, 24, 45])
@pytest.mark.parametrize("method", ["gauss", "radau"])
def test_error_covers_a_triple_defective_multiplier(seed, method):
    """Three equal modes, each of which drives the next, in other axes: |ρ| = exp(-1e-6 π)."""
    Q = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    K = Q.T @ (2 * np.eye(3) + np.eye(3, k=1)) @ Q
    stability = floquet(free(np.eye(3), 1e-6 * np.eye(3), K), 1.0, method, rtol=1e-3)
    assert abs(stability.spectral_radius - np.exp(-1e-6 * np.pi)) <= 10 * stability.error_estimate.multipliers
    assert stability.verdict == "undetermined"


@pytest.mark.parametrize("coupling", [1e-2, 1e-4, 1e-6])
def test_weak_one_way_coupling_at_equal_frequencies_is_not_stable(coupling):
    assert floquet(free(np.eye(2), np.zeros((2, 2)), [[2, coupling], [0, 2]]), 1.0).verdict == "undetermined"


@pytest.mark.parametrize(("k", "ground"), [(1e6, 1e-8), (1e4, 1e-10), (1.0, 1e-14)])
def test_weak_spring_prevents_a_rigid_body_drift(k, ground):
    stability = floquet(free(np.eye(2), np.zeros((2, 2)), [[k + ground, -k], [-k, k]]), 1.0)
    assert stability.verdict in {"stable", "undetermined"}


@pytest.mark.parametrize("k", [2500.0, 1e4])
def test_growth_by_hundreds_of_decades_is_unstable(k):
    """|ρ| = exp(2π sqrt(k)), whose square overflows."""
    stability = floquet(free([[1.0]], [[0.0]], [[-k]]), 1.0)
    assert stability.verdict == "unstable"
    assert np.log(stability.spectral_radius) == pytest.approx(2 * np.pi * np.sqrt(k), rel=1e-8)
