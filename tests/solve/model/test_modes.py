"""Modes of matrix pencils with widely separated frequencies, compared with 60-digit solutions."""

import mpmath
import numpy as np
import pytest

import solve
from solve.beams.structure import StructureModel
from solve.model.modes import modal_damping, modes


def graded(n, decades, seed):
    """Return K = D A D (n, n), where D covers half of the decades. All eigenvalues are determined to full
    accuracy."""
    rng = np.random.default_rng(seed)
    A = np.eye(n) + 0.2 * rng.uniform(-1, 1, (n, n)) / n
    D = np.logspace(0, decades / 2, n)
    return D[:, None] * (A + A.T) / 2 * D


@pytest.mark.parametrize("decades", [4, 10, 13])
def test_lowest_and_highest_frequencies_have_full_accuracy(decades):
    K = graded(7, decades, decades)
    with mpmath.workdps(60):
        truth = np.array([float(mpmath.sqrt(value)) for value in mpmath.eigsy(mpmath.matrix(K))[0]])
    computed = modes(np.eye(7)[None], K[None])
    np.testing.assert_allclose(computed.frequencies[0], np.sort(truth), rtol=1e-13)
    shapes = computed.vectors[0]
    np.testing.assert_allclose(shapes.T @ shapes, np.eye(7), rtol=0, atol=1e-12)


def test_damping_with_equal_ratios_is_the_geometric_mean():
    """C M⁻¹ C = (2ζ)² K."""
    M, K = np.diag([1.0, 2.0, 3.0, 0.5]), graded(4, 8, 1)
    C = modal_damping(M[None], K[None], 0.01)[0]
    scale = np.sqrt(np.outer(np.diag(K), np.diag(K)))
    np.testing.assert_allclose(C @ np.linalg.solve(M, C) / (4e-4 * scale), K / scale, rtol=0, atol=1e-11)


def test_damping_of_many_elements_is_smooth():
    """For 72 coordinates, the damping between samples is accurate to a relative 1e-10. With inverse pencils,
    the error would be 1e-9."""
    system = solve.load("four_bar", options={"elements": 8})
    assert isinstance(system, StructureModel)
    motion = system.motion
    phase = np.array([0.3, 1.7, 4.4])
    truth = motion.damping_at(phase)
    assert np.abs(motion._damping(phase) - truth).max() < 1e-10 * np.abs(truth).max()
