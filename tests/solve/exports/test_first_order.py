"""Named inputs and outputs of first-order systems: orbits, state spaces and harmonic transfer functions."""

import numpy as np
import pytest

import solve
from solve import FirstOrderSystem
from solve.equations import output_values
from tests.solve.first_order_systems import names, restated, rotated, with_load


@pytest.fixture
def filtered():
    """Return a system with two states, an input, an output and a load."""
    A, _ = rotated(np.random.default_rng(9), 2)

    def matrices(phase, speed):
        B, C = np.ones((len(phase), 2, 1)), np.zeros((len(phase), 1, 2))
        C[:, 0, 0] = np.cos(phase)
        return (*with_load(A)(phase, speed), B, C, np.full((len(phase), 1, 1), 0.5))

    return FirstOrderSystem(matrices, names("x", 2), inputs=["u"], outputs=["y"])


def test_outputs_follow_from_the_states(filtered):
    orbit = solve.periodic(filtered, 1.0)
    assert orbit.outputs["y"] == pytest.approx(np.cos(orbit.phase) * orbit.x[0], abs=1e-12)
    assert solve.sweep(filtered, [1.0]).figures("y") == pytest.approx(
        [orbit.statistics("y").max_abs], rel=1e-6
    )


def test_state_space_contains_the_matrices_of_the_system(filtered):
    space = solve.state_space(filtered, 1.0, samples=8)
    A, b, B, C, D = filtered.equations_at(space.phase, 1.0)
    for found, expected in ((space.A, A), (space.b, b), (space.B, B), (space.C, C), (space.D, D)):
        assert np.array_equal(found, expected)
    assert space.signals.inputs == ("u",)
    assert space.signals.outputs == ("y",)


def test_harmonic_transfer_function_gives_the_response(filtered):
    """An input at the frequency of the matrices is compared with the orbit of a system that has this input as
    a load."""
    transfer = solve.harmonic_transfer(filtered, 1.0, harmonics=3)
    u = np.zeros(7, dtype=complex)
    u[[2, 4]] = 0.5  # cos t
    y = np.einsum("iok,k->io", transfer.at(0.0).values[..., 0], u)[:, 0] + transfer.rest[:, 0]

    def loaded(phase, speed):
        A, b, B, C, D = filtered.equations_at(phase, speed)
        return A, b + B[..., 0] * np.cos(phase)[:, None], B, C, D

    system = FirstOrderSystem(loaded, filtered.states, inputs=["u"], outputs=["y"])
    orbit = solve.periodic(system, 1.0, rtol=1e-10)
    values = output_values(orbit.system, orbit.phase, 1.0, orbit.q, orbit.qd, orbit.qdd)["y"]
    values = values + 0.5 * np.cos(orbit.phase)
    expected = np.fft.fft(values[:-1]) / (len(values) - 1)
    assert y[3:] == pytest.approx(expected[:4], abs=1e-7)


@pytest.mark.parametrize("order", [1, 2])
def test_equivalent_systems_have_the_same_response(order):
    second, *others = restated(4, 2)
    system = others[order - 1]
    transfers = [solve.harmonic_transfer(one, 1.3, harmonics=12) for one in (second, system)]
    responses = [np.einsum("iokj,kj->io", one.at(0.0).values, one.excitation) + one.rest for one in transfers]
    assert np.abs(responses[1][:, :2] - responses[0]).max() <= 1e-7 * np.abs(responses[0]).max()
