"""Derivatives with respect to parameters that move jumps: closed forms, and differences on one grid."""

import math

import numpy as np
import pytest

import solve
from derive import Mechanism, rate, sign, sin
from solve.errors import NoDerivativeError
from tests.derive.modules import module_of
from tests.solve.derivatives.differences import differences
from tests.solve.newton.mechanisms import model_of

NUMBERS = {"k": 7.0, "c": 0.5, "f": 1.0, "begin": 1.0, "second": 0.0, "other": 3.5}
ON_A_GRID = {"method": solve.Radau(), "steps": 96, "engine": "numpy"}


def pushed(**changed):
    """Return an oscillator with a push that starts at `begin` and lasts half a period, and a second push that
    starts at `other`."""
    made = Mechanism("pushed", "An oscillator under a push", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    k, c, f, begin, second, other = made.parameters(
        k=("1/s^2", "stiffness"),
        c=("1/s", "damping"),
        f=("1/s^2", "push"),
        begin=("rad", "beginning of the push"),
        second=("1/s^2", "the other push"),
        other=("rad", "beginning of the other"),
    )
    push = f * (1 + sign(sin(made.phase - begin)))
    made.kinetic, made.potential, made.dissipation = rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(push + second * (1 + sign(sin(made.phase - other))), along=q)
    made.output("spring", k * q, "1/s^2", "force of the spring")
    made.output("push", push, "1/s^2", "the first push")
    made.decline_drive_torque("an equation without units")
    return model_of(module_of(made), **{**NUMBERS, **changed})


def wedged(**changed):
    """Return an oscillator under f sin φ, with an output that has corners where sin(φ - begin) changes
    sign."""
    made = Mechanism("wedged", "An oscillator beside a wedge", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    k, c, f, begin = made.parameters(
        k=("1/s^2", "stiffness"),
        c=("1/s", "damping"),
        f=("1/s^2", "load"),
        begin=("rad", "place of the corner"),
    )
    side = sin(made.phase - begin)
    made.kinetic, made.potential, made.dissipation = rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(f * sin(made.phase), along=q)
    made.output("wedge", k * q + 3 * f * side * sign(side), "1/s^2", "what has corners")
    made.output("late", k * q + f * (1 + sign(side)) * (2 - side), "1/s^2", "largest behind a jump")
    made.output("early", k * q + f * (1 - sign(side)) * (2 + side), "1/s^2", "largest before a jump")
    made.decline_drive_torque("an equation without units")
    return model_of(module_of(made), **{"k": 7.0, "c": 0.5, "f": 1.0, **changed})


@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("begin", [1.0, 3.5])
def test_extremum_at_a_kink_moves_with_the_kink(begin, nonlinear):
    sensitivities = solve.sensitivities(
        wedged(begin=begin), 2.0, "wedge.min", ["begin", "k"], nonlinear=nonlinear
    )
    answer = 1 / (7.0 - 2.0**2 + 2j * 0.5)
    # Of both corners the one where k q is below 0; between them the wedge is higher.
    wave = np.exp(1j * begin) * (-1 if (np.exp(1j * begin) * answer).imag > 0 else 1)
    expected = (7.0 * 1j * wave * answer).imag, (wave * (answer - 7.0 * answer**2)).imag
    assert sensitivities.found["wedge.min"].value == pytest.approx((7.0 * wave * answer).imag, rel=1e-8)
    for name, value in zip(("begin", "k"), expected, strict=True):
        assert sensitivities["wedge.min"][name] == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize("name", ["late", "early"])
def test_extremum_at_a_jump_uses_the_one_sided_limit(name):
    computed = solve.sensitivities(wedged(begin=1.0), 2.0, f"{name}.max", ["f", "k"])[f"{name}.max"]
    answer, wave = 1 / (7.0 - 2.0**2 + 2j * 0.5), np.exp(1j)
    assert computed["f"] == pytest.approx((7.0 * wave * answer).imag + 4, rel=1e-9)
    assert computed["k"] == pytest.approx((wave * (answer - 7.0 * answer**2)).imag, rel=1e-8)


@pytest.mark.parametrize("nonlinear", [False, True])
def test_later_push_only_shifts_the_vibration_in_phase(nonlinear):
    of = ["q.rms", "q.max", "spring.harmonic1", "spring.phase1", "q.phase3", "rho1.abs", "exponent1.im"]
    sensitivities = solve.sensitivities(pushed(), 2.0, of, "begin", steps=192, nonlinear=nonlinear)
    for quantity in of:
        expected = -float(quantity[-1]) if "phase" in quantity else 0.0
        (error,) = sensitivities.found[quantity].errors
        assert sensitivities[quantity]["begin"] == pytest.approx(
            expected, abs=min(1e-5, 2 * error + 1e-11)
        ), quantity


@pytest.mark.parametrize("method", [solve.Radau(), solve.Gauss()])
def test_derivatives_for_two_pushes_match_finite_differences(method):
    of, by, model = (
        ["q.max", "q.min", "q.harmonic1", "spring.max"],
        ["begin", "other", "k"],
        pushed(second=0.6),
    )
    settings = {**ON_A_GRID, "method": method}
    sensitivities = solve.sensitivities(model, 2.0, of, by, **settings)
    for name in by:
        expected = differences(model, 2.0, name, of, **settings)
        # Sums over samples of q leave a little where q″ jumps between them.
        assert [sensitivities[each][name] for each in of] == pytest.approx(list(expected), rel=1e-6)
        assert [sensitivities[each][name] for each in of if "harmonic" not in each] == pytest.approx(
            [value for each, value in zip(of, expected, strict=True) if "harmonic" not in each], rel=1e-8
        )


def test_derivative_by_meissners_interval_matches_the_closed_form():
    model = solve.load("meissner", share=0.3)
    omega, share, (w1, w2) = math.pi, 0.3, (model.parameters["w1"], model.parameters["w2"])
    turn, mean = 2 * math.pi / omega, (w1 / w2 + w2 / w1) / 2
    (s1, c1), (s2, c2) = (
        (math.sin(w * turn * t), math.cos(w * turn * t)) for w, t in ((w1, share), (w2, 1 - share))
    )
    slope = turn * (-w1 * s1 * c2 + w2 * c1 * s2 - mean * (w1 * c1 * s2 - w2 * s1 * c2))
    sensitivities = solve.sensitivities(model, omega, ["rho1.re", "rho1.abs"], "share")
    assert sensitivities.found["rho1.re"].value == pytest.approx(c1 * c2 - mean * s1 * s2, rel=1e-8)
    assert sensitivities["rho1.re"]["share"] == pytest.approx(slope, rel=1e-8)
    assert sensitivities["rho1.abs"]["share"] == pytest.approx(0.0, abs=1e-9)


def test_derivative_of_a_jumping_output_is_nan_with_a_warning():
    sensitivities = solve.sensitivities(pushed(), 2.0, ["push.mean", "spring.mean"], ["f", "begin"])
    assert np.isnan(sensitivities["push.mean"]["begin"])
    assert sensitivities["push.mean"]["f"] == pytest.approx(1.0)
    assert "jumps at phases that depend on these parameters" in sensitivities.warnings[0]
    assert sensitivities["spring.mean"]["f"] == pytest.approx(1.0)


def test_coinciding_jumps_are_refused_and_omitted():
    model = pushed(second=1.0, other=1.0)
    assert model.derivatives.names == ("k", "c", "f", "second")
    assert list(solve.sensitivities(model, 2.0, "q.rms").by) == ["k", "c", "f", "second", "speed"]
    with pytest.raises(NoDerivativeError, match="moves a jump that coincides with another"):
        solve.sensitivities(model, 2.0, "q.rms", "begin")


@pytest.mark.parametrize("numbers", [{"begin": 0.3}, {"begin": 1.0}, {"begin": 0.3, "other": 5.0}])
def test_statistics_of_samples_at_unequal_distances_are_homogeneous_in_the_loads(numbers):
    """The response is proportional to the two pushes, so that f ∂J/∂f + second ∂J/∂second = J (Euler). Maxima
    lie farther from the nearest sample than the mean distance of samples. With 20 steps and these numbers,
    the third grid has fewer steps."""
    model = pushed(k=12.0, second=0.7, **numbers)
    of, by = ["q.max", "q.rms", "q.harmonic1"], ["f", "second"]
    found = solve.sensitivities(model, 1.7, of=of, by=by, method=solve.Gauss(), steps=20).found
    for sensitivity in found.values():
        value = sensitivity.derivatives @ np.array([1.0, 0.7])
        assert value == pytest.approx(sensitivity.value, rel=1e-9)
