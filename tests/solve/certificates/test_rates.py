"""Error estimates on the population: too small hardly ever, too large seldom.

True error ≤ 10 × estimate in 95 % and, where the true error is above 1e-12, estimate ≤ 1000 × true error in
90 %, method by method. The truth is Radau IIA of order 13 refined to rounding, itself held against DOP853.
"""

import numpy as np
import pytest

from solve import periodic
from tests.solve.certificates.population import SIZE, member
from tests.solve.certificates.trials import PHASES, TRIALS, matched_error, outcomes, rates, true_orbit
from tests.solve.systems import frozen_modes
from tests.solve.witnesses import Shooting, relative_error


def judge(indices, report):
    found = [outcome for index in indices for outcome in outcomes(member(index))]
    names = list(dict.fromkeys(trial.name for trial in TRIALS))
    # `auto` settles on a method of its own; its outcomes go by the name that was asked for.
    table = [rates(name, [each for each in found if each.name == name]) for name in names]
    table.append(rates("all methods", found))
    report(f"{len(indices)} systems; {len(found)} results, each with orbit and multipliers")
    for row in table:
        report(str(row))
    return table


def assert_honest_and_sharp(table):
    for row in table:
        assert row.results > 0
        assert row.honest >= 0.95, str(row)
        assert row.visible == 0 or row.sharp >= 0.90, str(row)


def test_estimates_on_twenty_five_systems(report):
    """Every nineteenth, so that all kinds take part."""
    assert_honest_and_sharp(judge(range(0, 25 * 19, 19), report))


@pytest.mark.slow
def test_estimates_on_all_systems(report):
    assert_honest_and_sharp(judge(range(SIZE), report))


def test_the_population_is_as_described():
    members = [member(index) for index in range(SIZE)]
    assert {each.system.n for each in members} == {1, 2, 3, 4, 5, 6}
    assert sum(each.damped for each in members) == SIZE // 2
    fastest = np.array(
        [np.abs(frozen_modes(each.system, each.speed, 16).eigenvalues()).max() for each in members]
    )
    stiff = np.array([each.stiff for each in members])
    assert fastest[~stiff].max() < 12
    assert np.median(fastest[stiff]) > 20
    assert fastest.max() > 120
    for index in (0, 1, 137):
        one, other = (member(index).system.at(PHASES[:5], member(index).speed) for _ in range(2))
        for ours, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("index", [0, 1, 4, 5, 8, 12, 16, 20, 21, 28])
def test_the_truth_is_that_of_dop853(index):
    """Another method, another code: explicit, adaptive, shooting. Soft systems, which it can follow."""
    given = member(index)
    truth, witness = true_orbit(given), Shooting(given.system, given.speed)
    assert not given.stiff
    assert relative_error(truth.at(PHASES), witness.states(PHASES)[: given.system.n]) < 3e-10
    assert matched_error(truth.multipliers, witness.multipliers) < 3e-11


@pytest.mark.slow
@pytest.mark.parametrize("index", [2, 7, 15, 19, 30, 31])
def test_the_truth_of_stiff_systems_is_that_of_dop853(index):
    given = member(index)
    truth, witness = true_orbit(given), Shooting(given.system, given.speed)
    assert given.stiff
    assert relative_error(truth.at(PHASES), witness.states(PHASES)[: given.system.n]) < 1e-8
    assert matched_error(truth.multipliers, witness.multipliers) < 1e-9


def test_the_default_keeps_its_tolerance():
    """1e-8 for orbit and multipliers unless the result says otherwise."""
    for index in range(0, SIZE, 25):
        given = member(index)
        found, truth = periodic(given.system, given.speed), true_orbit(given)
        errors = (
            relative_error(found.at(PHASES), truth.at(PHASES)),
            matched_error(found.multipliers, truth.multipliers),
        )
        said = any("not to rtol" in text for text in found.warnings)
        assert max(errors) <= 1e-8 or said, (index, errors, found.error_estimate)
