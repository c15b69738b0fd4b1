"""State space as a function of phase, compared with the equations of motion and closed forms."""

import numpy as np
import pytest

import solve
from solve.equations import output_values
from solve.errors import MissingLibraryError, NoMotionError, ValueOutOfBoundsError
from tests.solve.systems import system


def random_system(seed, n=3):
    """Return matrices that depend on the phase. None of them is symmetric, and M is well conditioned."""
    rng = np.random.default_rng(seed)
    still, wave = rng.standard_normal((2, 3, n, n))
    load = rng.standard_normal(n)

    def matrices(phase, speed):
        M, C, K = (still[:, None] + np.cos(phase)[None, :, None, None] * wave[:, None]) / 8
        return M + 2 * np.eye(n), C, K, np.sin(phase)[:, None] * load

    return system(matrices, n)


@pytest.mark.parametrize("seed", range(3))
def test_state_space_satisfies_the_equation_of_motion(seed):
    """M q̈ + C q̇ + K q = d + u holds for any state and force."""
    given = random_system(seed)
    space = solve.state_space(given, 2.0, samples=5)
    rng = np.random.default_rng(seed)
    x, u = rng.standard_normal((5, 6)), rng.standard_normal((5, 3))
    rate = np.einsum("kij,kj->ki", space.A, x) + np.einsum("kij,kj->ki", space.B, u + space.d)
    M, C, K, d = given.at(space.phase, 2.0)
    force = (np.einsum("kij,kj->ki", part, q) for part, q in ((M, rate[:, 3:]), (C, x[:, 3:]), (K, x[:, :3])))
    np.testing.assert_allclose(rate[:, :3], x[:, 3:])
    np.testing.assert_allclose(sum(force), d + u, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.einsum("kij,kj->ki", space.C, x), x[:, :3])
    assert not space.D.any()
    assert space.phase == pytest.approx(np.arange(5) * 2 * np.pi / 5)


def test_outputs_of_a_model_are_linearised_with_the_acceleration():
    """The outputs of the manipulator, some of which depend on q̈, are compared for a small state and force."""
    model, speed, small = solve.load("manipulator"), 20.0, 1e-6
    space = solve.state_space(model, speed, samples=7)
    rng = np.random.default_rng(0)
    u = rng.standard_normal((7, 2)) * np.abs(space.d).max(axis=0)
    x = rng.standard_normal((7, 4)) * np.array([1e-3, 1e-3, 1e-2, 1e-2])

    def outputs(size):
        acceleration = np.einsum("kij,kj->ki", space.A, size * x) + np.einsum("kij,kj->ki", space.B, size * u)
        states = (size * x[:, :2]).T, (size * x[:, 2:]).T, acceleration[:, 2:].T
        values = output_values(model, space.phase, speed, *states)
        return np.stack([values[name] for name in model.outputs], axis=1)

    slope = (outputs(small) - outputs(-small)) / (2 * small)
    linear = np.einsum("kij,kj->ki", space.C, x) + np.einsum("kij,kj->ki", space.D, u)
    np.testing.assert_allclose(linear[:, 2:], slope, rtol=1e-5, atol=1e-7 * np.abs(slope).max())
    np.testing.assert_allclose(space.y0[:, 2:], outputs(0.0), rtol=1e-12)
    assert space.signals.outputs == (*model.coordinates, *model.outputs)


def test_signals_have_names_and_units():
    names = solve.state_space(solve.load("cam"), "600 rpm", samples=2).signals
    assert names.states == ("q1", "q2", "q3", "q1_dot", "q2_dot", "q3_dot")
    assert names.state_units == ("rad", "m", "m", "rad/s", "m/s", "m/s")
    assert names.inputs == ("force_q1", "force_q2", "force_q3")
    assert names.input_units == ("N m", "N", "N")
    assert names.output_units[3:] == ("N m", "N m", "N", "m", "1", "W", "m", "m")


def test_sample_at_a_jump_is_the_value_after_it():
    """Meissner's equation jumps at 0 and at half a period."""
    space = solve.state_space(solve.load("meissner", w1=3.0, w2=1.0), 1.0, samples=4)
    np.testing.assert_allclose(-space.A[:, 1, 0], [9.0, 9.0, 1.0, 1.0])


def test_outputs_of_a_structure_of_beams_are_its_coordinates():
    beams = solve.load("four_bar")
    space = solve.state_space(beams, "30 rad/s", samples=2)
    assert space.signals.outputs == beams.coordinates
    assert space.A.shape == (2, 18, 18)


def test_frozen_system_is_a_python_control_system():
    pytest.importorskip("control", reason="python-control is not installed")
    space = solve.state_space(solve.load("cam"), "600 rpm", samples=4)
    frozen = space.frozen(space.phase[3])
    np.testing.assert_array_equal(frozen.A, space.A[3])
    np.testing.assert_array_equal(frozen.D, space.D[3])
    assert frozen.input_labels == list(space.signals.inputs)
    assert frozen.output_labels == list(space.signals.outputs)
    with pytest.raises(ValueOutOfBoundsError, match="phase is nan"):
        space.frozen(np.nan)
    for wrong in ("a", None, 1j, [0.0, 1.0]):
        with pytest.raises(ValueOutOfBoundsError, match="allowed: a finite angle in rad"):
            space.frozen(wrong)


def test_frozen_system_at_a_jump_has_the_values_after_it():
    pytest.importorskip("control", reason="python-control is not installed")

    def matrices(phase, speed):
        one, half = np.ones((len(phase), 1, 1)), np.sign(np.sin(phase))[:, None, None]
        return one, 0 * one, 5.0 + 4 * half, one[:, 0]

    space = solve.state_space(solve.PeriodicSystem(matrices, ["q"], breaks=(0.0, np.pi)), 1.0, samples=4)
    for phase, A in zip(space.phase, space.A, strict=True):
        np.testing.assert_array_equal(space.frozen(phase).A, A)


def test_names_with_dots_are_converted_for_python_control():
    pytest.importorskip("control", reason="python-control is not installed")
    given = solve.PeriodicSystem(random_system(0, 1).at, ["q.1"])
    assert solve.state_space(given, 1.0, samples=2).frozen(0.0).output_labels == ["q_1"]
    assert solve.harmonic_transfer(given, 1.0, 1).lifted().input_labels[1] == "force_q_1_c1"


def test_invalid_requests_are_refused(monkeypatch):
    with pytest.raises(NoMotionError, match="solve frequencies portal_frame"):
        solve.state_space(solve.load("portal_frame"), 1.0)
    for samples in (0, 1.5, True):
        with pytest.raises(ValueOutOfBoundsError, match="whole numbers"):
            solve.state_space(solve.load("cam"), 1.0, samples=samples)
    with pytest.raises(ValueOutOfBoundsError, match="--limit"):
        solve.state_space(solve.load("cam"), 1.0, samples=10**9)
    monkeypatch.setitem(__import__("sys").modules, "control", None)
    with pytest.raises(MissingLibraryError, match=r'pip install "parametric-vibration\[control\]"'):
        solve.state_space(solve.load("cam"), 1.0, samples=2).frozen(0.0)


def test_repr_lists_signals():
    text = repr(solve.state_space(solve.load("mathieu"), "1 rad/s"))
    assert text.splitlines()[1:] == ["states  q, q_dot", "inputs  force_q", "outputs q"]


def test_drive_torque_is_the_torque_in_the_shaft():
    """As in docs/interfaces.md, a force along the twist is an external force on the driven side of the
    shaft."""
    model = solve.load("cam")
    space = solve.state_space(model, "600 rpm", samples=4)
    row = space.signals.outputs.index("drive_torque")
    assert not space.D[:, row].any()
    shaft = [-model.parameters["k1"], 0, 0, -model.parameters["c1"], 0, 0]
    np.testing.assert_allclose(space.C[:, row], [shaft] * 4, rtol=1e-12)
