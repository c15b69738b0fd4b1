"""Stage systems in compiled code, compared with LAPACK."""

import numpy as np
import pytest

from solve.derivatives.stage_systems import InvertedStageSystems, stage_systems
from solve.kernel.collocation import Samples
from solve.kernel.stages import factorised
from solve.methods.gauss import Gauss
from solve.methods.radau import Radau
from solve.period.points import Tables
from tests.solve.kernel.test_lanes import needs_compiler


def same(method, n, steps, inertia=1.0):
    """Compare solutions for random matrices. inertia: diagonal of M."""
    rng, rule = np.random.default_rng(4), method.stages
    s, h = len(rule.c), rng.uniform(0.1, 0.3, steps)
    M, C, K = rng.standard_normal((3, steps, s, n, n))
    M += inertia * np.eye(n)
    entries = np.concatenate(
        [part.reshape(steps, s, -1) for part in (M, C, K, np.ones((steps, s, n)))], axis=2
    )
    samples = Samples(
        entries.reshape(1, steps * s, -1), np.ones((1, entries.shape[2])), np.arange(entries.shape[2])
    )
    ours, theirs = (
        factorised(rule.weights, h, samples, slice(None), n),
        InvertedStageSystems(rule, h, entries, n),
    )
    assert ours is not None
    unit = np.broadcast_to(np.eye(s * n), (steps, s * n, s * n))
    for one, other in (
        (ours.by_state, theirs.by_state),
        (ours.maps, theirs.maps),
        (ours.solved(unit), theirs.solved(unit)),
        (ours.pulled(unit), theirs.pulled(unit)),
    ):
        size = np.abs(other).max(axis=(1, 2), keepdims=True)
        assert (np.abs(one - other) <= 1e-12 * size).all()


@needs_compiler
@pytest.mark.parametrize("method", [Radau(), Gauss(), Radau(order=3)], ids=repr)
@pytest.mark.parametrize(("n", "steps"), [(1, 1), (3, 21), (4, 8)])
def test_stage_solutions_match_for_any_method_and_size(method, n, steps):
    same(method, n, steps, inertia=6.0)


@needs_compiler
def test_stage_solutions_match_with_different_pivots():
    same(Radau(order=3), 3, 16, inertia=0.0)


@needs_compiler
def test_every_vector_width_gives_the_same_stages(width):
    same(Radau(order=3), 2, 11)


@pytest.mark.parametrize("engine", ["numpy", pytest.param("compiled", marks=needs_compiler)])
def test_accuracy_does_not_depend_on_units_of_equations(engine):
    """The effect of loads decreases with the units, and the effect of states does not change."""
    n, steps, rule, units = 3, 9, Radau().stages, 2.0 ** np.array([0, 25, -25])
    s, h, rng = len(rule.c), np.full(steps, 0.3), np.random.default_rng(4)
    entries = rng.standard_normal((1, steps * s, 3 * n**2 + n))
    entries[..., : n**2] += 3 * np.eye(n).ravel()
    tables, unit = Tables.from_entries(entries, n), np.broadcast_to(np.eye(s * n), (steps, s * n, s * n))
    computed, again = (
        stage_systems(rule, h, each, slice(None), engine) for each in (tables, tables.multiplied(units[None]))
    )
    every = np.tile(units, s)
    for one, other in (
        (again.by_state, computed.by_state),
        (again.maps, computed.maps),
        (again.solved(unit) * every, computed.solved(unit)),
        (again.pulled(unit) * every[:, None], computed.pulled(unit)),
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=5e-15 * np.abs(other).max())


def test_many_accelerations_are_solved_by_lapack():
    samples = Samples(np.ones((5, 1)), np.ones((1, 1)), np.zeros(1))
    assert factorised(Radau().stages.weights, np.ones(1), samples, slice(None), 20) is None
