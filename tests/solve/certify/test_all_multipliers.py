"""Every multiplier of a period, with an error of its own, however small."""

import json

import numpy as np
import pytest

import solve
from solve.commands.app import run
from solve.errors import StepsError
from tests.solve.systems import constant, system


def decaying():
    """q″ + (24 + 10 sin t) q′ + 10 cos t q = (q′ + (24 + 10 sin t) q)′ = 0: its exponents are 0 and -24."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        wave = phase[:, None, None]
        return one, 24 + 10 * np.sin(wave), 10 * np.cos(wave), np.zeros((len(phase), 1))

    return system(matrices, 1)


def test_exponents_whose_multipliers_differ_by_65_decades():
    found = solve.floquet(decaying(), 1.0, rtol=1e-11, all_multipliers=True)
    np.testing.assert_allclose(found.exponents, [0.0, -24.0], rtol=0, atol=1e-10)
    assert found.unresolved == 0
    assert len(found.multipliers) == len(found.multiplier_errors) == 2
    assert (found.multiplier_errors < 1e-9).all()


@pytest.mark.parametrize("engine", ["auto", "numpy"])
def test_constant_coefficients_have_the_eigenvalues_of_their_matrix(engine):
    M, C, K = np.eye(2), np.array([[40.0, 3.0], [-1.0, 90.0]]), np.array([[9.0, 1.0], [2.0, 400.0]])
    truth = np.linalg.eigvals(np.block([[np.zeros((2, 2)), M], [-K, -C]]))
    truth = truth[np.argsort(-truth.real)]
    free = constant(M, C, K, lambda phase: np.zeros((len(phase), 2)))
    found = solve.floquet(free, 1.0, rtol=1e-9, engine=engine, all_multipliers=True)
    assert found.unresolved == 0
    np.testing.assert_allclose(found.exponents.real, truth.real, rtol=1e-9)
    errors = 2 * np.pi * np.abs(found.exponents.real - truth.real)
    assert (errors <= 10 * found.multiplier_errors + 1e-12).all()


def test_the_cam_at_twelve_rpm_obeys_liouville():
    """|ρ| from 1e-57 down to what no number holds; their logarithms sum up to -∫ tr(M⁻¹C) dt. The smallest
    two belong to modes that 98 304 steps hardly follow, which is said."""
    cam = solve.load("cam")
    found = solve.floquet(cam, "12 rpm", rtol=1e-6, all_multipliers=True)
    assert found.unresolved == 0
    assert (found.multiplier_errors[:4] <= 1e-6).all()
    assert any("every multiplier is known to" in text for text in found.warnings)
    phase = (np.arange(4096) + 0.5) * (cam.period / 4096)
    M, C, _, _ = cam.in_phase(phase, found.speed)
    volume = -np.einsum("kii->k", np.linalg.solve(M, C)).mean() * cam.period
    logarithms = found.exponents.real * found.period
    assert abs(logarithms.sum() - volume) <= found.multiplier_errors.sum()
    assert abs(logarithms.sum() - volume) <= 1e-4 * abs(volume)
    assert found.multipliers[-1] == 0
    assert np.isfinite(found.exponents).all()


def test_modes_that_given_steps_do_not_follow_have_no_digit():
    found = solve.floquet(solve.load("cam"), "12 rpm", "radau", steps=64, rtol=0.9, all_multipliers=True)
    assert 0 < found.unresolved <= 6
    assert np.isnan(found.multiplier_errors).sum() == found.unresolved


def test_methods_without_maps_say_so():
    with pytest.raises(StepsError, match=r"fourier has no maps of steps .* use radau or gauss"):
        solve.floquet(decaying(), 1.0, "fourier", rtol=1e-6, all_multipliers=True)


def test_the_command_gives_all_of_them(capsys):
    assert run(["floquet", "mathieu", "--all-multipliers", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert len(record["multipliers"]) == len(record["exponents"]) == len(record["multiplier_errors"]) == 2
    assert record["unresolved"] == 0
