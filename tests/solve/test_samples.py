"""Systems from samples at azimuths: known multipliers, and the interpolation error."""

import numpy as np
import pytest

import solve
from solve import FirstOrderSystem, MixedSystem, PeriodicSystem, SolveError
from tests.solve.first_order_systems import (
    error,
    first_order,
    names,
    orbit_difference,
    swaying,
    with_load,
)


def uniform(count):
    return np.arange(count) * (2 * np.pi / count)


def irregular(rng, count):
    """Return azimuths in random order that differ from a uniform grid by up to 0.3 of its spacing."""
    azimuths = (np.arange(count) + 0.6 * rng.uniform(-0.5, 0.5, count)) * (2 * np.pi / count)
    return rng.permutation(azimuths)


def three_blades(stiffness=1.3, inplane=0.06, hub=0.9, coupling=0.15, speed=1.0):
    """Flapping β of three equal blades in the rotating frame and tilt η of their hub in the fixed frame:
    A(phase) of x = (β, η, β̇, η̇), and the multipliers of the multi-blade coordinates, whose equations are
    constant."""
    azimuths = 2 * np.pi / 3 * np.arange(3)

    def rows(phase):
        """Return cos and sin of the azimuths of the blades, (m, 2, 3)."""
        angles = phase[:, None] + azimuths
        return np.stack((np.cos(angles), np.sin(angles)), axis=1)

    def A(phase, omega):
        m, waves = len(phase), rows(phase)
        M, C, K = np.zeros((3, m, 5, 5))
        M[:] = np.eye(5)
        M[:, 3:, :3], M[:, :3, 3:] = coupling * waves, coupling * np.swapaxes(waves, 1, 2)
        C[:] = np.diag([inplane] * 3 + [0.02] * 2)
        K[:] = np.diag([stiffness] * 3 + [hub] * 2)
        return states_of(M, C, K)

    # β_b = β0 + βc cos ψ_b + βs sin ψ_b with η: constant M, C, K of (β0, βc, βs, ηc, ηs).
    T0 = np.column_stack((np.ones(3), np.cos(azimuths), np.sin(azimuths)))
    S = speed * np.array([[0, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    M, C, K = np.zeros((3, 5, 5))
    inverse = np.linalg.inv(T0)
    M[:3, :3], C[:3, :3], K[:3, :3] = (
        np.eye(3),
        2 * S + inplane * np.eye(3),
        S @ S + inplane * S + stiffness * np.eye(3),
    )
    waves = rows(np.zeros(1))[0]
    M[:3, 3:] = coupling * inverse @ waves.T
    of_hub = coupling * waves @ T0
    M[3:, 3:], C[3:, 3:], K[3:, 3:] = np.eye(2), 0.02 * np.eye(2), hub * np.eye(2)
    M[3:, :3], C[3:, :3], K[3:, :3] = of_hub, 2 * of_hub @ S, of_hub @ S @ S
    constant = states_of(M[None], C[None], K[None])[0]
    return A, np.exp(2 * np.pi / speed * np.linalg.eigvals(constant).astype(complex))


def states_of(M, C, K):
    """Return A (m, 2n, 2n) of M q̈ + C q̇ + K q = 0."""
    n = M.shape[-1]
    A = np.zeros((len(M), 2 * n, 2 * n))
    A[:, :n, n:], A[:, n:, :n], A[:, n:, n:] = np.eye(n), -np.linalg.solve(M, K), -np.linalg.solve(M, C)
    return A


def sampled(A, N, azimuths, phases=None):
    values, load = with_load(A)(azimuths, 1.0)
    return FirstOrderSystem.from_samples(values, load, names("x", N), phases)


@pytest.mark.parametrize("count", [12, 24, 36])
def test_three_blades_have_the_multiblade_multipliers(count):
    A, exact = three_blades()
    found = solve.floquet(sampled(A, 10, uniform(count)), 1.0)
    assert error(found, exact) < 1e-10
    assert error(found, exact) <= 10 * found.error_estimate.multipliers
    assert found.interpolation_error.sufficient == count
    assert not found.warnings


@pytest.mark.parametrize("count", [7, 8, 9, 12, 18, 24])
@pytest.mark.parametrize("kind", ["uniform", "irregular"])
def test_interpolation_errors_are_within_their_estimates(count, kind):
    for seed in range(3):
        rng = np.random.default_rng(seed + 10 * count)
        A, exact = swaying(rng, 2 + seed, 0.8)
        azimuths = uniform(count) if kind == "uniform" else irregular(rng, count)
        orbit = solve.periodic(sampled(A, 2 + seed, azimuths, azimuths), 1.0)
        better = solve.periodic(first_order(A, 2 + seed), 1.0, rtol=1e-10)
        assert error(orbit, exact) <= 10 * orbit.error_estimate.multipliers
        assert orbit_difference(orbit, better, 2 + seed) <= 10 * orbit.error_estimate.orbit


def test_stated_number_of_azimuths_is_sufficient():
    A, exact = swaying(np.random.default_rng(1), 3, 0.8)
    few = solve.periodic(sampled(A, 3, uniform(8)), 1.0, rtol=1e-6)
    enough = few.interpolation_error.sufficient
    assert any(f"about {enough} azimuths suffice" in text for text in few.warnings)
    assert few.error_estimate.orbit > 1e-6
    many = solve.periodic(sampled(A, 3, uniform(enough)), 1.0, rtol=1e-6)
    assert many.interpolation_error.orbit < 1e-6
    assert error(many, exact) < 1e-6
    assert any("azimuths suffice" in text or "which suffice" in text for text in many.notes)


@pytest.mark.parametrize("count", [10, 24, 48])
def test_aliasing_to_the_mean_is_estimated(count):
    """The system has one state, whose multiplier depends only on the mean."""
    decay = 1 / (1.3 - np.cos(uniform(count) - 0.4))
    A = -decay[:, None, None]
    found = solve.floquet(FirstOrderSystem.from_samples(A, A[:, 0], ["x"]), 1.0)
    exact = np.exp(-2 * np.pi / np.sqrt(1.3**2 - 1))
    assert abs(found.multipliers[0] / exact - 1) <= 10 * found.error_estimate.multipliers


@pytest.mark.parametrize("count", [20, 28, 44, 60])
@pytest.mark.parametrize("start", [0.3, 1.1, 2.6])
def test_kinks_below_a_smooth_load_are_estimated(count, start):
    """The harmonics of the load decay more slowly at first than those of the kinks, and faster at high
    orders."""
    phases = uniform(count)
    A = -(np.abs(np.sin(phases - start))[:, None, None] ** 3)
    load = 1 / (1.1 - np.cos(phases - 2.0))[:, None]
    found = solve.floquet(FirstOrderSystem.from_samples(A, load, ["x"]), 1.0)
    exact = np.exp(-8 / 3)
    assert abs(found.multipliers[0] / exact - 1) <= 10 * found.error_estimate.multipliers


@pytest.mark.parametrize(("count", "order"), [(33, 3), (41, 5), (53, 3)])
def test_harmonics_that_alias_to_a_resonance_are_estimated(count, order):
    """The missing harmonic `count` - `order` of the load excites the resonance at harmonic `order`."""

    def oscillator(phase, speed=1.0):
        one = np.ones((len(phase), 1, 1))
        load = np.abs(np.sin(phase - 0.7)) ** 3
        return one, 0.002 * one, order**2 * one, load[:, None]

    system = PeriodicSystem.from_samples(*oscillator(uniform(count)), ["q"])
    orbit = solve.periodic(system, 1.0)
    exact = solve.periodic(PeriodicSystem(oscillator, ["q"], breaks=[0.7, 0.7 + np.pi]), 1.0)
    assert orbit_difference(orbit, exact, 1) <= 10 * orbit.error_estimate.orbit


def test_jumps_of_samples_give_a_warning():
    phases = uniform(24)
    A = np.where(np.mod(phases, 2 * np.pi) < 2.0, -1.0, -0.5)[:, None, None]
    found = solve.floquet(FirstOrderSystem.from_samples(A, A[:, 0], ["x"]), 1.0)
    exact = np.exp(-2.0 - (2 * np.pi - 2.0) / 2)
    assert 1e-3 < abs(found.multipliers[0] / exact - 1) <= 10 * found.error_estimate.multipliers
    assert any("interpolated from 24 azimuths" in text for text in found.warnings)


def test_interpolation_error_widens_the_margin_of_the_verdict():
    """With five azimuths, harmonic 5 is aliased to the mean, which determines the verdict."""
    phases = uniform(5)
    A = (-0.02 + np.cos(phases) + np.cos(3 * phases) + 0.1 * np.cos(5 * phases))[:, None, None]
    found = solve.floquet(FirstOrderSystem.from_samples(A, 0 * A[:, 0], ["x"]), 1.0)
    assert found.spectral_radius > 1.1
    assert found.verdict == "undetermined"


def test_samples_of_second_order_at_irregular_azimuths_are_interpolated():
    rng = np.random.default_rng(3)
    phases = irregular(rng, 11)

    def oscillator(phase, speed=1.0):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, (4 + np.cos(phase) + 0.3 * np.sin(3 * phase))[:, None, None], one[:, 0]

    system = PeriodicSystem.from_samples(*oscillator(phases), ["q"], phases=phases)
    orbit = solve.periodic(system, 1.0)
    exact = solve.periodic(PeriodicSystem(oscillator, ["q"]), 1.0)
    assert orbit_difference(orbit, exact, 1) < 1e-12
    assert orbit.multipliers == pytest.approx(exact.multipliers, abs=1e-12)
    mixed = MixedSystem.from_samples(oscillator(phases), ["q"], [], phases=phases)
    assert solve.periodic(mixed, 1.0).q == pytest.approx(orbit.q, rel=1e-12)


def test_inputs_and_outputs_are_sampled():
    A, _ = swaying(np.random.default_rng(1), 2, 0.3)
    azimuths = uniform(16)
    B, C = np.ones((16, 2, 1)), np.stack((np.cos(azimuths), 0 * azimuths), axis=1)[:, None]
    signals = B, C, np.zeros((16, 1, 1)), ["u"], ["y"]
    system = FirstOrderSystem.from_samples(*with_load(A)(azimuths, 1.0), names("x", 2), signals=signals)
    orbit = solve.periodic(system, 1.0)
    assert orbit.outputs["y"] == pytest.approx(np.cos(orbit.phase) * orbit.x[0], abs=1e-12)
    assert solve.state_space(system, 1.0, samples=4).B.shape == (4, 2, 1)


def test_uniform_azimuths_may_have_any_order():
    A, _ = swaying(np.random.default_rng(1), 2, 0.3)
    order = np.random.default_rng(0).permutation(12)
    given = sampled(A, 2, uniform(12)[order], uniform(12)[order])
    plain = sampled(A, 2, uniform(12))
    assert np.array_equal(given.capabilities.samples.arrays[0], plain.capabilities.samples.arrays[0])
    assert given.capabilities.samples.given is None


def test_results_of_sampled_systems_are_saved(tmp_path):
    A, _ = swaying(np.random.default_rng(1), 2, 0.8)
    orbit = solve.periodic(sampled(A, 2, uniform(8)), 1.0)
    orbit.save(tmp_path / "orbit.npz")
    stored = solve.open(tmp_path / "orbit.npz")
    assert stored.interpolation_error == orbit.interpolation_error
    assert orbit.record()["interpolation_error"]["azimuths"] == 8
    swept = solve.sweep(sampled(A, 2, uniform(8)), [1.0])
    assert swept.results.errors[0, 1] == pytest.approx(orbit.error_estimate.multipliers, rel=0.1)


@pytest.mark.parametrize(
    ("phases", "message"),
    [
        ([0, 1, 2], "no azimuth lies between"),
        ([0.0, 0.1, 0.2, 0.3], "no azimuth lies between"),
        ([0, 0, 2, 4], "give each azimuth once"),
        ([0, 2, 4, 2 * np.pi], "give each azimuth once"),
        (["a", "b", "c"], "not real numbers"),
        ([0, 2, np.nan], "not finite"),
        ([0, 2], "3 or more"),
        (range(0, 360, 15), "not in degrees"),
    ],
)
def test_unsuitable_azimuths_are_refused(phases, message):
    one = np.ones((len(phases), 1, 1))
    with pytest.raises(SolveError, match=message) as refused:
        PeriodicSystem.from_samples(one, one, one, one[:, 0], ["q"], phases=phases)
    assert "\n" not in str(refused.value)


def test_clustered_azimuths_are_refused():
    phases = np.array([0.0, 1e-5, 2e-5, 2.1, 4.2])
    one = np.ones((5, 1, 1))
    system = FirstOrderSystem.from_samples(-one, one[:, 0], ["x"], phases=phases)
    assert system.capabilities.samples.resolved == 1
    with pytest.raises(SolveError, match="are clustered"):
        FirstOrderSystem.from_samples(-one[:3], one[:3, 0], ["x"], phases=[0.0, 2e-2, 3.15])


def curves(kind, rng):
    """Return a random function of the phase and its mean values from a fine grid."""
    width, shift = rng.uniform(1.02, 2.5), rng.uniform(0, 6)
    return {
        "poles": lambda p: 1 / (width - np.cos(p - shift)),
        "jumps": lambda p: 1.0 * (np.mod(p - shift, 2 * np.pi) < width),
        "harmonics": lambda p: 1 + np.cos(p - shift) + np.cos(3 * p),
        "pulses": lambda p: np.exp(10 * width * (np.cos(p - shift) - 1)),
        "kinks": lambda p: (
            np.abs(np.sin((p - shift) / 2)) ** 3 + 0.4 * width * np.abs(np.sin(p - 2 * shift)) ** 3
        ),
    }[kind]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["poles", "jumps", "harmonics", "pulses", "kinks"])
def test_errors_of_many_functions_are_within_their_estimates(kind):
    rng, ratios = np.random.default_rng(99), []
    fine = (np.arange(200_000) + 0.5) * (2 * np.pi / 200_000)
    for trial in range(60):
        count = int(rng.integers(6, 50))
        azimuths = irregular(rng, count) if trial % 3 == 0 else uniform(count)
        value = curves(kind, rng)
        A = -value(azimuths)[:, None, None]
        found = solve.floquet(FirstOrderSystem.from_samples(A, A[:, 0], ["x"], azimuths), 1.0)
        exact = np.exp(-2 * np.pi * np.array([value(fine).mean()]))
        ratios.append(error(found, exact) / found.error_estimate.multipliers)
    assert np.sum(np.array(ratios) > 10) <= (0 if kind != "jumps" else 1)
