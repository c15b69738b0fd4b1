"""A period in compiled segments gives what NumPy gives, to the letter of its warnings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import Gauss, Radau, floquet, load, periodic
from solve.errors import ResonanceError, StepsError
from solve.methods import segments
from solve.period.grid import Grid
from solve.studies.compare import compare
from tests.solve import systems

METHODS = [Radau(3), Radau(5), Radau(), Gauss(4), Gauss(), Gauss(16)]
needs_compiler = pytest.mark.skipif(
    not segments.prepare(Gauss(4).collocation, 1), reason="no working C compiler on this machine"
)


@pytest.fixture
def both(monkeypatch):
    """Run a function by NumPy, and in compiled segments from the first grid on."""

    def run(function):
        found = []
        for compiled in (False, True):
            with monkeypatch.context() as patch:
                patch.setattr(segments, "ready", lambda *kind, c=compiled: c and at_once(*kind))
                found.append(function())
        return found

    return run


def at_once(method, n, steps):
    return steps % 8 == 0 and segments.prepare(method, n)


@needs_compiler
@settings(max_examples=25, deadline=None)
@given(
    seed=systems.seeds,
    n=st.sampled_from([1, 2, 3]),
    method=st.sampled_from(METHODS),
    steps=st.sampled_from([8, 16, 24, 64, 192]),
)
def test_grids_are_the_same(seed, n, method, steps):
    system = systems.random_system(seed, n)
    grid, collocation = Grid.uniform(steps, system.period), method.collocation
    truth = method.discretise(system, 1.0, grid)
    segments.prepare(collocation, n)
    found = method._in_segments(system, 1.0, grid)
    size = np.abs(truth.steps.A).max()
    np.testing.assert_allclose(found.maps[..., :-1], truth.steps.A, rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(
        found.maps[..., -1], truth.steps.b, rtol=0, atol=1e-12 * np.abs(truth.steps.b).max()
    )


@needs_compiler
@pytest.mark.parametrize("method", METHODS, ids=lambda method: f"{method.name} {method.order}")
def test_orbits_of_the_stiff_cam_are_the_same(method, both):
    cam, steps = systems.cam(), 400
    plain, ours = both(lambda: periodic(cam, "600 rpm", method, steps=steps, rtol=0.9))
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
def test_certified_solves_are_the_same(name, both):
    model = load(name)
    speed = {"gear_pair": 180.0, "coupler": 500.0}.get(name, 40.0)
    plain, ours = both(lambda: periodic(model, speed))
    assert (ours.method, ours.steps, ours.verdict) == (plain.method, plain.steps, plain.verdict)
    assert ours.warnings == plain.warnings
    assert ours.spectral_radius == pytest.approx(plain.spectral_radius, rel=1e-10)
    for coordinate in model.coordinates:
        one, other = ours.statistics(coordinate), plain.statistics(coordinate)
        assert one.max == pytest.approx(other.max, abs=1e-10 * other.max_abs)


@needs_compiler
def test_growth_by_many_decades_keeps_its_digits(both):
    growth = 13 * np.log(10.0) / (2 * np.pi)
    K = np.diag([-(growth**2), 2.0])
    given = systems.constant(np.eye(2), np.zeros((2, 2)), K, lambda phase: np.cos(np.outer(phase, [1, 2])))
    plain, ours = both(lambda: periodic(given, 1.0, "radau", rtol=1e-11))
    for orbit in (plain, ours):
        np.testing.assert_allclose(orbit.at(np.zeros(1))[0], 1 / (K[0, 0] - 1), rtol=1e-10)


@needs_compiler
def test_refusals_are_the_same(both):
    def message(function, error):
        with pytest.raises(error) as refusal:
            function()
        return str(refusal.value)

    resonant = systems.constant([[1.0]], [[0.0]], [[1.0]], lambda phase: np.cos(phase)[:, None])
    one, other = both(lambda: message(lambda: periodic(resonant, 1.0, "gauss", steps=64), ResonanceError))
    assert one == other
    growing = systems.constant([[1.0]], [[0.0]], [[-1e5]], lambda phase: np.cos(phase)[:, None])
    one, other = both(lambda: message(lambda: floquet(growing, 1.0, "gauss", steps=256), StepsError))
    assert one == other


def test_few_grids_are_not_worth_a_compiler(monkeypatch):
    monkeypatch.setattr(segments, "_solved", type(segments._solved)())
    monkeypatch.setattr(segments, "_ready", {})
    asked = []
    monkeypatch.setattr(segments, "prepare", lambda method, n, kept=False: asked.append(kept))
    method = Radau().collocation
    for _ in range(segments.COMPILE_AFTER + 5):
        segments.ready(method, 3, 64)
    assert asked == [True, False]
    assert not segments.ready(method, 3, 63)


def test_methods_are_compared_in_numpy(monkeypatch):
    """A compiled Gauss of 264 steps beside a Radau of 294 in NumPy would say nothing of the methods."""
    monkeypatch.setattr(segments, "_ready", {Gauss().collocation.size(1, True): True})
    monkeypatch.setattr(Gauss, "_in_segments", lambda *given: pytest.fail("compiled"))
    oscillator = systems.constant([[1.0]], [[0.1]], [[2.0]], lambda phase: np.cos(phase)[:, None])
    with pytest.raises(pytest.fail.Exception):
        Gauss().solution(oscillator, 1.0, Grid.uniform(64, oscillator.period), True)
    monkeypatch.setattr("solve.studies.compare.periodic", lambda *given, **named: reference)
    with segments.in_numpy():
        reference = periodic(oscillator, 1.0, rtol=1e-12)
    rows = compare(oscillator, 1.0, ["gauss"], steps=[64], targets=[1e-3]).rows
    assert [row.reason for row in rows] == [None, None]
