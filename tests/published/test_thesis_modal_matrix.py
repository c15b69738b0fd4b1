"""One modal matrix for all positions (thesis 6.3). The complete matrix changes nothing. Without the coupling
between modes, it fails, because the eigenvectors of the four-bar change with its position."""

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
    """Return the errors of both deflections over a period, relative to their largest values, for q = Φ η with
    constant Φ."""

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
def test_deflections_are_inaccurate_without_modal_coupling(model, position):
    Phi = modal_matrix(model, position)
    assert max(errors(model, Phi, coupled=True)) < 1e-5
    assert min(errors(model, Phi, coupled=False)) > 0.9


def test_off_diagonal_entries_are_as_large_as_diagonal_ones(model):
    """For the four lowest modes, they are compared with the geometric mean of the corresponding diagonal
    entries."""
    _, _, K, _ = model.at(PHASE, SPEED)
    for position in (0.0, 2.0, 4.0):
        Phi = modal_matrix(model, position)
        turned = Phi.T @ K @ Phi
        size = np.sqrt(np.einsum("kii->ki", turned))
        shares = np.abs(turned) / (size[:, :, None] * size[:, None])
        assert (shares - np.eye(model.n))[:, :4, :4].max() > 0.9
