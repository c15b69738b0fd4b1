"""Reference solutions of the fresh population, checked by another integrator and by panels of half the
length. The methods under test are not used."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from solve.system import check, in_phase
from tests.solve.certificates import fresh
from tests.solve.certificates.trials import matched_error
from tests.solve.certificates.truth import PHASES, panel_edges
from tests.solve.references import rate_matrices, relative_error

FIRST = range(len(fresh.KINDS))
QUICK = {"bumps": 28, "kinks": 1, "ripples": 247, "crossing": 17, "tables": 214, "jumps": 5, "twenty": 6}
"""Systems of each kind for which another integrator is fast."""

SLOW = {"ripples", "crossing"}
LOOKED_AT = np.arange(0, 1000, 125)


def features(member):
    """Return the edges and the largest panel length that a reference solution requires in addition to those
    for its modes."""
    given = member.truth.keywords
    return np.remainder(given.get("edges", ()), 2 * np.pi), given.get("longest", np.inf)


def shot(member, rtol=1e-13):
    """Return multipliers and orbit q (n, k) at `PHASES[LOOKED_AT]`, integrated by DOP853 from feature to
    feature."""
    edges, longest = features(member)
    N, system = 2 * member.n, member.system
    scales = np.repeat(member.truth.keywords["scales"][:, None], N + 1, axis=1)
    scales = scales / np.append(member.truth.keywords["scales"], 1.0)
    ends = np.unique(np.concatenate(([0.0, 2 * np.pi], edges, system.breaks, PHASES[LOOKED_AT])))
    maps = [np.eye(N, N + 1)]
    for left, right in pairwise(ends):
        inside = np.nextafter(left, right), np.nextafter(right, left)

        def rate(phase, y, inside=inside):
            P, f = rate_matrices(system, [np.clip(phase, *inside)], member.speed)
            change = P[0] @ (scales * y.reshape(N, N + 1))
            change[:, -1] += f[0]
            return (change / scales).ravel()

        start = (maps[-1] / scales).ravel()
        run = solve_ivp(rate, (left, right), start, "DOP853", rtol=rtol, atol=1e-14, max_step=longest)
        maps.append(run.y[:, -1].reshape(N, N + 1) * scales)
    start = np.linalg.solve(np.eye(N) - maps[-1][:, :-1], maps[-1][:, -1])
    q = [(maps[k] @ np.append(start, 1.0))[: member.n] for k in np.searchsorted(ends, PHASES[LOOKED_AT])]
    return np.linalg.eigvals(maps[-1][:, :-1]), np.transpose(q)


def differences(member):
    """Return the differences of orbit and multipliers between the reference and `shot`, relative to the
    largest value of each."""
    truth = member.truth()
    multipliers, q = shot(member)
    largest = np.abs(truth.q).max(axis=1)
    orbit = (np.abs(truth.q[:, LOOKED_AT] - q).max(axis=1) / largest).max()
    return orbit, matched_error(multipliers, truth.multipliers)


def halving(member):
    """Return the differences of orbit and multipliers between the reference and the solution with panels of
    half the length."""
    edges, longest = features(member)
    ends = panel_edges(member.system, member.speed, edges, longest)
    truth = member.truth()
    other = member.truth(edges=np.concatenate((ends, (ends[:-1] + ends[1:]) / 2)))
    return relative_error(other.q, truth.q), matched_error(other.multipliers, truth.multipliers)


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=pytest.mark.slow if kind in SLOW else ()) for kind in fresh.KINDS]
)
def test_reference_agrees_with_another_integrator(kind):
    member = fresh.member(QUICK[kind])
    assert member.kind == kind
    assert max(differences(member)) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("index", range(21, 42))
def test_reference_agrees_with_another_integrator_on_further_systems(index):
    assert max(differences(fresh.member(index))) < 1e-11


@pytest.mark.parametrize("index", FIRST)
def test_reference_is_unchanged_by_halved_panels(index):
    assert max(halving(fresh.member(index))) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("index", range(7, 2000, 41))
def test_reference_of_further_systems_is_unchanged_by_halved_panels(index):
    assert max(halving(fresh.member(index))) < 1e-11


def test_system_depends_only_on_seed_and_index():
    phase = np.linspace(0.0, 6.0, 9)
    for index in FIRST:
        fresh.member(index + 1)
        first, second = fresh.member(index), fresh.member(index)
        for one, other in zip(*(each.system.at(phase, each.speed) for each in (first, second)), strict=True):
            assert np.array_equal(one, other)


def test_members_are_valid_periodic_systems():
    for index in range(0, fresh.SIZE, 9):
        member = fresh.member(index)
        assert member.kind == fresh.KINDS[index % 7]
        assert not member.formula
        assert (member.n == 20) == (member.kind == "twenty")
        assert 0.1 <= member.speed <= 100
        check(member.system, member.speed)


def test_only_jumps_are_declared_and_two_almost_coincide():
    for index in range(fresh.SIZE):
        if fresh.kind_of(index) == "jumps":
            breaks = np.array(fresh.member(index).system.breaks)
            assert 2 <= len(breaks) <= 6
            assert 0 < np.diff(breaks).min() <= 1.001e-3 * 2 * np.pi
    for index in FIRST:
        member = fresh.member(index)
        assert (len(member.system.breaks) > 0) == (member.kind == "jumps")


def test_frozen_frequencies_cross():
    """The smallest distance between neighbouring frequencies is below a hundredth of the lowest frequency."""
    phase = np.linspace(0.0, 2 * np.pi, 2000)
    for index in range(3, 143, 7):
        member = fresh.member(index)
        M, _, K, _ = in_phase(member.system, phase, member.speed)
        frequency = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real, axis=1))
        assert 19 < frequency.min() < frequency.max() < 202
        assert (np.diff(frequency, axis=1) / frequency[:, :1]).min() < 0.01


def test_every_verdict_is_frequent_and_correct():
    """In four kinds, at least a tenth of the systems are growing, a tenth neutral and a tenth decaying."""
    growth = np.array(
        [fresh.member(index).truth().growth for index in range(70) if index % 7 in {0, 1, 4, 5}]
    )
    for part in (growth < -1e-6, np.abs(growth) < 1e-9, growth > 1e-6):
        assert part.mean() > 0.1


def test_undamped_systems_have_constant_mass_and_symmetric_stiffness():
    phase = np.linspace(0.1, 6.0, 50)
    undamped = 0
    for index in range(140):
        member = fresh.member(index)
        M, C, K, _ = member.system.at(phase, member.speed)
        if not C.any():
            undamped += 1
            assert np.ptp(M, axis=0).max() <= 1e-14 * np.abs(M).max()
            assert np.abs(K - np.swapaxes(K, 1, 2)).max() <= 1e-14 * np.abs(K).max()
    assert 0.1 < undamped / 140 < 0.3
