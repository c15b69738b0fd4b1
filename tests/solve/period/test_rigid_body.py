"""Rigid-body modes of chains, geared trains and combinations of these, in any units."""

import numpy as np
import pytest

from solve.period.rigid_body import BOUND, rigid_body_modes

CHAIN = 12e3, 12e3, 14e3, 10e3


def chain(stiffness, ratios=None):
    """K of discs in series. ratios: speed of each disc relative to the first."""
    n = len(stiffness) + 1
    ratios = np.ones(n) if ratios is None else np.asarray(ratios)
    K = np.zeros((n, n))
    for at, k in enumerate(stiffness):
        stretch = np.zeros(n)
        stretch[[at, at + 1]] = 1 / ratios[[at, at + 1]] * [1, -1]
        K += k * np.outer(stretch, stretch)
    return K


def over_the_period(K, phases=32):
    """Matrices K at several phases, with a stiffness that varies over the period."""
    return K * (1 + 0.3 * np.cos(np.linspace(0, 2 * np.pi, phases, endpoint=False)))[None, :, None, None]


def block(*parts):
    n = sum(map(len, parts))
    whole, at = np.zeros((n, n)), 0
    for part in parts:
        whole[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return whole


def test_only_a_free_chain_has_a_rigid_body_mode():
    K = np.stack([chain(CHAIN), chain(CHAIN) + np.diag([0.1, 0, 0, 0, 0]), np.diag([1.0, 2, 3, 4, 5])])
    modes = rigid_body_modes(over_the_period(K[:, None]), np.zeros((3, 32, 5, 5)))
    assert modes.any.tolist() == [True, False, False]
    assert (modes.vectors[0, :, 0] == 1).all()
    assert not modes.damped[0, 0]
    assert modes.errors[0, 0] < 1e-15
    assert modes.multiplicity.tolist() == [2, 0, 0]


@pytest.mark.parametrize("seed", range(4))
def test_units_of_coordinates_and_equations_do_not_matter(seed):
    draw = np.random.default_rng(seed)
    ratios = draw.uniform(0.1, 20, 4)
    units, rows = 10.0 ** draw.uniform(-6, 6, (2, 4))
    K = rows[:, None] * chain(draw.uniform(1e3, 1e5, 3), ratios) * units
    C = rows[:, None] * np.diag([0.0, 0.0, 1e-4, 0.0]) * units
    modes = rigid_body_modes(over_the_period(K[None, None]), over_the_period(C[None, None]))
    expected = ratios / units
    np.testing.assert_allclose(modes.vectors[0, :, 0], expected / np.abs(expected).max(), rtol=1e-12)
    assert modes.damped.all()
    assert modes.errors.max() < 1e-14


def test_undamped_modes_come_first():
    """There are two chains, the first with drag, and a coupling that damps only their relative motion."""
    K = block(chain([1e3, 2e3]), chain([3e3]))[None, None]
    drag = np.diag([0.0, 0.5, 0, 0, 0])[None, None]
    modes = rigid_body_modes(K, drag)
    assert modes.vectors[0].T.tolist() == [[0, 0, 0, 1, 1], [1, 1, 1, 0, 0]]
    assert modes.damped[0].tolist() == [False, True]
    apart = np.array([1.0, 0, 0, -1, 0])
    modes = rigid_body_modes(K, np.outer(apart, apart)[None, None])
    assert modes.vectors[0, :, 0].tolist() == [1, 1, 1, 1, 1]
    assert modes.damped[0].tolist() == [False, True]
    assert modes.multiplicity.tolist() == [3]
    np.testing.assert_allclose(modes.measures @ modes.vectors, np.eye(2)[None], atol=1e-15)


def test_direction_free_at_some_phases_only_is_not_a_mode():
    phase = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    along = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    K = along[None, :, :, None] * along[None, :, None]
    assert not rigid_body_modes(K, 0 * K).any.any()
    pulse = np.zeros((1, 64, 1, 1))
    pulse[0, 5] = 1.0
    assert not rigid_body_modes(pulse, 0 * pulse).any.any()
    assert rigid_body_modes(0 * pulse, 0 * pulse).vectors[0].tolist() == [[1.0]]


@pytest.mark.parametrize(("part", "free"), [(0.1 * BOUND, True), (30 * BOUND, False)])
def test_bound_separates_round_off_from_soft_springs(part, free):
    K = chain([1e4])
    K[0, 0] += part * 1e4
    modes = rigid_body_modes(K[None, None], 0 * K[None, None])
    assert modes.any.tolist() == [free]
    if free:
        assert modes.errors[0, 0] == pytest.approx(part / 2, rel=1e-2)


def test_round_off_of_the_inertia_is_not_a_stiffness():
    M = np.ones((1, 1, 1, 1))
    assert rigid_body_modes(1e-15 * M, 0 * M, M).any.all()
    assert not rigid_body_modes(1e-12 * M, 0 * M, M).any.any()
