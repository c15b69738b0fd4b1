"""Natural frequencies of the four-bar of thesis Table 4.1: means over 36 positions, and claims in the
text."""

import numpy as np
import pytest
from scipy.optimize import brentq

import solve
from solve.studies.frequencies import turn

PRINTED = {
    "dynamic stiffness": ({"element": "dynamic"}, "166.535 353.486 529.454 682.538"),
    "1 element": ({"elements": 1}, "184.085 363.082 577.383 867.215"),
    "3 elements": ({"elements": 3}, "166.666 353.610 529.910 690.328"),
    "curvature element": ({"element": "curvature"}, "166.646 353.603 530.004 688.336"),
}
"""Computed from the table's data with the branch open, the crank clamped, 0.174 kg at A and at B; rad/s."""


def mean(**options):
    model = solve.load("four_bar", options=options)
    return solve.frequencies(model, turn(model), 4).mean


@pytest.mark.parametrize("name", PRINTED)
def test_mean_frequencies_match_the_printed_values(name):
    options, text = PRINTED[name]
    np.testing.assert_allclose(mean(**options), np.array(text.split(), dtype=float), rtol=1e-5)


def test_one_element_has_errors_of_10_and_26_percent():
    """Thesis 4.3. Relative to three elements, the mean difference is 10 % for the first and 26 % for the
    fourth frequency."""
    one, three = mean(elements=1), mean(elements=3)
    assert 100 * (one[0] / three[0] - 1) == pytest.approx(10.45, abs=0.05)
    assert 100 * (one[3] / three[3] - 1) == pytest.approx(25.62, abs=0.05)


def test_three_elements_have_errors_up_to_1_18_percent():
    """Thesis 5.4.2. The largest relative error over modes and positions is 1.18 %."""
    model, exact = (solve.load("four_bar", options=o) for o in ({"elements": 3}, {"element": "dynamic"}))
    errors = [solve.frequencies(each, turn(each), 4).values for each in (model, exact)]
    assert 100 * (errors[0] / errors[1] - 1).max() == pytest.approx(1.182, abs=0.005)


def test_curvature_element_is_not_always_more_accurate():
    """Thesis 4.3. For equal numbers of elements, the internal-node element is more accurate in all four
    modes."""
    exact, curvature, internal = mean(element="dynamic"), mean(element="curvature"), mean(element="internal")
    assert (abs(internal - exact) < abs(curvature - exact)).all()


@pytest.mark.parametrize(("elements", "freedoms"), [(1, 9), (2, 18), (3, 27), (4, 36)])
def test_numbers_of_degrees_of_freedom_match_the_thesis(elements, freedoms):
    model = solve.load("four_bar", options={"elements": elements})
    assert solve.frequencies(model).freedoms == freedoms


def test_curvature_element_has_ten_degrees_of_freedom():
    assert solve.frequencies(solve.load("four_bar", options={"element": "curvature"})).freedoms == 10


def test_pinned_coupler_and_follower_frequencies_coincide_at_0_547_m():
    """Thesis 9.2. With a shorter coupler, the first frequency is that of the follower; with a longer one,
    that of the coupler."""

    def difference(L2):
        alone = solve.load("four_bar", L2=L2).pinned_frequencies()
        return alone["coupler"] - alone["follower"]

    assert brentq(difference, 0.4, 0.7) == pytest.approx(0.547, abs=5e-4)


def test_first_frequency_follows_the_most_flexible_link():
    model = solve.load("four_bar", options={"element": "dynamic"})
    variation = solve.frequencies_over(model, "L2", [0.3, 0.45, 0.65, 0.8], turn(model), 1)
    lowest = np.minimum(variation.pinned["coupler"], variation.pinned["follower"])
    np.testing.assert_allclose(variation.mean[:, 0], lowest, rtol=0.02)
    assert (variation.mean[:, 0] < lowest).all()


def test_printed_second_moment_of_the_crank_contradicts_its_section():
    """The thesis uses 520.47e-12 m⁴. The section gives 529.17e-12 m⁴, a stiffer crank."""
    printed, section = (
        solve.frequencies(solve.load("four_bar", I1=I1), 0.0).values[0] for I1 in (520.47e-12, 529.1655e-12)
    )
    assert solve.load("four_bar").parameters["I1"] == 520.47e-12
    assert (section >= printed).all()
    assert 1e-3 < (section / printed - 1).max() < 1e-2
