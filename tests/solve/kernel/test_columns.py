"""Compiled derivatives of generated functions compared with CasADi's interpreter."""

import numpy as np
import pytest

import solve
from solve.kernel.formulas import columns
from solve.labels import SPEED
from tests.solve.kernel.test_lanes import needs_compiler

MODELS = "cam", "coupler", "gear_pair", "manipulator", "mathieu"


def both(name, names, count):
    model, rng = solve.load(name), np.random.default_rng(2)
    phase, states = rng.uniform(0, model.period, count), rng.standard_normal((count, 3, model.n))
    along, entries = (
        rng.standard_normal((count, model.n, 2)),
        rng.standard_normal((count, 3, model.n, model.n)),
    )
    computed = []
    for compiled in (columns, None):
        dependence = model.derivatives.by(names, compiled)
        at = phase, 31.0, states
        by_entries, _ = dependence.matrices(*at, entries)
        residual, summed = dependence.residual(*at), dependence.weighted_residual(*at, along)
        assert np.allclose(summed, np.einsum("knr,knc->rc", residual, along))
        computed.append((residual, summed, by_entries))
    return computed


def same(ours, theirs):
    for one, other in zip(ours, theirs, strict=True):
        assert one.shape == other.shape
        assert np.allclose(one, other, rtol=1e-11, atol=1e-11 * np.abs(other).max())


@needs_compiler
@pytest.mark.parametrize("name", MODELS)
def test_compiled_derivatives_of_every_model_match_casadi(name):
    smooth = solve.load(name).derivatives.names
    same(*both(name, [smooth[-1], SPEED, smooth[0]], 13))


@needs_compiler
def test_compiled_derivatives_match_casadi_at_every_width(width):
    for count in (1, 9):
        same(*both("mathieu", ["delta"], count))
