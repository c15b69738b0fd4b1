"""Derivatives of tracked extrema, statistics and functions of orbits."""

import numpy as np
import pytest

import solve
from solve.period.named import Named
from solve.studies.design_points import Design
from solve.studies.tracked import Function, tracked
from tests.solve.studies.driven_oscillator import loaded, response


@pytest.fixture(scope="module")
def model():
    return loaded()


def test_derivatives_of_extrema_match_the_closed_form(model):
    low, high, speed = np.array([5.0, -0.5]), np.array([17.0, 0.5]), 1.1
    design = Design(model, ["k", "p2"], low, high, [speed], "auto", 1e-10, True)
    x = np.array([0.4, 0.7])
    extrema = tracked(design, x, 0, Named.parse(model, "q.max_abs"))
    k, p2 = low + x * (high - low)
    first, third = response(speed, k=k), response(3 * speed, k=k)
    phase = np.linspace(0, 2 * np.pi, 200_001)
    curve = np.real(first * np.exp(1j * phase) + p2 * third * np.exp(3j * phase))
    top = phase[curve.argmax()]
    waves = first * np.exp(1j * top), p2 * third * np.exp(3j * top)
    top += np.imag(waves[0] + 3 * waves[1]) / -np.real(waves[0] + 9 * waves[1])
    top = top + np.array([0.0, np.pi])
    by_k = -np.real(first**2 * np.exp(1j * top) + p2 * third**2 * np.exp(3j * top))
    by_p2 = np.real(third * np.exp(3j * top))
    closed = np.array([1.0, -1.0])[:, None] * np.stack((by_k, by_p2), axis=1) * (high - low)
    np.testing.assert_allclose(extrema.slopes(x), closed, rtol=1e-6, atol=1e-6 * np.abs(closed).max())
    np.testing.assert_allclose(extrema.values(x), curve.max(), rtol=1e-9)


def differences(function, x, size=1e-3):
    """Return derivatives (k, r) of values (k,) by differences of fourth order."""
    columns = []
    for step in size * np.eye(len(x)):
        near, far = (function(x + each * step) - function(x - each * step) for each in (1, 2))
        columns.append((8 * near - far) / (12 * size))
    return np.stack(columns, axis=1)


FIGURES = ("max", "min", "max_abs", "rms", "harmonic1", "harmonic3", "phase3")


@pytest.mark.parametrize(
    ("name", "free", "speed", "quantities"),
    [
        (
            "cam",
            {"k1": (7e4, 9e4), "a3": (0.05, 0.06)},
            62.8,
            [f"{each}.{figure}" for each in ("q3", "shaft_torque") for figure in FIGURES]
            + ["lift.max_abs", "shaft_torque.mean", "rho1.re", "exponent1.im"],
        ),
        (
            "mathieu",
            {"delta": (0.9, 1.1), "zeta": (0.005, 0.02)},
            1.0,
            ["spectral_radius", "rho1.abs", "exponent1.re"],
        ),
    ],
)
def test_gradients_of_all_objectives_match_differences(name, free, speed, quantities):
    system = solve.load(name) if name == "cam" else solve.load(name, delta=1.0, epsilon=0.5, zeta=0.01)
    low, high = np.array(list(free.values())).T
    design = Design(system, list(free), low, high, [speed], "auto", 1e-12, name == "cam")
    x = np.array([0.45, 0.55])
    every = {text: tracked(design, x, 0, Named.parse(system, text)) for text in quantities}
    sizes = [len(each.values(x)) for each in every.values()]

    numeric = differences(lambda at: np.concatenate([each.values(at) for each in every.values()]), x)
    for each, expected in zip(every.values(), np.split(numeric, np.cumsum(sizes)[:-1]), strict=True):
        found = each.slopes(x)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("at", [0.0, 0.4, 1.0])
def test_gradient_of_a_function_equals_that_of_its_quantity(model, at):
    design = Design(model, ["k"], np.array([5.0]), np.array([17.0]), [1.5, 2.0], "auto", 1e-8, True)
    x, rms = np.array([at]), Named.parse(model, "q.rms")
    given = Function(design, lambda orbits: sum(orbit.statistics("q").rms for orbit in orbits))
    exact = sum(design.slopes(point.slopes(rms)) for point in design.points(x))
    np.testing.assert_allclose(given.slopes(x)[0], exact, rtol=1e-6)
