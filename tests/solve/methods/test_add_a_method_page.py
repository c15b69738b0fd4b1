"""Page "Add a method": its file is short, and its method meets all requirements."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import solve
from solve.methods.method import OneStep
from solve.studies.compare import compare
from tests.solve.methods import test_all_methods as claims
from tests.solve.references import Shooting, multiplier_error, relative_error
from tests.solve.systems import constant, random_system

PAGE = Path(__file__).parents[3] / "docs" / "add_a_method.md"
FILE, USE = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
BATHE = ModuleType("bathe")
sys.modules["bathe"] = BATHE  # Dataclasses look their module up, and the page imports it.
exec(FILE, vars(BATHE))
METHOD = BATHE.Bathe()
ROW = (METHOD, 2, (128, 192, 256), 2, (128, 192, 256))


def test_file_is_short_and_cites_its_source():
    assert isinstance(METHOD, OneStep)
    assert len(FILE.splitlines()) < 60
    assert re.search(r"\(20\d\d\) \d+-\d+\)", FILE)


def test_page_method_has_its_stated_orders():
    truth = Shooting(claims.SYSTEM, 1.0)
    claims.test_order_at_the_nodes(*ROW, truth)
    claims.test_order_of_the_continuous_curve(*ROW, truth)
    claims.test_order_is_retained_after_jumps(METHOD, (400, 600, 800))


@pytest.mark.parametrize(
    "claim",
    [
        claims.test_stiff_modes_are_damped_only_by_l_stable_methods,
        claims.test_jumps_inside_the_period_only,
        claims.test_too_many_steps_are_refused,
        claims.test_samples_are_equidistant_if_the_method_declares_it,
        claims.test_step_limits_and_phase_errors_are_monotonic,
    ],
)
def test_page_method_meets_the_common_requirements(claim):
    claim(METHOD)


def test_page_method_solves_batches_and_refuses_resonance():
    for orbit in (True, False):
        claims.test_batched_points_equal_single_points_exactly(METHOD, orbit)
    for steps in (None, 200):
        claims.test_resonance_is_refused(METHOD, steps)


def test_orbit_of_the_page_method_matches_the_closed_form():
    """For q″ + 0.2 q′ + 2.5 q = cos φ, q = Re exp(iφ)/(1.5 + 0.2 i)."""
    equation = constant([[1.0]], [[0.2]], [[2.5]], lambda phase: np.cos(phase)[:, None])
    orbit, phase = solve.periodic(equation, 1.0, METHOD, rtol=1e-5), np.linspace(0.0, 2 * np.pi, 301)
    truth = np.real(np.exp(1j * phase) / (1.5 + 0.2j))
    assert relative_error(orbit.at(phase), truth[None]) <= 1e-5
    roots = np.exp(2 * np.pi * np.roots([1.0, 0.2, 2.5]))
    assert multiplier_error(orbit.multipliers, roots) <= 1e-5
    assert (orbit.method, orbit.verdict, orbit.warnings) == ("bathe", "asymptotically stable", [])


def test_amplitude_halves_after_the_phase_stated_on_the_page():
    """The amplitude of an undamped mode halves within 500 rad."""
    frequency = 50 * METHOD.follows / (2 * np.pi)
    plain = constant([[1.0]], [[0.0]], [[frequency**2]], lambda phase: np.zeros((len(phase), 1)))
    stability = solve.floquet(plain, 1.0, METHOD, steps=50, rtol=0.9)
    assert stability.spectral_radius ** (500 / (2 * np.pi * frequency)) == pytest.approx(0.5, abs=0.1)


def test_page_method_error_estimate_covers_the_true_error():
    equation = random_system(5, 3)
    better = solve.periodic(equation, 1.0, rtol=1e-10)
    orbit = solve.periodic(equation, 1.0, METHOD, rtol=1e-4)
    phase = np.linspace(0.0, 2 * np.pi, 301)
    assert relative_error(orbit.at(phase), better.at(phase)) <= orbit.error_estimate.orbit <= 1e-4
    assert multiplier_error(orbit.multipliers, better.multipliers) <= orbit.error_estimate.multipliers <= 1e-4


def test_page_method_is_compared_with_others():
    rows = compare(random_system(4, 2), 1.0, [METHOD, "newmark"], steps=[200], targets=[1e-2]).rows
    assert {row.method for row in rows} == {"bathe", "newmark"}
    assert all(row.orbit_error < 0.1 for row in rows)


def test_usage_example_of_the_page_runs():
    names: dict = {}
    exec(USE, names)
    assert names["orbit"].method == "bathe"
    assert names["orbit"].error_estimate.orbit <= 1e-3
    sweep = names["sweep"]
    truth = solve.sweep(solve.load("manipulator"), "30:60:4 rpm", rtol=1e-6)
    assert {point.method for point in sweep.points} == {"bathe"}
    np.testing.assert_allclose(sweep.spectral_radius, truth.spectral_radius, rtol=2e-2)
