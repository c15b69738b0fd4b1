"""Error estimates and verdicts on a fixed sample of the population; `python -m tests.benchmarks.population`
tests all of it.

The true error is at most 10 times the estimate in 95 % of the results of each method and in 99 % of all
results. If the true error is between 1e-12 and 0.1, the estimate is at most 100 times the true error in 90 %
of the results of each method (50 % for Fourier series). No verdict is contradicted. The reference is a
formula or an independent integration, which is compared with DOP853.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from solve import PeriodicSystem, periodic
from tests.solve.certificates.population import FURTHER, HALF, KINDS, SERIES, SIZE, kind_of, member
from tests.solve.certificates.transformed import Modes, View, transformed
from tests.solve.certificates.trials import all_outcomes, grouped, matched_error, rates, request_name
from tests.solve.certificates.truth import PHASES, Truth
from tests.solve.references import Shooting, rate_matrices, relative_error
from tests.solve.systems import frozen_modes

FEW = [0, 43, 86, 129, 301, 344, *range(HALF + 1, HALF + 1 + len(FURTHER))]
PART = range(5, SIZE, 23)
"""Systems of all kinds."""


@pytest.mark.parametrize("indices", [FEW, pytest.param(PART, marks=pytest.mark.slow)], ids=["few", "part"])
def test_estimates_and_verdicts_meet_the_stated_rates(indices, report):
    computed = all_outcomes(indices)
    report(f"{len(indices)} systems; {len(computed)} results, each with orbit and multipliers")
    table = [rates(name, part) for name, part in grouped(computed, request_name).items()]
    for row in (*table, rates("all methods", computed)):
        report(str(row))
    assert {each.kind for each in computed} == set(KINDS)
    for row in table:
        assert row.results > 0
        assert row.honest >= 0.95, str(row)
        # Series are judged by the orders of the matrices beyond their own, which may matter little.
        least = 0.5 if row.name.startswith(("fourier", "hill")) else 0.90
        # Of few results one is allowed: it is no rate.
        allowed = max(1.0, (1 - least) * row.visible)
        assert row.visible == 0 or (1 - row.sharp) * row.visible <= allowed, str(row)
    assert rates("all methods", computed).honest >= 0.99
    assert not [str(each) for each in computed if each.contradicted]


def test_population_is_as_described():
    kinds = [kind_of(index) for index in range(SIZE)]
    assert min(kinds.count(kind) for kind in KINDS) >= 80
    members = [member(index) for index in range(HALF)]
    assert {each.n for each in members} == {1, 2, 3, 4, 5, 6}
    fastest = np.array(
        [np.abs(frozen_modes(each.system, each.speed, 16).eigenvalues()).max() for each in members]
    )
    stiff = np.array(["stiff" in each.kind for each in members])
    assert fastest[~stiff].max() < 12
    assert np.median(fastest[stiff]) > 20
    assert fastest.max() > 120
    for index in (0, 1, 137, *range(500, 506)):
        one, other = (member(index).system.at(PHASES[:5], member(index).speed) for _ in range(2))
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("index", [0, 1, 4, 8, 21])
def test_integrated_reference_matches_dop853(index):
    """DOP853 is an explicit adaptive method from another package, used for shooting. It is applied to soft
    systems."""
    given = member(index)
    assert given.kind in SERIES[:2]
    assert_as_dop853(given.truth(), given.system, given.speed, 3e-10, 3e-11)


@pytest.mark.slow
@pytest.mark.parametrize("index", [2, 7, 15, 19, 30, 31])
def test_integrated_reference_of_stiff_systems_matches_dop853(index):
    given = member(index)
    assert given.kind in SERIES[2:]
    assert_as_dop853(given.truth(), given.system, given.speed, 1e-8, 1e-9)


def assert_as_dop853(truth: Truth, system: PeriodicSystem, speed, orbit, multipliers):
    reference = Shooting(system, speed)
    assert relative_error(truth.q, reference.states(PHASES)[: system.n]) < orbit
    assert matched_error(truth.multipliers, reference.multipliers) < multipliers


@pytest.mark.parametrize("energetic", [True, False])
@pytest.mark.parametrize("n", [1, 2])
def test_formula_of_transformed_systems_matches_dop853(n, energetic):
    rng = np.random.default_rng(n)
    omega = rng.uniform(0.5, 4.0, n)
    coupled = np.triu(rng.standard_normal((2, n, n)), 1)
    f = rng.standard_normal((3, n)) + 1j * rng.standard_normal((3, n))
    modes = Modes(np.diag(0.1 * omega) + coupled[0], np.diag(omega**2) + coupled[1], np.array([0, 1, 7]), f)
    system, truth = transformed(modes, View.random(rng, n, energetic=energetic))
    assert_as_dop853(truth(), system, 1.7, 3e-11, 3e-12)


@pytest.mark.parametrize("energetic", [True, False])
def test_units_only_scale_the_coordinates(energetic):
    rng = np.random.default_rng(0)
    f = rng.standard_normal((3, 2)) + 0j
    modes = Modes(np.diag([0.1, 0.3]), np.diag([2.0, 7.0]), np.arange(3), f)
    view = View.random(rng, 2, energetic=energetic)
    units = np.array([1e3, 1e-2])
    plain, scaled = (transformed(modes, View(view.waves, each, energetic)) for each in (np.ones(2), units))
    np.testing.assert_allclose(scaled[1]().q * units[:, None], plain[1]().q, rtol=1e-14)
    rows = units if energetic else 1 / units
    for ours, theirs in zip(scaled[0].at(PHASES, 1.3), plain[0].at(PHASES, 1.3), strict=True):
        columns = units if ours.ndim == 3 else 1.0
        by_row = rows[:, None] if ours.ndim == 3 else rows
        np.testing.assert_allclose(ours, by_row * theirs * columns, rtol=1e-13, atol=0)


@pytest.mark.parametrize("index", [511, 523, 535])
def test_multipliers_for_rectangular_pulses_match_matrix_exponentials(index):
    given = member(index)
    ends = np.array([0.0, *given.system.breaks, 2 * np.pi])
    Phi = np.eye(2 * given.n)
    for left, right in pairwise(ends):
        P = rate_matrices(given.system, [left + 0.2 * (right - left), (left + right) / 2], given.speed)[0]
        np.testing.assert_array_equal(P[0], P[1])
        Phi = expm(P[0] * (right - left)) @ Phi
    assert matched_error(given.truth().multipliers, np.linalg.eigvals(Phi)) < 1e-12


def test_default_meets_its_tolerance():
    """Unless the result has a warning, the errors of orbit and multipliers are at most 1e-8."""
    for index in range(0, HALF, 75):
        given = member(index)
        computed, truth = periodic(given.system, given.speed), given.truth()
        errors = (
            relative_error(computed.at(PHASES), truth.q),
            matched_error(computed.multipliers, truth.multipliers),
        )
        warned = any("not to rtol" in text for text in computed.warnings)
        assert max(errors) <= 1e-8 or warned, (index, errors, computed.error_estimate)
