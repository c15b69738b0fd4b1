"""One modal matrix for all positions (thesis 6.3): whole it changes nothing; without what couples the modes
it fails, for the four-bar's eigenvectors turn with its links."""

import numpy as np
import pytest
from scipy.linalg import eigh

import solve
from solve.equations import output_values

SPEED = 35.0
PHASE = np.arange(180) * (2 * np.pi / 180)
OUTPUTS = ("follower_midpoint_deflection", "coupler_midpoint_deflection")


@pytest.fixture(scope="module")
def model():
    return solve.load("four_bar")


def modal_matrix(model, position):
    M, _, K, _ = model.at(np.array([position]), SPEED)
    return eigh(K[0], M[0])[1]


def errors(model, Phi, coupled):
    """Of both deflections over the turn, beside their largest, where q = Φ η with one Φ."""

    def matrices(phase, speed):
        M, C, K, d = model.at(phase, speed)
        parts = [Phi.T @ part @ Phi for part in (M, C, K)]
        return *(part if coupled else part * np.eye(model.n) for part in parts), d @ Phi

    names = [f"eta{k}" for k in range(model.n)]
    modal = solve.periodic(solve.PeriodicSystem(matrices, names), SPEED, rtol=1e-7)
    whole = solve.periodic(model, SPEED, rtol=1e-7)
    still = np.zeros((model.n, len(PHASE)))
    computed, truth = (
        output_values(model, PHASE, SPEED, q, still, still) for q in (Phi @ modal.at(PHASE), whole.at(PHASE))
    )
    return [np.abs(computed[name] - truth[name]).max() / np.abs(truth[name]).max() for name in OUTPUTS]


@pytest.mark.parametrize("position", [0.0, 2.0, 4.0])
def test_without_the_coupling_both_deflections_are_lost(model, position):
    Phi = modal_matrix(model, position)
    assert max(errors(model, Phi, coupled=True)) < 1e-5
    assert min(errors(model, Phi, coupled=False)) > 0.9


def test_off_diagonal_entries_are_as_large_as_diagonal_ones(model):
    """Beside the geometric mean of their diagonal entries, among the four lowest modes."""
    _, _, K, _ = model.at(PHASE, SPEED)
    for position in (0.0, 2.0, 4.0):
        Phi = modal_matrix(model, position)
        turned = Phi.T @ K @ Phi
        size = np.sqrt(np.einsum("kii->ki", turned))
        shares = np.abs(turned) / (size[:, :, None] * size[:, None])
        assert (shares - np.eye(model.n))[:, :4, :4].max() > 0.9
