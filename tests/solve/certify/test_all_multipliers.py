"""Individual errors of all multipliers of a period, however small these are."""

import json
import sys

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import solve
from solve.commands.app import run
from solve.errors import StepsError
from solve.methods.radau import Radau
from solve.system import in_phase
from tests.solve.systems import constant, system


def decaying():
    """System q″ + (24 + 10 sin t) q′ + 10 cos t q = (q′ + (24 + 10 sin t) q)′ = 0, with exponents 0 and
    -24."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        wave = phase[:, None, None]
        return one, 24 + 10 * np.sin(wave), 10 * np.cos(wave), np.zeros((len(phase), 1))

    return system(matrices, 1)


def test_exponents_are_exact_for_multipliers_65_decades_apart():
    stability = solve.floquet(decaying(), 1.0, rtol=1e-11, all_multipliers=True)
    np.testing.assert_allclose(stability.exponents, [0.0, -24.0], rtol=0, atol=1e-10)
    assert stability.unresolved == 0
    assert len(stability.multipliers) == len(stability.multiplier_errors) == 2
    assert (stability.multiplier_errors < 1e-9).all()


@pytest.mark.parametrize("engine", ["auto", "numpy"])
def test_exponents_of_constant_coefficients_are_eigenvalues(engine):
    M, C, K = np.eye(2), np.array([[40.0, 3.0], [-1.0, 90.0]]), np.array([[9.0, 1.0], [2.0, 400.0]])
    truth = np.linalg.eigvals(np.block([[np.zeros((2, 2)), M], [-K, -C]]))
    truth = truth[np.argsort(-truth.real)]
    free = constant(M, C, K, lambda phase: np.zeros((len(phase), 2)))
    stability = solve.floquet(free, 1.0, rtol=1e-9, engine=engine, all_multipliers=True)
    assert stability.unresolved == 0
    np.testing.assert_allclose(stability.exponents.real, truth.real, rtol=1e-9)
    errors = 2 * np.pi * np.abs(stability.exponents.real - truth.real)
    assert (errors <= 10 * stability.multiplier_errors + 1e-12).all()


@pytest.mark.slow
def test_multipliers_of_slow_cam_satisfy_liouvilles_formula():
    """|ρ| ranges from 1e-57 to values below the range of floating point. The sum of ln|ρ| is -∫ tr(M⁻¹C) dt.
    Two methods agree."""
    cam = solve.load("cam")
    stability = solve.floquet(cam, "12 rpm", rtol=1e-6, all_multipliers=True)
    other = solve.floquet(cam, "12 rpm", solve.Gauss(16), rtol=1e-6, all_multipliers=True)
    phase = (np.arange(4096) + 0.5) * (cam.period / 4096)
    M, C, _, _ = in_phase(cam, phase, stability.speed)
    volume = -np.einsum("kii->k", np.linalg.solve(M, C)).mean() * cam.period
    for each in stability, other:
        assert each.unresolved == 0
        assert (each.multiplier_errors <= 1e-6).all()
        logarithms = each.exponents.real * each.period
        assert abs(logarithms.sum() - volume) <= 10 * each.multiplier_errors.sum()
    allowed = stability.multiplier_errors + other.multiplier_errors
    assert (np.abs(stability.exponents - other.exponents) * stability.period <= allowed).all()
    assert stability.multipliers[-1] == 0
    assert other.modes[4].unfolded == pytest.approx(other.modes[4].order * other.speed, rel=1e-4)


def free_discs():
    """Two discs on a damped shaft whose stiffness varies. They turn freely together."""
    twist = np.array([[1.0, -1.0], [-1.0, 1.0]])

    def matrices(phase, speed):
        stiffness = (50 + 10 * np.cos(phase))[:, None, None] * twist
        return np.eye(2) + 0 * stiffness, 0.3 * twist + 0 * stiffness, stiffness, np.zeros((len(phase), 2))

    return system(matrices, 2)


@pytest.mark.parametrize("is_free", [False, True])
def test_step_maps_computed_in_blocks_give_the_same_multipliers(monkeypatch, is_free):
    """The memory limit permits only some of the steps at a time."""
    given = free_discs() if is_free else turning(1)[0]
    computed, discretise = [], Radau.discretise

    def recorded(self, points, grid):
        computed.append(grid.steps)
        return discretise(self, points, grid)

    monkeypatch.setattr(Radau, "discretise", recorded)
    whole = solve.floquet(given, 1.0, "radau", rtol=1e-8, engine="numpy", all_multipliers=True)
    monkeypatch.setattr("solve.certify.all_multipliers._MEMORY", 10 * Radau().bytes_a_step(2))
    computed.clear()
    parts = solve.floquet(given, 1.0, "radau", rtol=1e-8, engine="numpy", all_multipliers=True)
    assert computed[-1] <= 11
    apart = np.abs(parts.exponents - whole.exponents) * whole.period
    assert (apart <= 1e-10 * np.abs(whole.exponents * whole.period)).all()
    assert parts.unresolved == whole.unresolved == 0


def test_modes_unresolved_by_given_steps_have_no_digits():
    stability = solve.floquet(solve.load("cam"), "12 rpm", "radau", steps=64, rtol=0.9, all_multipliers=True)
    assert 0 < stability.unresolved <= 6
    assert np.isnan(stability.multiplier_errors).sum() == stability.unresolved


def test_unresolved_multipliers_are_null_in_every_column(without_slicot):
    found = solve.floquet(solve.load("four_bar", options={"elements": "1"}), 30.0, rtol=1e-6)
    assert 0 < found.unresolved < 10
    record = found.record()
    for row in range(18 - found.unresolved, 18):
        assert record["multipliers"][row] == record["exponents"][row] == [None, None]
        assert record["modes"][row]["folded"] is record["multiplier_errors"][row] is None
    assert record["modes"][0]["folded"] is not None


def test_small_spectra_are_magnified_despite_unresolved_multipliers(without_slicot):
    damped = constant(
        np.eye(2), np.diag([0.8, 12.0]), np.diag([2.0, 41.29]), lambda phase: np.zeros((len(phase), 2))
    )
    found = solve.floquet(damped, 1.0)
    assert found.unresolved == 2
    titles = [axes.get_title(loc="left") for axes in found.plot().axes]
    assert "magnified, within the largest" in titles


def test_without_slicot_missing_orders_and_tolerances_are_noted(without_slicot):
    mathieu = solve.load("mathieu")
    (note,) = solve.floquet(mathieu, 2.0).notes
    assert note.startswith("orders and frequencies of the modes are unknown; SLICOT is required")
    (note,) = solve.floquet(mathieu, 2.0, all_multipliers=True).notes
    assert note.startswith("rtol is not applied to each multiplier; SLICOT is required")
    cam = solve.load("cam")
    notes = solve.nonlinear(cam, "600 rpm", rtol=1e-6, all_multipliers=True).notes
    assert any("rtol is not applied to each multiplier" in note for note in notes)


def test_note_states_multipliers_omitted_because_of_their_cost(monkeypatch):
    monkeypatch.setattr("solve.certify.all_multipliers._MAX_WORK", (1.0, 1.0, 1e9))
    found = solve.floquet(damped_pair(), 1.0)
    assert np.isnan(found.multipliers[2:]).all()
    assert [note.split("; ")[1] for note in found.notes] == [
        f"with 2 coordinates and {found.steps} steps, small multipliers require all_multipliers"
    ]


def test_methods_without_step_maps_cannot_compute_all_multipliers():
    with pytest.raises(
        StepsError, match=r"maps of the steps, which fourier does not provide; use radau or gauss"
    ):
        solve.floquet(decaying(), 1.0, "fourier", rtol=1e-6, all_multipliers=True)


def test_command_prints_all_multipliers(capsys):
    assert run(["floquet", "mathieu", "--all-multipliers", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert len(record["multipliers"]) == len(record["exponents"]) == len(record["multiplier_errors"]) == 2
    assert record["unresolved"] == 0


def turning(seed):
    """Return a stable system of two coordinates in unevenly rotating axes, and the descending logarithms of
    its multipliers, down to 1e-300. In fixed axes, the coefficients are constant."""
    rng = np.random.default_rng(seed)
    S = rng.standard_normal((2, 2)) + 2 * np.eye(2)
    damping = np.exp(rng.uniform(np.log(0.01), np.log(55.0), 2))
    frequency = np.exp(rng.uniform(np.log(0.3), np.log(20.0), 2))
    M = S.T @ S
    C, K = (S.T @ np.diag(values) @ S for values in (2 * damping, frequency**2))
    rate = rng.uniform(0.2, 0.9)

    def matrices(phase, speed):
        angle, w, dw = phase + rate * np.sin(phase), 1 + rate * np.cos(phase), -rate * np.sin(phase)
        R = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
        back = np.swapaxes(R, 1, 2)
        J = np.array([[0.0, -1.0], [1.0, 0.0]])
        w, dw = w[:, None, None], dw[:, None, None]
        first, second = -w * (J @ back), -dw * (J @ back) - w**2 * back
        return (
            R @ M @ back,
            R @ (2 * M @ first + C @ back),
            R @ (M @ second + C @ first + K @ back),
            np.zeros((len(phase), 2)),
        )

    roots = np.concatenate([np.roots([1.0, 2 * d, f**2]) for d, f in zip(damping, frequency, strict=True)])
    return system(matrices, 2), 2 * np.pi * roots[np.argsort(-roots.real, kind="stable")]


@pytest.mark.slow
def test_rotating_axes_do_not_change_multipliers():
    """Among 340 systems with |ρ| down to 1e-300, errors of 99 % of the multipliers are at most ten times
    their estimates, and all exponents have relative errors below 1e-9."""
    honest, smallest = [], 0.0
    for seed in range(340):
        given, truth = turning(seed)
        stability = solve.floquet(given, 1.0, rtol=1e-9, all_multipliers=True)
        apart = stability.exponents[:, None] * stability.period - truth
        distance = np.hypot(apart.real, np.angle(np.exp(1j * apart.imag)))
        rows, columns = linear_sum_assignment(distance)
        error, size = distance[rows, columns], np.maximum(np.abs(truth[columns].real), 1.0)
        assert stability.unresolved == 0
        assert (error <= 1e-9 * size).all()
        honest += list(error <= 10 * stability.multiplier_errors)
        smallest = min(smallest, truth.real.min())
    assert np.mean(honest) >= 0.99
    assert smallest < np.log(1e-250)


@pytest.mark.slow
def test_all_multipliers_of_an_elastic_linkage_are_computed():
    """There are 36 multipliers, down to exp(-483). The sum of ln|ρ| is -∫ tr(M⁻¹C) dt."""
    linkage = solve.load("four_bar", options={"elements": "2"})
    stability = solve.floquet(
        linkage, "30 rad/s", solve.Radau(13), rtol=1e-3, engine="numpy", all_multipliers=True
    )
    assert (len(stability.multipliers), stability.unresolved, stability.warnings) == (36, 0, [])
    phase = (np.arange(512) + 0.5) * (linkage.period / 512)
    M, C, _, _ = in_phase(linkage, phase, stability.speed)
    volume = -np.einsum("kii->k", np.linalg.solve(M, C)).mean() * linkage.period
    logarithms = stability.exponents.real * stability.period
    assert abs(logarithms.sum() - volume) <= stability.multiplier_errors.sum()
    assert logarithms.min() < -480


@pytest.mark.parametrize("stiffness", [50.0, 50.001])
def test_rigid_body_multipliers_follow_those_outside_the_unit_circle(stiffness):
    """Two discs on a shaft without damping: all multipliers lie on the unit circle within round-off. They
    coincide if the stiffness is 50."""
    K = stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]])
    discs = constant(np.eye(2), 0 * K, K, lambda phase: np.zeros((len(phase), 2)))
    for all_multipliers in (False, True):
        stability = solve.floquet(discs, 1.0, rtol=1e-10, all_multipliers=all_multipliers)
        assert stability.multipliers[:2].tolist() == [1.0, 1.0]
        truth = np.exp(2j * np.pi * np.sqrt(2 * stiffness))
        assert np.abs(stability.multipliers[2:] - truth).min() <= 2 * stability.multiplier_errors[2] < 1e-8


def coupled(phase, speed):
    """Two coordinates whose stiffness has all harmonics. The second one is strongly damped."""
    one, soft = np.ones((len(phase), 1, 1)), 1 / (1.2 - np.cos(phase))[:, None, None]
    C, K = np.diag([0.2, 12.0]), np.diag([2.0, 41.29]) + soft * np.array([[0.1, 0.2], [0.2, 5.0]])
    return one * np.eye(2), one * C, K, np.zeros((len(phase), 2))


def test_small_multipliers_include_the_error_of_interpolation():
    exact = solve.floquet(system(coupled, 2), 1.0, rtol=1e-10, all_multipliers=True)
    phases = np.arange(12) * (2 * np.pi / 12)
    sampled = solve.PeriodicSystem.from_samples(*coupled(phases, 1.0), ["q1", "q2"])
    assert exact.unresolved == 0
    for all_multipliers in (False, True):
        stability = solve.floquet(sampled, 1.0, all_multipliers=all_multipliers)
        errors = np.abs(stability.exponents - exact.exponents) * exact.period
        known = np.isfinite(stability.multiplier_errors)
        assert known[:2].all()
        assert (errors <= 10 * stability.multiplier_errors)[known].all()


@pytest.fixture
def without_slicot(monkeypatch):
    monkeypatch.setitem(sys.modules, "ctrlsys", None)


def damped_pair():
    """Two oscillators with exponents -0.1 ± 1.41i and -6 ± 2.3i. The latter have |ρ| = 4e-17."""
    return constant(
        np.eye(2), np.diag([0.2, 12.0]), np.diag([2.0, 41.29]), lambda phase: np.zeros((len(phase), 2))
    )


def test_multipliers_below_round_off_are_null_without_slicot(without_slicot):
    stability = solve.floquet(damped_pair(), 1.0)
    exact = 2 * np.pi * np.array([-0.1 + 1j * np.sqrt(1.99), -0.1 - 1j * np.sqrt(1.99)])
    assert stability.multipliers[:2] == pytest.approx(np.exp(exact), rel=1e-8)
    assert np.isnan(stability.multipliers[2:]).all()
    assert np.isnan(stability.multiplier_errors[2:]).all()
    assert stability.unresolved == 2
    assert ["ctrlsys" in note for note in stability.notes] == [True]
    record = stability.record()
    assert record["multipliers"][2:] == [[None, None], [None, None]]
    assert record["multiplier_errors"][2:] == [None, None]
    assert stability.verdict == "asymptotically stable"


def test_without_slicot_all_multipliers_use_the_monodromy_matrix(without_slicot):
    stability = solve.floquet(damped_pair(), 1.0, all_multipliers=True)
    assert stability.unresolved == 2
    assert any("ctrlsys" in note for note in stability.notes)


def test_multipliers_below_round_off_come_from_slicot():
    stability = solve.floquet(damped_pair(), 1.0)
    apart = np.abs(stability.multipliers[2] / np.exp(2 * np.pi * (-6 + 2.3j)) - 1)
    assert apart <= 10 * stability.multiplier_errors[2]
    assert stability.multiplier_errors[2] < 0.01
    assert stability.notes == []
