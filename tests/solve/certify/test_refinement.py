"""Numbers of steps in the grid sequence, and the end of the refinement."""

import numpy as np
import pytest

from solve import Gauss, periodic
from solve.certify.resolution import grid_sizes
from tests.solve.certificates.test_narrow import kinked


def test_grid_sequence_contains_few_numbers_of_steps():
    every = np.arange(1, 1025)
    sizes = grid_sizes(every)
    assert (sizes >= every).all()
    assert np.unique(sizes).tolist() == [
        *(8, 12, 16, 24, 32, 48, 64, 96, 128, 192),
        *(224, 256, 320, 384, 448, 512, 640, 768, 896, 1024),
    ]
    np.testing.assert_array_equal(grid_sizes(sizes), sizes)


@pytest.mark.parametrize("at", [0.35, 1.1, 2.2, 4.6])
def test_irregular_convergence_leads_to_refinement(at):
    """The load has a kink. The error on one grid may be small by chance."""
    given, truth = kinked(at)
    computed, phase = periodic(given, 1.0, Gauss(), rtol=1e-8), np.linspace(0, 2 * np.pi, 801)
    q = truth(phase)
    assert computed.error_estimate.orbit <= 1e-8
    assert np.abs(computed.at(phase)[0] - q).max() <= 1e-8 * np.abs(q).max()
