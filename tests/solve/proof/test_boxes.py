"""Boxes of a proved chart, compared with closed forms and with numerical multipliers."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("flint")

import solve
from derive import Mechanism, cos, pi, rate, sqrt
from solve.errors import LinearModelError, StepsError
from solve.period.multipliers import ASYMPTOTICALLY_STABLE, STABLE, UNDETERMINED, UNSTABLE
from solve.proof import boxes as of_boxes
from solve.proof import regions
from solve.proof.balls import acb, arb
from solve.proof.boxes import _halving, proved_boxes
from solve.proof.enclosure import equation_of
from solve.proof.prove import prove_boxes
from solve.proof.regions import Box, Plane, polynomials
from tests.solve.proof.test_prove import exact_trace


def mathieu(**parameters):
    return solve.load("mathieu", **{"zeta": 0.01, **parameters})


def plane(**parameters):
    return Plane(mathieu(**parameters), ("delta", "epsilon"), 1.0)


def values_at(made, x, y):
    """Return the values of the polynomials at x and y in [−1, 1]."""
    across, upwards = (
        np.polynomial.chebyshev.chebvander(z, k - 1)[0]
        for z, k in zip((x, y), made.coefficients.shape[1:], strict=True)
    )
    return across @ made.coefficients @ upwards


def inside(box, rng):
    return [rng.uniform(low, high) for low, high in box]


@pytest.mark.parametrize("accuracy", [2.0**-20, 1e-2])
def test_trace_bound_over_a_box_contains_the_exact_trace(accuracy, monkeypatch):
    """The error of a polynomial of low degree is large enough to test the bound."""
    monkeypatch.setattr(regions, "_ACCURACY", accuracy)
    box, rng = Box((3.0, 3.25), (0.5, 0.75)), np.random.default_rng(5)
    made = polynomials(plane(), box)
    assert made is not None
    assert made.errors[0] < accuracy
    for x, y in rng.uniform(-1, 1, (3, 2)):
        trace = float(exact_trace(3.125 + x / 8, 0.625 + y / 8, 0.01))
        assert abs(values_at(made, x, y)[0] - trace) <= made.errors[0]


@pytest.mark.parametrize(("low", "bounded"), [(-0.5, False), (0.5, True)])
def test_coefficient_that_is_not_analytic_has_no_bound(low, bounded):
    """The damping of one of two coordinates contains √k. The ellipse about k contains k = 0 in one case
    only."""
    made = Mechanism("rooted", "Two oscillators, one damped by a root", energy="1/s^2")
    u, v = made.coordinates(u=("1", "first"), v=("1", "second"))
    (k,) = made.parameters(k=("1/s^2", "stiffness"))
    made.kinetic = (rate(u) ** 2 + rate(v) ** 2) / 2
    made.potential = k * (u**2 + v**2) / 2
    made.dissipation = sqrt(k) * rate(v) ** 2 / 2
    made.decline_drive_torque("an equation without physical units has no torque")
    equation = equation_of(solve.load(made, k=1.0), 1.0, False)
    complex_k = dataclasses.replace(equation, parameters=(acb(arb(low + 1, 1.0), arb(0, 0.1)),))
    growth, _ = complex_k.growth(acb(arb(1)), ())
    assert growth.is_finite() == bounded


def test_polynomial_is_unchanged_by_halving_its_interval():
    rng = np.random.default_rng(7)
    c, x = rng.normal(size=12), rng.uniform(-1, 1, 50)
    for side in (-1, 1):
        half = np.polynomial.chebyshev.chebval(x, _halving(12, side) @ c)
        np.testing.assert_allclose(half, np.polynomial.chebyshev.chebval((x + side) / 2, c), atol=1e-13)


@pytest.mark.parametrize(("width", "verdict"), [(1.0, ASYMPTOTICALLY_STABLE), (2.0**-40, UNDETERMINED)])
def test_verdict_of_a_box_includes_its_rounded_ends(width, verdict):
    """The trace is 2 T_40(x)/(1 + 1e-3). In narrow boxes, it exceeds 1 + D = 2 at a distance of 2^-52 beyond
    the box."""
    c = np.zeros((2, 41, 1))
    c[0, 40], c[1, 0] = 2 / (1 + 1e-3), 1 - 1e-9
    beyond = 2 / (1 + 1e-3) * np.cosh(40 * np.arccosh(1 + 2 * 2.0**-52 / width))
    assert (beyond < 2) == (verdict == ASYMPTOTICALLY_STABLE)
    piece = of_boxes._Piece(Box((1.0, 1.0 + width), (0.0, 1.0)), c, np.zeros(2), False)
    assert of_boxes._verdict(piece, 1) == verdict


@pytest.mark.slow
def test_boxes_of_meissners_equation_agree_with_the_closed_form():
    """The stiffness alternates between w1² and w2², each for 1 s, without damping. The trace of Φ is 2 cos w1
    cos w2 − (w1/w2 + w2/w1) sin w1 sin w2."""
    system, whole, rng = solve.load("meissner"), Box((1.0, 1.5), (2.0, 2.5)), np.random.default_rng(3)
    boxes = proved_boxes(Plane(system, ("w1", "w2"), np.pi), whole)
    assert boxes.fraction(STABLE) > 0.2
    assert boxes.fraction(UNSTABLE) > 0.05
    assert boxes.fraction(UNDETERMINED) <= 0.001
    assert boxes.fraction(ASYMPTOTICALLY_STABLE) == 0
    for ends, verdict in zip(boxes.ends, boxes.verdicts, strict=True):
        w1, w2 = inside((ends[:2], ends[2:]), rng)
        trace = 2 * np.cos(w1) * np.cos(w2) - (w1 / w2 + w2 / w1) * np.sin(w1) * np.sin(w2)
        assert verdict == UNDETERMINED or verdict == (STABLE if abs(trace) < 2 else UNSTABLE)
    areas = (boxes.ends[:, 1] - boxes.ends[:, 0]) * (boxes.ends[:, 3] - boxes.ends[:, 2])
    np.testing.assert_allclose(areas.sum(), 0.25, rtol=1e-12)


def two_oscillators():
    """Return two uncoupled Mathieu equations, a″ + c a′ + (k + e cos 2t) a = 0 and b″ + c b′ + 3 k b = 0, in
    the coordinates u = a + b and v = a − b."""
    made = Mechanism("two_oscillators", "Two uncoupled oscillators in coupled coordinates", period=pi)
    u, v = made.coordinates(u=("m", "sum"), v=("m", "difference"))
    k, e, c, m = made.parameters(
        k=("N/m", "mean stiffness", "> 0"),
        e=("N/m", "variation of the stiffness"),
        c=("N s/m", "damping", ">= 0"),
        m=("kg", "mass", "> 0"),
    )
    a, b = (u + v) / 2, (u - v) / 2
    made.kinetic = m * (rate(a) ** 2 + rate(b) ** 2) / 2
    made.potential = (k + e * cos(2 * made.phase)) * a**2 / 2 + 3 * k * b**2 / 2
    made.dissipation = c * (rate(a) ** 2 + rate(b) ** 2) / 2
    return made


@pytest.mark.slow
def test_boxes_of_two_coordinates_match_the_single_oscillators(monkeypatch):
    monkeypatch.setattr(of_boxes, "_OPEN", 0.1)
    system = solve.load(two_oscillators(), k=1.0, e=0.4, c=0.1, m=1.0)
    boxes = proved_boxes(Plane(system, ("k", "e"), 1.0), Box((0.5, 0.9), (0.1, 0.5)))
    assert boxes.fraction(UNSTABLE) > 0.03
    assert boxes.fraction(ASYMPTOTICALLY_STABLE) > 0.1
    assert boxes.fraction(UNDETERMINED) <= 0.1
    rng = np.random.default_rng(11)
    decided = np.flatnonzero(boxes.verdicts != UNDETERMINED)
    for at in rng.choice(decided, 12, replace=False):
        k, e = inside((boxes.ends[at, :2], boxes.ends[at, 2:]), rng)
        alone = solve.load("mathieu", delta=k, epsilon=e, zeta=0.05 / np.sqrt(k))
        stable = solve.floquet(alone, 1.0).spectral_radius < 1
        assert boxes.verdicts[at] == (ASYMPTOTICALLY_STABLE if stable else UNSTABLE)


def test_chart_reports_proved_fractions_and_contradictions():
    chart = solve.chart(
        mathieu(), {"delta": [0.9, 1.0, 1.1]}, {"epsilon": [0.0, 0.1, 0.2]}, 1.0, prove=True, boundaries=False
    )
    record = chart.record()
    fractions = record["proved"]
    assert fractions["stable"] + fractions["unstable"] + fractions["undecided"] == pytest.approx(1, rel=1e-12)
    assert fractions["undecided"] <= 0.001
    assert len(record["boxes"]) == len(chart.proved.ends)
    assert chart.contradicted == 0
    names = np.array(["asymptotically stable", "stable", "unstable", "undetermined"])
    proved = names[chart.proved.at(chart.x, chart.y)]
    assert (proved[[0, 2], [0, 1]] == ["asymptotically stable", "unstable"]).all()
    wrong = dataclasses.replace(chart.proved, verdicts=np.full(len(chart.proved.ends), UNSTABLE))
    assert dataclasses.replace(chart, proved=wrong).contradicted > 0


def test_unsupported_proofs_are_refused():
    ranges = ((60.0, 63.0), (7e4, 8e4))
    with pytest.raises(
        StepsError, match=r"cam is too stiff for a proved chart: a box of 0.0117 by 39.1 requires"
    ):
        prove_boxes(solve.load("cam"), ("speed", "k1"), ranges, None)
    with pytest.raises(LinearModelError, match=r"jumps of the equations move with share or w1"):
        prove_boxes(solve.load("meissner"), ("share", "w1"), ((0.4, 0.6), (1.0, 1.5)), np.pi)
    with pytest.raises(LinearModelError, match="'prove' requires a model, not a function"):
        solve.chart(lambda delta, epsilon: mathieu(), "delta=1:2:3", "epsilon=0:1:3", 1.0, prove=True)
    with pytest.raises(LinearModelError, match="a proof requires matrices"):
        solve.chart("four_bar", "L2=0.5:0.6:3", "L4=0.5:0.6:3", 30.0, prove=True)
