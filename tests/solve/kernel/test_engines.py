"""Compiled code and NumPy give the same results and warnings, whatever was computed before."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import Gauss, Radau, floquet, load, periodic
from solve.errors import ResonanceError, StepsError
from solve.kernel import collocation, engines
from solve.kernel.engines import COMPILED, NUMPY, EngineError, chosen_engine
from solve.kernel.library import trouble
from solve.period.grid import Grid
from solve.period.points import SinglePoint
from solve.studies.compare import compare
from tests.solve import systems

METHODS = [Radau(3), Radau(5), Radau(), Gauss(4), Gauss(), Gauss(16)]
needs_compiler = pytest.mark.skipif(bool(trouble()), reason=trouble() or "there is a compiler")


def both(function):
    """Results of a function with each engine."""
    return [function(engine) for engine in (NUMPY, COMPILED)]


@needs_compiler
@settings(max_examples=25, deadline=None)
@given(
    seed=systems.seeds,
    n=st.sampled_from([1, 2, 3]),
    method=st.sampled_from(METHODS),
    steps=st.sampled_from([8, 15, 16, 24, 64, 192]),
)
def test_grids_agree_between_engines(seed, n, method, steps):
    system = systems.random_system(seed, n)
    grid = Grid.uniform(steps, system.period)
    truth, computed = both(
        lambda engine: method.solutions(SinglePoint(system, 1.0), grid, True, engine).steps
    )
    for one, other in ((computed.A, truth.A), (computed.b, truth.b)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(other).max())


@needs_compiler
@pytest.mark.parametrize("method", METHODS, ids=lambda method: f"{method.name} {method.order}")
def test_orbits_of_the_stiff_cam_agree_between_engines(method):
    cam, steps = systems.cam(), 400
    plain, ours = both(lambda engine: periodic(cam, "600 rpm", method, steps, 0.9, engine))
    assert ours.warnings == plain.warnings
    assert ours.verdict == plain.verdict
    radius = plain.spectral_radius
    np.testing.assert_allclose(ours.multipliers, plain.multipliers, rtol=0, atol=1e-10 * radius)
    for part in ("q", "qd"):
        theirs = getattr(plain, part)
        size = np.abs(theirs).max(axis=1, keepdims=True)
        assert (np.abs(getattr(ours, part) - theirs) <= 1e-10 * size).all()
    assert ours.liouville == pytest.approx(plain.liouville, abs=1e-8)


@needs_compiler
@pytest.mark.parametrize("name", ["cam", "manipulator", "gear_pair", "coupler"])
def test_certified_solutions_agree_between_engines(name):
    model = load(name)
    speed = {"gear_pair": 180.0, "coupler": 500.0}.get(name, 40.0)
    plain, ours = both(lambda engine: periodic(model, speed, engine=engine))
    assert (ours.method, ours.steps, ours.verdict) == (plain.method, plain.steps, plain.verdict)
    assert ours.warnings == plain.warnings
    assert ours.spectral_radius == pytest.approx(plain.spectral_radius, rel=1e-10)
    for coordinate in model.coordinates:
        one, other = ours.statistics(coordinate), plain.statistics(coordinate)
        assert one.max == pytest.approx(other.max, abs=1e-10 * other.max_abs)


@needs_compiler
def test_growth_by_many_decades_is_accurate():
    growth = 13 * np.log(10.0) / (2 * np.pi)
    K = np.diag([-(growth**2), 2.0])
    given = systems.constant(np.eye(2), np.zeros((2, 2)), K, lambda phase: np.cos(np.outer(phase, [1, 2])))
    plain, ours = both(lambda engine: periodic(given, 1.0, "radau", rtol=1e-11, engine=engine))
    for orbit in (plain, ours):
        np.testing.assert_allclose(orbit.at(np.zeros(1))[0], 1 / (K[0, 0] - 1), rtol=1e-10)


@needs_compiler
def test_error_messages_agree_between_engines():
    def message(function, error):
        with pytest.raises(error) as refusal:
            function()
        return str(refusal.value)

    resonant = systems.constant([[1.0]], [[0.0]], [[1.0]], lambda phase: np.cos(phase)[:, None])
    one, other = both(
        lambda engine: message(lambda: periodic(resonant, 1.0, "gauss", 64, engine=engine), ResonanceError)
    )
    assert one == other
    growing = systems.constant([[1.0]], [[0.0]], [[-1e5]], lambda phase: np.cos(phase)[:, None])
    one, other = both(
        lambda engine: message(lambda: floquet(growing, 1.0, "gauss", 256, engine=engine), StepsError)
    )
    assert one == other


@needs_compiler
def test_engine_depends_on_the_call_only(monkeypatch):
    """Compiled code is used from the first solution on, and NumPy if requested, regardless of earlier
    calls."""
    calls = []
    solved = collocation.solved
    monkeypatch.setattr(collocation, "solved", lambda *given: calls.append(1) or solved(*given))
    oscillator = systems.constant([[1.0]], [[0.1]], [[2.0]], lambda phase: np.cos(phase)[:, None])
    counts = []
    for engine in (NUMPY, "auto", NUMPY, COMPILED, "auto"):
        calls.clear()
        periodic(oscillator, 1.0, engine=engine)
        counts.append(len(calls))
    assert counts[0] == counts[2] == 0
    assert counts[1] == counts[3] == counts[4] > 0


def test_missing_compiler_selects_numpy_unless_compiled_is_required(monkeypatch):
    monkeypatch.setattr(engines, "trouble", lambda: "no C compiler (cc) on this machine")
    assert chosen_engine("auto")[0] == NUMPY
    with pytest.raises(EngineError, match=r"no C compiler \(cc\) on this machine; omit the engine"):
        chosen_engine(COMPILED)
    monkeypatch.setattr(engines, "trouble", lambda: "C compiler 'cc' failed: no space")
    oscillator = systems.constant([[1.0]], [[0.1]], [[2.0]], lambda phase: np.cos(phase)[:, None])
    (note,) = periodic(oscillator, 1.0).notes
    assert note == "C compiler 'cc' failed: no space; NumPy is used, several times slower"


def test_methods_are_compared_in_numpy(monkeypatch):
    """Times of a compiled Gauss method with 264 steps and of Radau with 294 steps in NumPy would not be
    comparable."""
    oscillator = systems.constant([[1.0]], [[0.1]], [[2.0]], lambda phase: np.cos(phase)[:, None])
    reference = periodic(oscillator, 1.0, rtol=1e-12, engine=NUMPY)
    monkeypatch.setattr("solve.studies.compare.periodic", lambda *given, **named: reference)
    monkeypatch.setattr(collocation, "solved", lambda *given: pytest.fail("compiled"))
    rows = compare(oscillator, 1.0, ["gauss"], steps=[64], targets=[1e-3]).rows
    assert [row.reason for row in rows] == [None, None]
