"""Proved boxes against closed forms and against the ordinary multipliers."""

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("flint")

import solve
from derive import Mechanism, cos, rate
from solve.errors import LinearModelError, StepsError
from solve.period.multipliers import ASYMPTOTICALLY_STABLE, STABLE, UNDETERMINED, UNSTABLE
from solve.proof import boxes as of_boxes
from solve.proof import regions
from solve.proof.boxes import _halving, proved_boxes
from solve.proof.prove import prove_boxes
from solve.proof.regions import Box, Plane, polynomials
from tests.solve.proof.test_prove import exact_trace


def mathieu(**parameters):
    return solve.load("mathieu", **{"zeta": 0.01, **parameters})


def plane(**parameters):
    return Plane(mathieu(**parameters), ("delta", "epsilon"), 1.0)


def values_at(made, x, y):
    """Of the polynomials at x and y in [−1, 1]."""
    across, upwards = (np.polynomial.chebyshev.chebvander(z, k - 1) for z, k in
                       zip((x, y), made.coefficients.shape[1:], strict=True))
    return across @ made.coefficients @ upwards


def inside(box, rng):
    return [rng.uniform(low, high) for low, high in box]


@pytest.mark.parametrize("accuracy", [2.0**-20, 1e-2])
def test_the_trace_over_a_box_contains_that_of_taylor_series(accuracy, monkeypatch):
    """A low degree leaves a visible error, which the bound covers."""
    monkeypatch.setattr(regions, "_ACCURACY", accuracy)
    box, rng = Box((3.0, 3.25), (0.5, 0.75)), np.random.default_rng(5)
    made = polynomials(plane(), box)
    assert made is not None and made.errors[0] < accuracy
    for x, y in rng.uniform(-1, 1, (3, 2)):
        trace = float(exact_trace(3.125 + x / 8, 0.625 + y / 8, 0.01))
        assert abs(values_at(made, x, y)[0] - trace) <= made.errors[0]


def test_halves_are_the_same_polynomial():
    rng = np.random.default_rng(7)
    c, x = rng.normal(size=12), rng.uniform(-1, 1, 50)
    for side in (-1, 1):
        half = np.polynomial.chebyshev.chebval(x, _halving(12, side) @ c)
        np.testing.assert_allclose(half, np.polynomial.chebyshev.chebval((x + side) / 2, c), atol=1e-13)


def test_boxes_of_meissners_equation_agree_with_the_closed_form():
    """Stiffness w1² and w2² in turn, each for 1 s, without damping: the trace of Φ is
    2 cos w1 cos w2 − (w1/w2 + w2/w1) sin w1 sin w2."""
    system, whole, rng = solve.load("meissner"), Box((1.0, 1.5), (2.0, 2.5)), np.random.default_rng(3)
    found = proved_boxes(Plane(system, ("w1", "w2"), np.pi), whole)
    assert found.fraction(STABLE) > 0.5 and found.fraction(UNSTABLE) > 0.05
    assert found.fraction(UNDETERMINED) <= 0.001 and found.fraction(ASYMPTOTICALLY_STABLE) == 0
    for ends, verdict in zip(found.ends, found.verdicts, strict=True):
        w1, w2 = inside((ends[:2], ends[2:]), rng)
        trace = 2 * np.cos(w1) * np.cos(w2) - (w1 / w2 + w2 / w1) * np.sin(w1) * np.sin(w2)
        assert verdict == UNDETERMINED or verdict == (STABLE if abs(trace) < 2 else UNSTABLE)
    areas = (found.ends[:, 1] - found.ends[:, 0]) * (found.ends[:, 3] - found.ends[:, 2])
    np.testing.assert_allclose(areas.sum(), 0.25, rtol=1e-12)


def two_oscillators():
    """Two uncoupled equations of Mathieu with different stiffness, in coupled coordinates."""
    m = Mechanism("two")
    a, b = m.coordinates("a b", "m", "displacement")
    k, e = m.parameter("k", "N/m", "mean stiffness"), m.parameter("e", "N/m", "variation")
    mass = m.parameter("mass", "kg", "mass")
    c = m.parameter("c", "N s/m", "damping")
    m.energies(
        T=mass * (rate(a) ** 2 + rate(b) ** 2) / 2,
        V=(k + e * cos(2 * m.phase)) * (a + b) ** 2 / 4 + 3 * k * (a - b) ** 2 / 4,
        R=c * (rate(a) ** 2 + rate(b) ** 2) / 2,
    )
    return m
