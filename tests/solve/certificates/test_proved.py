"""Results compared with stored proofs of the population: error estimates compared with proved bounds."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import solve
from solve.period.multipliers import KNOWN_ON_CIRCLE
from tests.solve.certificates.population import HALF, member
from tests.solve.certificates.proved import MOST_COORDINATES, proofs

ROUNDED = 1e-11
"""Allowed change of multipliers. The rounding of a member's matrices differs between versions of NumPy."""

QUICK = 12
"""Number of members that are compared in every run."""

INDICES = sorted(proofs())


def errors(proof, multipliers):
    """Return bounds on the errors of multipliers, relative to the spectral radius."""
    distances = np.abs(multipliers[:, None] - proof.centers) + proof.radii
    rows, columns = linear_sum_assignment(distances)
    return distances[rows, columns].max() / np.abs(proof.centers).max()


def require_honesty(index):
    proof, each = proofs()[index], member(index)
    found = solve.periodic(each.system, each.speed)
    assert errors(proof, found.multipliers) <= found.error_estimate.multipliers + ROUNDED
    radius, reach = np.abs(proof.centers[0]), proof.radii[0] + ROUNDED
    if found.verdict == "asymptotically stable":
        assert radius - reach < 1
    elif found.verdict == "unstable":
        assert radius + reach > 1
    elif found.verdict == "stable":
        assert abs(radius - 1) < KNOWN_ON_CIRCLE
    for name, (low, high) in proof.max_abs.items():
        allowed = found.error_estimate.orbit * high + ROUNDED * high
        assert low - allowed <= found.statistics(name).max_abs <= high + allowed


def test_all_smooth_members_with_few_coordinates_are_proved():
    assert [index for index in range(HALF) if member(index).n <= MOST_COORDINATES] == INDICES
    isolated = [proof.isolated.all() for proof in proofs().values()]
    assert np.mean(isolated) > 0.5
    assert sum(proof.verdict == "undetermined" for proof in proofs().values()) == 4


@pytest.mark.parametrize("index", INDICES[:QUICK])
def test_estimates_bound_the_distance_from_a_proof(index):
    require_honesty(index)


@pytest.mark.slow
@pytest.mark.parametrize("index", INDICES[QUICK:])
def test_more_estimates_bound_the_distance_from_a_proof(index):
    require_honesty(index)


def test_larger_errors_are_detected():
    index = INDICES[0]
    found = solve.floquet(member(index).system, member(index).speed)
    moved = found.multipliers + 2 * found.error_estimate.multipliers * found.spectral_radius
    assert errors(proofs()[index], moved) > found.error_estimate.multipliers
