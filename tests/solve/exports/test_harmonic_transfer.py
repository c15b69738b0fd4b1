"""Harmonic transfer functions, compared with closed forms, Floquet exponents and periodic orbits."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from solve.errors import NoMotionError, ValueOutOfBoundsError
from tests.solve.references import rate_matrices
from tests.solve.systems import constant, system


def damped_mathieu(phase, speed):
    one = np.ones((len(phase), 1, 1))
    return one, 0.2 * one, (4.0 + 1.5 * np.cos(phase))[:, None, None], np.cos(phase)[:, None]


MATHIEU = system(damped_mathieu, 1)


def harmonics_of(signal, period, N):
    """Return the complex Fourier coefficients -N … N of a signal (k, …) from its samples."""
    phase = np.arange(512) * (period / 512)
    spectrum = np.fft.fft(signal(phase)) / 512
    return spectrum[np.arange(-N, N + 1)]


def test_constant_coefficients_give_the_ordinary_transfer_matrix():
    """The diagonal is (s_k² M + s_k C + K)⁻¹ at s_k = s + ikΩ. All other entries are zero."""
    rng = np.random.default_rng(1)
    M, C, K = np.diag([1.0, 2.0]), 0.1 * rng.standard_normal((2, 2)), np.array([[5.0, 1.0], [0.5, 9.0]])
    speed, s, N = 3.0, 0.2 + 0.7j, 2
    H = solve.harmonic_transfer(constant(M, C, K, lambda phase: np.zeros((len(phase), 2))), speed, N).at(s)
    for i in range(-N, N + 1):
        for k in range(-N, N + 1):
            at = s + 1j * k * speed
            expected = np.linalg.inv(at**2 * M + at * C + K) if i == k else 0
            np.testing.assert_allclose(H.values[i + N, :, k + N], expected, rtol=1e-10, atol=1e-12)
    assert H.error <= 1e-10
    assert H.warnings == []


def test_modulated_force_response_matches_time_integration():
    """The force is u = Re exp((s + iΩ)t). With the initial state from H, time integration gives y = Σ H
    y_k."""
    speed, s, N = 1.3, 0.05 + 0.4j, 12
    H = solve.harmonic_transfer(MATHIEU, speed, N).at(s).values[:, 0, N + 1, 0]
    rates = s + 1j * speed * np.arange(-N, N + 1)

    def state(t):
        waves = H * np.exp(rates * t)
        return np.real([waves.sum(), (rates * waves).sum() / speed])

    def rate(t, x):
        P, _ = rate_matrices(MATHIEU, [speed * t], speed)
        u = np.real(np.exp((s + 1j * speed) * t))
        return speed * (P[0] @ x + [0.0, u / speed**2])

    end = 9.0
    ran = solve_ivp(rate, (0.0, end), state(0.0), "DOP853", rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(ran.y[:, -1], state(end), rtol=1e-7)


def test_response_to_the_load_equals_the_periodic_orbit():
    N = 20
    for given, speed in ((MATHIEU, 1.3), (solve.load("coupler"), 60.0)):
        transfer = solve.harmonic_transfer(given, speed, N)
        steady = np.einsum("iokj,kj->io", transfer.at(0.0).values, transfer.excitation) + transfer.rest
        orbit = solve.periodic(given, speed)
        for column, name in zip(steady.T, given.coordinates, strict=False):
            expected = harmonics_of(orbit.signal(name), given.period, N)
            np.testing.assert_allclose(column, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_response_of_a_model_output_matches_the_orbit():
    """The drive torque of the manipulator is linear in its state. Its load has no harmonics beyond those
    included."""
    model, N = solve.load("manipulator"), 20
    transfer = solve.harmonic_transfer(model, "50 rpm", N)
    steady = np.einsum("iokj,kj->io", transfer.at(0.0).values, transfer.excitation) + transfer.rest
    torque = harmonics_of(solve.periodic(model, "50 rpm").signal("drive_torque"), model.period, N)
    column = steady[:, transfer.signals.outputs.index("drive_torque")]
    np.testing.assert_allclose(column, torque, rtol=0, atol=1e-8 * np.abs(torque).max())


@pytest.mark.slow
def test_transfer_about_a_nonlinear_orbit_reproduces_that_orbit():
    """The nonlinear outputs also agree, except for harmonics above N. The linear orbit differs by at least 35
    %."""
    model, N, speed = solve.load("manipulator"), 60, "300 rpm"
    orbit, linear = solve.nonlinear(model, speed), solve.periodic(model, speed)
    transfer = solve.harmonic_transfer(orbit.system, speed, N)
    steady = np.einsum("iokj,kj->io", transfer.at(0.0).values, transfer.excitation) + transfer.rest
    for column, name in zip(steady.T, (*model.coordinates, *model.outputs), strict=True):
        expected = harmonics_of(orbit.signal(name), model.period, N)
        largest = np.abs(expected).max()
        np.testing.assert_allclose(column, expected, rtol=0, atol=1e-5 * largest)
        assert np.abs(harmonics_of(linear.signal(name), model.period, N) - expected).max() > 0.3 * largest


def test_harmonics_are_multiples_of_the_matrix_frequency():
    """Mathieu's matrices have the period π. The harmonics are therefore multiples of 2 rad/s."""
    model = solve.load("mathieu", delta=1.3, epsilon=0.4, zeta=0.05)
    assert solve.harmonic_transfer(model, 1.0).rotation == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["mathieu", "meissner", "own"])
def test_poles_are_the_shifted_floquet_exponents(name):
    pytest.importorskip("control", reason="python-control is not installed")
    numbers = {"mathieu": {"delta": 1.3, "epsilon": 0.4, "zeta": 0.05}}
    given = MATHIEU if name == "own" else solve.load(name, **numbers.get(name, {}))
    transfer = solve.harmonic_transfer(given, 1.3, 3, orders=60)
    poles = transfer.lifted().poles()
    for exponent in solve.floquet(given, 1.3).exponents:
        for k in range(-3, 4):
            copy = exponent + 1j * k * transfer.rotation
            assert np.abs(poles - copy).min() < 1e-6 * transfer.rotation


def test_real_and_complex_forms_agree():
    """The cosine and sine amplitudes of an output at s, due to those of a force, are sums of entries of H."""
    pytest.importorskip("control", reason="python-control is not installed")
    s, N = 0.1 + 0.6j, 2
    transfer = solve.harmonic_transfer(MATHIEU, 1.3, N, orders=12)
    lifted, H = transfer.lifted(), transfer.at(s).values[:, 0, :, 0]
    computed = lifted(s)
    c1, s1, mean = (lifted.input_labels.index(f"force_q1_{part}") for part in ("c1", "s1", "0"))
    y_c2, y_s2 = (lifted.output_labels.index(f"q1_{part}") for part in ("c2", "s2"))
    plus, minus = 2 + N, -2 + N
    # cos φ is half of order 1 and half of order -1; a cosine amplitude is the sum of both orders.
    cosine = (H[:, 1 + N] + H[:, -1 + N]) / 2
    sine = (H[:, 1 + N] - H[:, -1 + N]) / 2j
    np.testing.assert_allclose(computed[y_c2, c1], cosine[plus] + cosine[minus], rtol=1e-9)
    np.testing.assert_allclose(computed[y_s2, c1], 1j * (cosine[plus] - cosine[minus]), rtol=1e-9)
    np.testing.assert_allclose(computed[y_c2, s1], sine[plus] + sine[minus], rtol=1e-9)
    np.testing.assert_allclose(computed[y_c2, mean], H[plus, N] + H[minus, N], rtol=1e-9)
    assert lifted.A.dtype == float


def test_insufficient_truncation_raises_a_warning():
    few = solve.harmonic_transfer(MATHIEU, 0.1, 2, orders=3)
    (warning,) = few.warnings
    assert "3 of at most" in warning
    assert "more orders" in warning
    truth = solve.harmonic_transfer(MATHIEU, 0.1, 2).at(1.9j).values
    computed = few.at(1.9j)
    assert computed.warnings
    off = np.abs(computed.values - truth).max() / np.abs(truth).max()
    assert 1e-8 < off < 2 * computed.error


@pytest.mark.slow
def test_large_structure_warns_about_limited_harmonics():
    """The frequencies of its modes exceed the harmonics that a dense balance can include."""
    beams = solve.load("four_bar")
    (warning,) = solve.harmonic_transfer(beams, "30 rad/s", 10).warnings
    assert "27 of at most 27 orders of the states" in warning
    assert warning.endswith("give a larger rtol")


def test_slow_convergence_at_jumps_raises_a_warning():
    transfer = solve.harmonic_transfer(solve.load("meissner"), 1.0, 2, orders=20, rtol=1e-10)
    assert "the matrices jump" in transfer.warnings[0]
    finer = solve.harmonic_transfer(solve.load("meissner"), 1.0, 2, orders=200).at(0.3 + 0.1j)
    computed = transfer.at(0.3 + 0.1j)
    assert np.abs(computed.values - finer.values).max() / np.abs(finer.values).max() < 2 * computed.error


def test_invalid_requests_are_refused():
    with pytest.raises(NoMotionError, match="portal_frame"):
        solve.harmonic_transfer(solve.load("portal_frame"), 1.0)
    with pytest.raises(ValueOutOfBoundsError, match="harmonics is -1; allowed for 1 coordinate: 0"):
        solve.harmonic_transfer(MATHIEU, 1.0, -1)
    with pytest.raises(ValueOutOfBoundsError, match="orders is 3; allowed for 1 coordinate and 4 harmonics"):
        solve.harmonic_transfer(MATHIEU, 1.0, 4, orders=3)
    with pytest.raises(ValueOutOfBoundsError, match=r"s is .*nan"):
        solve.harmonic_transfer(MATHIEU, 1.0, 1).at(complex("nan"))
    for wrong in ("a", None, [0.0, 1j]):
        with pytest.raises(ValueOutOfBoundsError, match="one at a time"):
            solve.harmonic_transfer(MATHIEU, 1.0, 1).at(wrong)


def test_repr_lists_signals():
    text = repr(solve.harmonic_transfer(MATHIEU, "1 rad/s", 2, orders=30))
    assert text.splitlines()[0].endswith("orders -2 … 2")
    assert "with 30 orders of the states" in text
