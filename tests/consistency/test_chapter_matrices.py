"""Matrices of the chapter's mechanisms: derived, hand-coded and automatically differentiated entries
agree."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from chapter import (
    GENERATED,
    GRID,
    PUBLISHED,
    built,
    magnitudes,
    parameter_sets,
    sampled,
    scaled_difference,
    vector,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import solve
from tests.solve.systems import cam_matrices

TOLERANCE = 1e-12
LOADS = ["tracking", "constant"]
PROBLEMS = [("cam", {}), ("manipulator", {}), *(("gear_pair", {"load": load}) for load in LOADS)]
NAMES = ["M", "C", "K", "d"]
problems = pytest.mark.parametrize(("name", "options"), PROBLEMS, ids=["cam", "manipulator", *LOADS])


@problems
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_derived_matrices_equal_the_chapter(name, options, data):
    p = data.draw(parameter_sets(GENERATED[name]))
    speed = data.draw(magnitudes())
    phases = GRID + data.draw(st.floats(0, 0.098))
    derived = sampled(built(name, "linearised", **options), phases, speed, vector(name, p))
    by_hand = PUBLISHED[name].matrices(phases, speed, p, **options)
    for label, first, second in zip(NAMES, derived, by_hand, strict=True):
        assert scaled_difference(first, second) < TOLERANCE, label


@problems
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_differentiated_residual_gives_the_matrices(name, options, data):
    p, speed = vector(name, data.draw(parameter_sets(GENERATED[name]))), data.draw(magnitudes())
    differentiated = jacobians(built(name, "residual", **options))
    derived = sampled(built(name, "linearised", **options), GRID, speed, p)
    for label, first, second in zip(NAMES, sampled(differentiated, GRID, speed, p), derived, strict=True):
        assert scaled_difference(first, second) < TOLERANCE, label


@cache
def jacobians(residual: ca.Function) -> ca.Function:
    """Return M, C, K and d of a residual by automatic differentiation at q = q̇ = q̈ = 0."""
    n = residual.size1_in("q")
    phase, speed, p = ca.SX.sym("phase"), ca.SX.sym("speed"), ca.SX.sym("p", residual.size1_in("p"))
    q, qd, qdd = (ca.SX.sym(name, n) for name in ("q", "qd", "qdd"))
    r = residual(phase, speed, q, qd, qdd, p)
    parts = [ca.densify(ca.jacobian(r, by)) for by in (qdd, qd, q)] + [-r]
    at_rest = ca.substitute(parts, [q, qd, qdd], [ca.SX.zeros(n)] * 3)
    return ca.Function("jacobians", [phase, speed, p], at_rest)


def test_gear_pair_has_the_mass_and_damping_of_its_data():
    p = vector("gear_pair", solve.load("gear_pair").parameters)
    M, C, K, _ = sampled(built("gear_pair", "linearised"), GRID, 60 * np.pi, p)
    assert M[:, 0, 0] == pytest.approx(27.4336825, abs=5e-8)
    assert C[:, 0, 0] == pytest.approx(7192.5356, abs=5e-5)
    assert np.sqrt(K[:, 0, 0].mean() / M[0, 0, 0]) == pytest.approx(5462.0626, abs=5e-5)


@pytest.mark.parametrize("case", ["1", "2"])
def test_cam_of_the_package_matches_the_chapter(case):
    """Generated matrices of both cases, compared with hand-coded Eq. (64) and Tables 1 and 2."""
    phase = np.linspace(0.0, 2 * np.pi, 517)
    by_hand = cam_matrices(case)(phase, 20 * np.pi)
    for ours, theirs in zip(solve.load("cam", case=case).at(phase, 20 * np.pi), by_hand, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13 * np.abs(theirs).max())
