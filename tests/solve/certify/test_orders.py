"""Harmonics of matrices in parts of bounded memory."""

import numpy as np
import pytest

from solve.certify import orders
from tests.solve.systems import random_system


@pytest.mark.parametrize("memory", [1, 2**14, 2**25])
def test_harmonics_in_parts_are_those_of_scaled_matrices(memory, monkeypatch):
    """Beyond the third, of matrices in units in which the inertias are about 1."""
    count, n = 101, 3
    system = random_system(2, n)
    phase = np.arange(count) * (system.period / count)
    M, C, K, d = (part[None] for part in system.in_phase(phase, 1.0))
    unit = 1 / np.sqrt(np.abs(np.einsum("pkii->pki", M)).mean(axis=1, keepdims=True))
    scaled = [unit[..., None] * part * unit[..., None, :] for part in (M, C, K)] + [unit * d]
    sizes = [np.abs(np.fft.rfft(part, axis=1, norm="forward")) for part in scaled]
    truth = [size[:, 4:].sum(axis=1).max() / size.max() for size in sizes]

    def of(samples):
        return orders._largest_and_sums(orders._orders(samples, np.array([], dtype=int)), [3])

    monkeypatch.setattr(orders, "_MEMORY", memory)
    entries = np.concatenate([part.reshape(1, count, -1) for part in (M, C, K, d)], axis=-1)
    largest, rest = (orders.parted(each, n) for each in orders._by_columns(entries, of))
    found = orders._parts(M, largest, rest)[0]
    np.testing.assert_allclose(found, [max(truth), max(truth[:-1])], rtol=1e-9, atol=1e-15)
