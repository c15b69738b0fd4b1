"""Heavily overdamped modes with slow modes, in rotating axes. Each overdamped mode has a fast and a slow
rate, which differ by a factor of 1.4e5 at a damping ratio of 300."""

import numpy as np
import pytest

from solve import MixedSystem, periodic
from tests.solve.certificates.transformed import Modes, View, transformed
from tests.solve.certificates.trials import contradicted, matched_error
from tests.solve.certificates.truth import PHASES
from tests.solve.references import relative_error

GROWTH = {"damped": 1.0, "growing": -1.0, "undamped": 0.0}


def overdamped(zeta, case, seed):
    """Return a system with a mode of this damping ratio and one or two slow modes, the last of the given
    case, and its solution in closed form."""
    rng = np.random.default_rng((300, seed))
    n = 2 + seed % 2
    omega = 10 ** rng.uniform(-0.7, 0.8, n)
    damping = 2 * omega * 10 ** rng.uniform(-3.0, -0.5, n)
    omega[0] = 10 ** rng.uniform(-0.7, 2.0)
    damping[0], damping[-1] = 2 * zeta * omega[0], GROWTH[case] * damping[-1]
    load = rng.standard_normal((3, n)) + 1j * rng.standard_normal((3, n))
    modes = Modes(np.diag(damping), np.diag(omega**2), np.arange(3), load)
    system, truth = transformed(modes, View.random(rng, n, depth=rng.uniform(0.05, 0.5)))
    return system, truth()


def with_states(system):
    """Return the same system with the first coordinate and its velocity as states after the other
    coordinates."""
    n = system.n

    def matrices(phase, speed):
        second, first, zeroth, load = system.at(phase, speed)
        M, C, K = np.zeros((3, len(phase), n + 1, n + 1))
        M[:, :n, : n - 1], C[:, :n, : n - 1], K[:, :n, : n - 1] = (
            part[:, :, 1:] for part in (second, first, zeroth)
        )
        C[:, :n, n], K[:, :n, n], K[:, :n, n - 1] = second[:, :, 0], first[:, :, 0], zeroth[:, :, 0]
        C[:, n, n - 1], K[:, n, n] = 1.0, -1.0
        return M, C, K, np.concatenate((load, 0 * load[:, :1]), axis=1)

    return MixedSystem(matrices, list(system.coordinates[1:]), [system.coordinates[0], "v"])


@pytest.mark.parametrize("case", GROWTH)
@pytest.mark.parametrize("zeta", [30.0, 300.0, 3000.0])
@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
def test_verdicts_and_errors_of_overdamped_modes_are_right(zeta, case, rtol):
    for seed in range(2):
        system, truth = overdamped(zeta, case, seed)
        orbit, mixed = periodic(system, 1.3, rtol=rtol), periodic(with_states(system), 1.3, rtol=rtol)
        n = system.n
        shown = orbit.at(PHASES), mixed.at(PHASES)[[n - 1, *range(n - 1)]]
        for found, q in zip((orbit, mixed), shown, strict=True):
            assert found.verdict != "undetermined"
            assert not contradicted(found.verdict, truth)
            estimate = found.error_estimate
            assert relative_error(q, truth.q) <= 10 * estimate.orbit + 1e-12
            assert matched_error(found.multipliers, truth.multipliers) <= 10 * estimate.multipliers + 1e-12
