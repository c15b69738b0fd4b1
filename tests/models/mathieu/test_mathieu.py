"""Model of Mathieu's equation: matrices, speed, cases and stability boundaries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

from solve import chart, floquet, load, periodic
from solve.errors import ValueOutOfBoundsError
from solve.methods.hill import boundaries

coefficients = st.floats(-5.0, 12.0)


@given(coefficients, coefficients, st.floats(0.0, 0.5), st.floats(0.2, 5.0))
@settings(max_examples=40, deadline=None)
def test_matrices_match_the_equation(delta, epsilon, zeta, speed):
    phase = np.linspace(0.0, np.pi, 17)
    M, C, K, d = load("mathieu", delta=delta, epsilon=epsilon, zeta=zeta).at(phase, speed)
    np.testing.assert_array_equal(M, np.ones((17, 1, 1)))
    np.testing.assert_allclose(C, np.full((17, 1, 1), 2 * zeta * np.sqrt(abs(delta))), rtol=1e-14)
    np.testing.assert_allclose(K[:, 0, 0], delta + epsilon * np.cos(2 * phase), rtol=0, atol=1e-13)
    assert not d.any()


@given(st.floats(0.3, 4.0), st.floats(-2.0, 2.0), st.floats(0.0, 0.2), st.floats(0.3, 3.0))
@settings(max_examples=20, deadline=None)
def test_another_speed_divides_coefficients_by_its_square(delta, epsilon, zeta, speed):
    given_ = load("mathieu", delta=delta, epsilon=epsilon, zeta=zeta)
    scaled = load("mathieu", delta=delta / speed**2, epsilon=epsilon / speed**2, zeta=zeta)
    ours, theirs = (floquet(s, v, rtol=1e-11).multipliers for s, v in ((given_, speed), (scaled, 1.0)))
    scale = np.abs(theirs).max()
    np.testing.assert_allclose(np.poly(ours), np.poly(theirs), rtol=0, atol=1e-9 * max(scale, scale**2))


@given(st.floats(0.3, 9.0), st.floats(-4.0, 4.0), st.floats(0.0, 0.2))
@settings(max_examples=20, deadline=None)
def test_product_of_the_multipliers_follows_from_the_damping(delta, epsilon, zeta):
    values = floquet(load("mathieu", delta=delta, epsilon=epsilon, zeta=zeta), 1.0, rtol=1e-11).multipliers
    assert np.prod(values).real == pytest.approx(
        np.exp(-2 * zeta * np.sqrt(delta) * np.pi), abs=1e-9 * np.abs(values).max() ** 2
    )


def test_cases_name_their_speed():
    for case in ("stable", "unstable"):
        model = load("mathieu", case)
        assert (model.labels.case, model.labels.case_speed) == (case, "1 rad/s")
    assert load("mathieu").labels.case == "stable"
    assert floquet(load("mathieu", "stable"), 1.0).verdict == "asymptotically stable"
    assert floquet(load("mathieu", "unstable"), 1.0).verdict == "unstable"


def test_unstable_case_has_a_multiplier_below_minus_one():
    """The response has period 2π and the matrices have period π."""
    values = floquet(load("mathieu", "unstable"), 1.0).multipliers
    assert values[0].real < -1
    assert np.abs(values.imag).max() == 0


def test_without_load_the_periodic_solution_is_rest():
    orbit = periodic(load("mathieu"), 1.0)
    assert not orbit.q.any()
    assert orbit.residual == 0.0


@pytest.mark.parametrize("epsilon", [1.0, -4.0, 10.0])
def test_boundaries_agree_with_characteristic_values_of_scipy(epsilon):
    q = abs(epsilon) / 2
    for multiplier, orders in ((1, (0, 2)), (-1, (1, 3))):
        truth = sorted(f(k, q) for k in orders for f in (mathieu_a, mathieu_b) if k or f is mathieu_a)
        computed = boundaries(
            lambda delta: (load("mathieu", delta=delta, epsilon=epsilon, zeta=0.0), 1.0),
            np.linspace(-8.0, 14.0, 45),
            multiplier,
        )
        assert [each.value for each in computed[: len(truth)]] == pytest.approx(truth, abs=1e-8)


def test_mathieu_has_no_torque_and_states_why():
    model = load("mathieu")
    assert model.outputs == ()
    assert "no torque" in model.module.NO_DRIVE_TORQUE


def test_negative_damping_is_refused():
    with pytest.raises(ValueOutOfBoundsError, match="zeta"):
        load("mathieu", zeta=-0.1)


def test_real_parts_of_both_multipliers_over_the_plane():
    """Figs. E.1 and E.2 of the thesis. For ε = 0, both real parts are cos π√δ. The sum of the multipliers is
    the trace of the monodromy matrix, integrated by SciPy; outside the stable region, the product of the two
    real multipliers is 1."""
    plane = {"delta": [0.5, 1.0, 4.4]}, {"epsilon": [0.0, 6.0]}
    one, two = (chart(load("mathieu", zeta=0.0), *plane, 1.0, of=f"rho{k}.re").values for k in (1, 2))
    for values in (one, two):
        np.testing.assert_allclose(values[0], np.cos(np.pi * np.sqrt(plane[0]["delta"])), atol=1e-7)
    for column, delta in enumerate(plane[0]["delta"]):

        def flow(phase, y, delta=delta):
            return [y[1], -(delta + 6.0 * np.cos(2 * phase)) * y[0]]

        ends = [solve_ivp(flow, (0, np.pi), start, rtol=1e-11, atol=1e-12).y[:, -1] for start in np.eye(2)]
        assert one[1, column] + two[1, column] == pytest.approx(np.trace(ends), abs=1e-7)
        if abs(np.trace(ends)) > 2:
            assert one[1, column] * two[1, column] == pytest.approx(1.0, rel=1e-7)
