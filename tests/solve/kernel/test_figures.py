"""Statistics of curves and values of formulas in compiled code, compared with NumPy and closed forms."""

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

import solve
from solve.contracts import Formulas
from solve.kernel.engines import COMPILED, NUMPY
from solve.model.formulas import c_text
from solve.model.sampling import Sampler
from solve.period.curve import Curve
from solve.period.quantities import Quantities
from solve.period.signals import FIGURES
from tests.solve.kernel.test_lanes import needs_compiler

SAME = 1e-12


def waves(points, n, steps, seed):
    """Curves through waves of orders 1 to 3 with random phases."""
    rng = np.random.default_rng(seed)
    size, turned = rng.normal(size=(points, n, 3)), rng.uniform(0, 2 * np.pi, (points, n, 3))
    nodes, k = np.linspace(0, 2 * np.pi, steps + 1), np.arange(1, 4)
    angle = k * nodes[:, None, None, None] + turned
    q, v, a = (
        np.moveaxis((size * part).sum(axis=-1), 0, 1)
        for part in (np.cos(angle), -k * np.sin(angle), -(k**2) * np.cos(angle))
    )
    return Curve.quintic(nodes, q, v, a[:, :-1], a[:, 1:])


def compared(ours, theirs):
    size = np.abs(theirs[..., FIGURES.index("max_abs")])
    for at, name in enumerate(FIGURES):
        # The place of an extremum is known to the square root of what its value is known to.
        most = np.sqrt(SAME) if name.endswith("phase") else SAME * size
        assert (np.abs(ours[..., at] - theirs[..., at]) <= most).all(), name


@needs_compiler
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**20), points=st.sampled_from([1, 5, 8, 17]), steps=st.sampled_from([5, 24, 385]))
def test_compiled_statistics_of_curves_match_numpy(seed, points, steps):
    curve, speeds = waves(points, 2, steps, seed), np.ones(points)
    compiled = Quantities(curve, speeds, engine=COMPILED)
    assert compiled.compiled_figures() is not None
    compared(compiled.figures(), Quantities(curve, speeds, engine=NUMPY).figures())


def beats(order, depth, turned, steps):
    """Fast wave whose amplitude varies once per period, with many nearly equal maxima."""
    nodes = np.linspace(0, 2 * np.pi, steps + 1)
    size, rate, bend = (depth * np.cos(nodes + turned + part * np.pi / 2) for part in range(3))
    wave, slope = np.cos(order * nodes), -order * np.sin(order * nodes)
    q, v = (1 + size) * wave, rate * wave + (1 + size) * slope
    a = bend * wave + 2 * rate * slope - order**2 * (1 + size) * wave
    q, v, a = (part[None, :, None] for part in (q, v, a))
    return Curve.quintic(nodes, q, v, a[:, :-1], a[:, 1:])


@pytest.mark.parametrize("engine", [NUMPY, pytest.param(COMPILED, marks=needs_compiler)])
@pytest.mark.parametrize(
    ("order", "depth", "turned"), [(277, 0.028, 0.4), (321, 0.064, 2.9), (237, 0.037, 5.0)]
)
def test_highest_maximum_is_found_between_lower_samples(engine, order, depth, turned):
    curve = beats(order, depth, turned, 512)
    computed = Quantities(curve, np.ones(1), engine=engine).figures()[0, 0]
    phases = np.linspace(0, 2 * np.pi, 400 * order)
    values = curve(phases)[0, 0]
    for sign, figure, at in ((1, "max", "max_phase"), (-1, "min", "min_phase")):
        best = phases[(sign * values).argmax()]
        truth = minimize_scalar(
            lambda phase, sign=sign: -sign * curve(np.array([phase]))[0, 0, 0],
            bounds=(best - 0.01 / order, best + 0.01 / order),
            method="bounded",
            options={"xatol": 1e-12},
        )
        assert sign * computed[FIGURES.index(figure)] == pytest.approx(-truth.fun, rel=1e-9)
        assert curve(computed[[FIGURES.index(at)]])[0, 0, 0] == pytest.approx(computed[FIGURES.index(figure)])


@needs_compiler
def test_statistics_of_a_cosine_match_the_closed_form():
    nodes = np.linspace(0, 2 * np.pi, 257)
    wave = [(3 * np.cos(nodes - 1 + part * np.pi / 2))[None, :, None] for part in range(3)]
    curve = Curve.quintic(nodes, wave[0], wave[1], wave[2][:, :-1], wave[2][:, 1:])
    (computed,) = Quantities(curve, np.ones(1), engine=COMPILED).figures()[0]
    truth = [3, -3, 3, 0, 1, 1 + np.pi, 3 / np.sqrt(2)]
    np.testing.assert_allclose(computed, truth, atol=3e-7)


def written(phase, speed, q, qd, qdd, p):
    """Expressions with one of every operation that has C code."""
    compare = casadi.if_else(casadi.logic_or(q[0] < q[1], p[0] <= 0), q[0], 2 * q[1])
    equal = casadi.if_else(p[0] == p[0], 1.0, casadi.if_else(p[0] != 1, 2.0, 3.0))
    large = 2 + casadi.fabs(q[0])
    return [
        casadi.sin(phase) + casadi.cos(q[0]) * casadi.tan(q[1] / 9) - compare,
        casadi.sqrt(large) * casadi.log(large) / casadi.exp(q[1] / 9) - equal,
        casadi.atan2(qd[0], large) + casadi.fmin(qdd[0], qdd[1]) - casadi.fmax(q[0], q[1]),
        p[0] ** 2 * speed * qd[1] + large ** p[0] + casadi.atan(q[0]) + casadi.tanh(q[1]) + 1 / large,
        casadi.asinh(q[0]) + casadi.acosh(large) * casadi.atanh(1 / large),
    ]


def formulas():
    inputs = [casadi.SX.sym(name, size) for name, size in zip("abcdef", (1, 1, 2, 2, 2, 1), strict=True)]
    return casadi.Function("written", inputs, [casadi.vertcat(*written(*inputs))])


def quantities(points, engine):
    curve, speeds = waves(points, 2, 24, 3), np.linspace(1, 2, points)
    values, function = np.linspace(0.5, 1.5, points)[:, None], formulas()
    sampler, text = Sampler(function), c_text(function)
    assert text is not None

    def outputs(phase, q, qd, qdd):
        P, n, k = q.shape
        states = (np.swapaxes(part, 1, 2).reshape(P * k, n) for part in (q, qd, qdd))
        computed = sampler(phase.ravel(), np.repeat(speeds, k), *states, np.repeat(values, k, axis=0))
        return np.swapaxes(computed.reshape(P, k, -1), 1, 2)[:, [3, 0, 1, 2, 4]]

    code = Formulas(text, 5, ("p",), values)
    return Quantities(curve, speeds, outputs, engine, code, [3, 0, 1, 2, 4])


@needs_compiler
def test_compiled_formulas_match_casadi_at_every_width(width):
    assert quantities(11, COMPILED).compiled_figures() is not None
    compared(quantities(11, COMPILED).figures(), quantities(11, NUMPY).figures())


def test_unsupported_operation_has_no_c_text():
    x = casadi.SX.sym("x")
    assert c_text(casadi.Function("f", [x], [casadi.erf(x)])) is None
    assert c_text(casadi.Function("f", [x], [x * casadi.inf])) is None


@needs_compiler
def test_quantity_that_is_not_finite_is_evaluated_by_numpy():
    curve = Curve(np.linspace(0, 1, 5), np.full((1, 1, 4, 3), np.nan))
    assert Quantities(curve, np.ones(1), engine=COMPILED).compiled_figures() is None


@needs_compiler
def test_selected_outputs_with_varying_parameters():
    model = solve.load("cam")
    assert model.parameters["a2"] == 0
    ours, theirs = (
        solve.sweep(
            model, [60.0, 62.0], over="a2=0:1e-3:3", quantities=["output_displacement", "q2"], engine=engine
        )
        for engine in (COMPILED, NUMPY)
    )
    for name in ("output_displacement", "q2"):
        np.testing.assert_allclose(ours.figures(name, "max"), theirs.figures(name, "max"), rtol=1e-10)
        assert len(set(ours.figures(name, "max").tolist())) == 6


@pytest.mark.parametrize("engine", [NUMPY, pytest.param(COMPILED, marks=needs_compiler)])
@pytest.mark.parametrize("second", [1 - 1e-13, 1.0, 1 + 1e-13])
def test_first_of_nearly_equal_extrema_gives_the_phase(engine, second):
    """Wave of order 2, whose halves have equal amplitudes up to round-off."""
    nodes = np.linspace(0, 2 * np.pi, 65)
    size = np.where(nodes[:-1] < np.pi, 1.0, second)
    q, v, a = ((2**part * np.cos(2 * (nodes - 0.7) + part * np.pi / 2))[None, :, None] for part in range(3))
    curve = Curve.quintic(nodes, q, v, a[:, :-1], a[:, 1:])
    curve = Curve(curve.nodes, curve.coefficients * size[:, None])
    computed = dict(zip(FIGURES, Quantities(curve, np.ones(1), engine=engine).figures()[0, 0], strict=True))
    assert computed["max_phase"] == pytest.approx(0.7, abs=1e-6)
    assert computed["min_phase"] == pytest.approx(0.7 + np.pi / 2, abs=1e-6)
