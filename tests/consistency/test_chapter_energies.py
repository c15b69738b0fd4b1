"""Nonlinear residual and drive torque, compared with Lagrange's equations by automatic differentiation."""

import energies
import numpy as np
import pytest
from chapter import GENERATED, built, magnitudes, parameter_sets, scaled_difference, vector
from hypothesis import given, settings
from hypothesis import strategies as st

TOLERANCE = 1e-12


def random_states(n: int, seed: int) -> list[np.ndarray]:
    """Strategy for a phase and for q, q̇, q̈ of n coordinates that are so large that all nonlinear terms
    matter."""
    generator = np.random.default_rng(seed)
    return [generator.uniform(0, 2 * np.pi, (1, 64)), *generator.uniform(-2, 2, (3, n, 64))]


@pytest.mark.parametrize("name", ["cam", "manipulator"])
@settings(max_examples=20, deadline=None)
@given(data=st.data(), speed=magnitudes(), acceleration=magnitudes(), seed=st.integers(0, 2**32 - 1))
def test_residual_and_drive_torque_follow_from_the_energies(name, data, speed, acceleration, seed):
    module = GENERATED[name]
    names, n = tuple(each for each, *_ in module.PARAMETERS), len(module.COORDINATES)
    phase, *state = random_states(n, seed)
    state = *state, vector(name, data.draw(parameter_sets(module)))
    for suffix, drive in (("", (phase, speed)), ("_varying", (phase, speed, acceleration))):
        given = *drive, *([0.0] if not suffix else []), *state
        residual, torque = energies.driven(getattr(energies, name), names, n)(*given)
        computed, outputs = (built(name, each + suffix)(*drive, *state) for each in ("residual", "outputs"))
        assert scaled_difference(computed.full().T, residual.full().T) < TOLERANCE
        in_motion = (torque - residual[0, :]).full()  # the row of q1 vanishes on every motion
        assert np.abs(outputs[0].full() - in_motion).max() < TOLERANCE * np.abs(torque.full()).max()


@pytest.mark.parametrize("load", ["tracking", "constant"])
@settings(max_examples=20, deadline=None)
@given(data=st.data(), speed=magnitudes(), seed=st.integers(0, 2**32 - 1))
def test_gear_pair_follows_from_the_two_gears(load, data, speed, seed):
    module = GENERATED["gear_pair"]
    phase, *state = random_states(1, seed)
    inputs = (phase, speed, *state, vector("gear_pair", data.draw(parameter_sets(module))))
    reference = energies.gear_pair(tuple(each for each, *_ in module.PARAMETERS), load)(*inputs)
    derived = built("gear_pair", "residual", load=load)(*inputs)
    assert scaled_difference(derived.full().T, reference.full().T) < TOLERANCE
