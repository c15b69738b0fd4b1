"""Derivatives of small multipliers, whose errors limit those of the derivatives."""

import pytest

import solve


@pytest.mark.parametrize(("speed", "of", "by"), [(21.0, "rho3.abs", "c1"), (60.0, "rho6.abs", "c1")])
def test_reported_error_covers_the_multiplier_derivative(speed, of, by):
    cam = solve.load("cam")
    sensitivities = solve.sensitivities(cam, speed, of=[of], by=[by])
    finer = solve.sensitivities(
        cam, speed, of=[of], by=[by], method=sensitivities.method, steps=4 * sensitivities.steps
    )
    (slope,), (reported,), (truth,) = (
        sensitivities.found[of].derivatives,
        sensitivities.found[of].errors,
        finer.found[of].derivatives,
    )
    assert abs(slope - truth) <= 3 * reported
