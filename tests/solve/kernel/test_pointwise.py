"""Matrices of generated models in compiled code, compared with CasADi."""

import numpy as np
import pytest

import solve
from solve.batch.family import SPEED, SystemFamily
from solve.kernel.engines import COMPILED, NUMPY
from solve.kernel.formulas import columns
from solve.period.curve import Curve
from tests.solve.kernel.test_lanes import needs_compiler

VARIED = {
    "cam": ("k3", "a2"),
    "coupler": ("l2", "E"),
    "gear_pair": ("zeta", "k1"),
    "manipulator": ("k1", "a1"),
    "mathieu": ("delta", "epsilon"),
}


def both(name, points=11):
    model = solve.load(name)
    family = SystemFamily(model, [*VARIED[name], SPEED])
    middle = np.array([*(model.parameters[each] or 1e-3 for each in VARIED[name]), 2.0])
    phase = np.linspace(0, model.period, 7)
    together = model.many_points(VARIED[name])
    assert together is not None
    assert together.formulas is not None
    every = middle * np.linspace(1.0, 1.1, points)[:, None]
    return [family.entries(phase, every, engine) for engine in (COMPILED, NUMPY)]


def same(ours, theirs):
    size = np.abs(theirs).max(axis=(0, 1))
    assert np.isfinite(theirs).all()
    assert (np.abs(ours - theirs) <= 1e-13 * size).all()


@needs_compiler
@pytest.mark.parametrize("name", VARIED)
def test_compiled_entries_of_every_model_match_casadi(name):
    same(*both(name))


@needs_compiler
def test_compiled_entries_match_casadi_at_every_width(width):
    for points in (1, 9):
        same(*both("mathieu", points))


@needs_compiler
def test_impossible_linkages_give_nan_entries():
    family = SystemFamily(solve.load("coupler"), ["l2"], 400.0)
    points = np.array([[0.3], [0.7]])
    for engine in (COMPILED, NUMPY):
        unknown = np.isnan(family.entries(np.array([0.3]), points, engine))
        assert not unknown[0].any()
        assert unknown[1].all()


def linearised_along(name, points=21):
    """Entries along a motion far from rest, in compiled code and by CasADi."""
    model = solve.load(name)
    nodes = np.linspace(0, model.period, 6)
    noise = np.random.default_rng(4).uniform(-0.1, 0.1, (2, 6, model.n))
    motion = Curve.quintic(nodes, *noise, np.zeros((5, model.n)), np.ones((5, model.n)))
    phase, used = np.linspace(0, model.period, points), []

    def spied(*given):
        used.append(columns(*given))
        return used[-1]

    computed = [model.along(motion, each).entries(phase, 2.0)[None] for each in (spied, None)]
    assert used[0] is not None
    return computed


@needs_compiler
@pytest.mark.parametrize("name", ["cam", "coupler", "gear_pair", "manipulator"])
def test_entries_along_a_motion_match_for_every_model(name):
    same(*linearised_along(name))


@needs_compiler
def test_entries_along_a_motion_match_for_every_width(width):
    for points in (1, 9):
        same(*linearised_along("manipulator", points))


def test_casadi_is_used_without_compiled_code():
    model = solve.load("cam")
    rest = solve.periodic(model, 20.0).curve
    phase = np.linspace(0, model.period, 9)
    with_none, without = (model.along(rest, each).entries(phase, 20.0) for each in (lambda *_: None, None))
    np.testing.assert_array_equal(with_none, without)
