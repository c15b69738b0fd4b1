"""Linearisation error compared with the true difference between the linear and the nonlinear orbit."""

import math

import numpy as np
import pytest

import solve
from solve.errors import LinearModelError, ValueOutOfBoundsError
from tests.solve.newton.mechanisms import duffing, model_of

PHASE = np.linspace(0.0, 2 * np.pi, 1000)
SPEEDS = {
    ("cam", "1"): np.linspace(50, 300, 10),
    ("cam", "2"): np.linspace(50, 300, 10),
    ("manipulator", None): np.linspace(20, 110, 10),
    ("gear_pair", None): np.linspace(100, 3000, 10),
    ("coupler", None): np.linspace(300, 1200, 10),
}


def check(model, speed):
    """The estimate is within a factor of 2 of the true difference if this is below 20 % and above
    round-off."""
    linear, nonlinear = solve.periodic(model, speed), solve.nonlinear(model, speed)
    q = nonlinear.at(PHASE)
    truth = np.abs(q - linear.at(PHASE)).max(axis=1) / np.abs(q).max(axis=1)
    compared = 0
    for error, true in zip(linear.linearisation_error.values(), truth, strict=True):
        if true < 0.2:
            assert error <= max(2 * true, 1e-6)
            assert error >= true / 2 or true < 1e-6
            compared += 1
    return compared


def test_cam_linearisation_error_where_it_becomes_noticeable():
    assert check(solve.load("cam"), "140 rpm") == 3


@pytest.mark.slow
@pytest.mark.parametrize(("name", "case"), SPEEDS)
def test_all_models_at_ten_speeds(name, case):
    model = solve.load(name, case=case)
    assert sum(check(model, rpm * np.pi / 30) for rpm in SPEEDS[name, case]) >= 5


def test_valid_range_ends_before_the_first_speed_above_tolerance():
    model = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.2, f=0.3)
    validity = solve.validity(model, [0.9, 0.1, 0.3, 0.2], at=0.05)
    np.testing.assert_array_equal(validity.speeds, [0.1, 0.2, 0.3, 0.9])
    errors = validity.errors[:, 0]
    # Slow: q + α q³ = f in the crest, against q = f.
    crest = np.roots([0.2, 0, 1.0, -0.3])
    crest = crest[np.isreal(crest)].real[0]
    assert errors[0] == pytest.approx((0.3 - crest) / crest, rel=0.1)
    assert (np.diff(errors) > 0).all()
    assert errors[2] < 0.05 < errors[3]
    assert validity.trusted_to == 0.3
    assert solve.validity(model, [0.1, 0.9], at=1e-6).trusted_to is None


def test_linear_systems_have_no_linearisation_error():
    assert solve.periodic(solve.load("four_bar"), 30.0, rtol=1e-4).linearisation_error is None
    with pytest.raises(LinearModelError, match="linear by construction"):
        solve.validity(solve.load("four_bar"), [30.0])


@pytest.mark.parametrize("at", [0, 5, math.nan])
def test_invalid_input_is_refused(at):
    with pytest.raises(ValueOutOfBoundsError, match=f"'at' is {at}"):
        solve.validity(model_of(duffing(), zeta=0.1, k=1.0, alpha=0.2, f=0.3), [0.1], at=at)
