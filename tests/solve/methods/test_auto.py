"""Default method, and its name in the result."""

import numpy as np
import pytest

from solve import load, periodic
from solve.methods.choice import RESOLVABLE, auto
from solve.period.points import SinglePoint
from tests.solve.systems import constant


def fastest(stiffness, damping=0.0):
    return constant(
        np.eye(2),
        np.diag([0.1, damping]),
        np.diag([1.7, stiffness]),
        lambda phase: np.cos(phase)[:, None] * [1.0, 1.0],
    )


LIMIT = RESOLVABLE / (2 * np.pi)


@pytest.mark.parametrize(
    ("system", "method"),
    [
        (fastest((0.99 * LIMIT) ** 2, 0.3), "gauss"),
        (fastest((1.01 * LIMIT) ** 2, 0.3), "radau"),
        (fastest(2.0, 0.99 * LIMIT), "gauss"),
        (fastest(2.0, 1.01 * LIMIT), "radau"),
    ],
    ids=["slower mode", "faster mode", "slower decay", "faster decay"],
)
def test_fastest_mode_or_decay_determines_the_method(system, method):
    assert selected(system, 1.0) == method
    orbit = periodic(system, 1.0)
    assert orbit.method == method
    assert max(orbit.error_estimate) <= 1e-8


def selected(system, speed):
    """Name of the method that `auto` selects for a system at a speed."""
    ((method, _),) = auto(SinglePoint(system, speed))
    return method.name


def test_speed_also_determines_the_method():
    """Frequencies are divided by the speed: a slow drive makes the system stiff, a fast one does not."""
    system = fastest((2 * LIMIT) ** 2, 0.3)
    assert [selected(system, speed) for speed in (1.0, 3.0)] == ["radau", "gauss"]


@pytest.mark.parametrize(
    ("model", "speed", "method"),
    [("cam", "100 rpm", "radau"), ("cam", "600 rpm", "radau"), ("mathieu", 1.0, "gauss")],
)
def test_auto_selects_the_expected_method_for_each_model(model, speed, method):
    assert periodic(load(model), speed).method == method


@pytest.mark.parametrize("system", [fastest((0.99 * LIMIT) ** 2, 0.3), fastest((1.01 * LIMIT) ** 2, 0.3)])
def test_both_methods_agree_at_the_limit(system):
    phases = np.linspace(0.0, 2 * np.pi, 201)
    orbits = [periodic(system, 1.0, method, rtol=1e-9) for method in ("gauss", "radau")]
    scale = np.abs(orbits[0].at(phases)).max(axis=1, keepdims=True)
    assert (np.abs(orbits[0].at(phases) - orbits[1].at(phases)) < 3e-9 * scale).all()
    assert orbits[0].spectral_radius == pytest.approx(orbits[1].spectral_radius, rel=1e-8)
