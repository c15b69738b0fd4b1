"""Contributions of the modes (Fig. 6.4 of the thesis): sum, continuity, and statements of the thesis."""

import numpy as np
import pytest

import solve
from solve.beams.observations import tracked_modes
from solve.equations import output_values
from solve.errors import UnknownNameError, ValueOutOfBoundsError

SPEED = 35.0


@pytest.fixture(scope="module")
def orbit():
    return solve.periodic(solve.load("four_bar", options={"elements": 2}), SPEED, rtol=1e-6)


@pytest.mark.parametrize("output", ["coupler_midpoint_deflection", "crank_root_stress_minus"])
def test_contributions_of_all_modes_sum_to_the_output(orbit, output):
    computed = orbit.system.modal_contributions(orbit, output, count=orbit.system.n, samples=90)
    truth = output_values(orbit.system, computed.phase, SPEED, *orbit.state(computed.phase))[output]
    np.testing.assert_allclose(computed.values.sum(axis=0), truth, atol=1e-8 * np.abs(truth).max())
    np.testing.assert_allclose(computed.total, truth, atol=1e-12 * np.abs(truth).max())


def test_dominant_modes_of_follower_and_coupler(orbit):
    size = {
        link: np.abs(computed.values).max(axis=1) / np.abs(computed.total).max()
        for link in ("follower", "coupler")
        for computed in [orbit.system.modal_contributions(orbit, f"{link}_midpoint_deflection")]
    }
    assert size["follower"][0] > 0.95
    assert size["follower"][1:].max() < 0.1
    assert size["coupler"][0] < 0.3
    assert size["coupler"][1:3].min() > 0.5


def test_modes_are_followed_through_a_crossing_with_their_signs():
    """Two uncoupled oscillators in rotating axes, with frequencies that cross: the first mode remains the
    first."""
    phase = np.linspace(0.0, 3.0, 62)
    turned = np.array([[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in phase])
    stiffness = np.stack([1.0 + phase, np.full(62, 2.5)], axis=1)
    K = np.einsum("kij,kj,klj->kil", turned, stiffness, turned)
    computed = tracked_modes(np.broadcast_to(np.eye(2), K.shape), K, 2)
    np.testing.assert_allclose(computed.frequencies[:, 0] ** 2, 1.0 + phase, rtol=1e-12)
    along = np.einsum("ki,ki->k", computed.vectors[:, :, 0], turned[:, :, 0])
    np.testing.assert_allclose(along, along[0], rtol=1e-9)


def test_modal_contributions_refuse_unsupported_quantities(orbit):
    with pytest.raises(UnknownNameError, match="deflection or stress"):
        orbit.system.modal_contributions(orbit, "strain_energy")
    with pytest.raises(ValueOutOfBoundsError, match="allowed: 1 to 18"):
        orbit.system.modal_contributions(orbit, "crank_tip_deflection", count=19)
