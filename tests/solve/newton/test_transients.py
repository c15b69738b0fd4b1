"""Transients compared with closed forms, time integration and the orbits that they reach."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import BPoly

import solve
from derive import Max, Mechanism, rate, rectangle
from solve.errors import FileError, LinearModelError, ResonanceError, TransientError, ValueOutOfBoundsError
from tests.solve.derivatives.test_jumps import pushed
from tests.solve.newton.mechanisms import duffing, model_of

NUMBERS = {"zeta": 0.05, "k": 1.0, "f": 0.4}
SPEED = 1.6


def integrated(alpha, state, time):
    """Solution (2, k) of Duffing's equation, by DOP853."""

    def rate(t, x):
        return [
            x[1],
            NUMBERS["f"] * np.cos(SPEED * t) - 2 * NUMBERS["zeta"] * x[1] - x[0] - alpha * x[0] ** 3,
        ]

    return solve_ivp(rate, (0, time[-1]), state, "DOP853", time, rtol=1e-12, atol=1e-13).y


@pytest.mark.parametrize(("alpha", "atol"), [(0.0, 1e-7), (1.0, 1e-5)])
def test_transient_from_a_state_matches_time_integration(alpha, atol):
    model, state = model_of(duffing(), alpha=alpha, **NUMBERS), (np.array([0.3]), np.array([-0.2]))
    transient = solve.transient(model, SPEED, 5, state, nonlinear=alpha != 0)
    truth = integrated(alpha, [0.3, -0.2], transient.time)
    np.testing.assert_allclose(np.concatenate((transient.q, transient.qd)), truth, rtol=0, atol=atol)
    assert transient.time[-1] == pytest.approx(5 * 2 * np.pi / SPEED)


def test_distance_to_orbit_decays_with_largest_multiplier():
    model = model_of(duffing(), alpha=0.0, **NUMBERS)
    transient = solve.transient(model, SPEED, 40)
    rate = np.exp(-NUMBERS["zeta"] * 2 * np.pi / SPEED)
    falling = (transient.distances[30, 0] / transient.distances[10, 0]) ** (1 / 20)
    assert falling == pytest.approx(rate, rel=0.01)
    assert transient.reached == int(np.sum(transient.distances[:, 0] > 1e-3))
    assert abs(transient.reached - np.log(1e-3 / transient.distances[0, 0]) / np.log(rate)) < 3


def test_transient_from_the_orbit_remains_on_it():
    transient = solve.transient(solve.load("cam"), "300 rpm", 2, "orbit")
    assert transient.reached == 0
    assert transient.distances.max() < 1e-8
    assert set(transient.warnings) == set(solve.periodic(solve.load("cam"), "300 rpm").warnings)


def test_outputs_agree_with_the_state_at_each_instant():
    """The contact force follows from q and q̇ by its spring and damper."""
    cam = solve.load("cam")
    transient = solve.transient(cam, "200 rpm", 3)
    p = cam.parameters
    expected = -(p["k2"] * transient.q[1] + p["c2"] * transient.qd[1])
    np.testing.assert_allclose(
        transient.outputs["contact_force"], expected, atol=1e-9 * np.abs(expected).max()
    )
    record = transient.record()["outputs"]["contact_force"]
    curve = BPoly.from_derivatives(
        transient.time, np.stack((transient.q[1], transient.qd[1], transient._joined(2)[1]), axis=1)
    )
    dense = np.linspace(0, transient.time[-1], 10**5)
    between = -(p["k2"] * curve(dense) + p["c2"] * curve(dense, 1))
    assert record["min"] == pytest.approx(between.min(), rel=1e-5)
    assert record["min"] < expected.min()
    assert record["unit"] == "N"
    assert transient.to_xarray()["contact_force"].shape == transient.time.shape


def test_motion_outside_the_model_range_gives_a_warning():
    """The bound of the linearisation applies to the linear motion only, and the contact condition applies to
    both motions."""
    cam = solve.load("cam")
    linear, nonlinear = (solve.transient(cam, "600 rpm", 3, nonlinear=way) for way in (False, True))
    trusted = "the linearisation may be invalid"
    assert any(text.startswith(trusted) for text in linear.warnings)
    assert not any(text.startswith(trusted) for text in nonlinear.warnings)
    assert any("lifts off" in text for text in nonlinear.warnings)
    run_up = solve.transient(cam, turns=3, speeds="0:600 rpm")
    assert any(text.startswith(trusted) for text in run_up.warnings)
    assert any("lifts off" in text for text in run_up.warnings)


def test_cam_from_rest_reaches_nonlinear_orbit():
    cam = solve.load("cam")
    computed, orbit = (
        solve.transient(cam, "300 rpm", 8, nonlinear=True),
        solve.nonlinear(cam, "300 rpm", rtol=1e-6),
    )
    assert computed.reached in (2, 3)
    q = orbit.at(computed.nodes)
    error = np.abs(computed.motions[-1, 0] - q).max(axis=1) / np.abs(q).max(axis=1)
    assert error.max() < 1e-4


def test_transient_of_a_structure_of_beams():
    beams = solve.load("four_bar")
    transient = solve.transient(beams, 30.0, 2, "orbit")
    assert transient.reached == 0
    with pytest.raises(LinearModelError, match="linear by construction"):
        solve.transient(beams, 30.0, 2, nonlinear=True)


def test_saved_transient_continues_from_its_end(tmp_path):

    model = model_of(duffing(), alpha=0.0, **NUMBERS)
    whole, first = solve.transient(model, SPEED, 5), solve.transient(model, SPEED, 2)
    first.save(tmp_path / "first.npz")
    second = solve.transient(model, SPEED, 3, tmp_path / "first.npz")
    np.testing.assert_allclose(second.motions, whole.motions[2:], rtol=0, atol=1e-12)
    with pytest.raises(FileError, match=r"has coordinates q; cam has q1, q2, q3"):
        solve.transient(solve.load("cam"), "300 rpm", 1, tmp_path / "first.npz")


def test_short_transient_warns_that_the_orbit_is_not_reached():
    transient = solve.transient(model_of(duffing(), alpha=0.0, **NUMBERS), SPEED, 3)
    assert transient.reached is None
    assert any("not reached" in text for text in transient.warnings)


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"turns": 0}, ValueOutOfBoundsError, "turns is 0"),
        ({"start": "tset"}, FileError, "start 'tset' is not a state"),
        ({"start": "none.npz"}, FileError, "`solve periodic` or `solve transient` wrote"),
        ({"start": (np.zeros(2), np.zeros(1))}, ValueOutOfBoundsError, "shape"),
        ({"start": (np.array([1j]), np.zeros(1))}, ValueOutOfBoundsError, "allowed: 'rest', 'orbit'"),
    ],
)
def test_invalid_input_is_refused(given, error, words):
    with pytest.raises(error, match=words):
        solve.transient(model_of(duffing(), alpha=0.0, **NUMBERS), SPEED, **given)


def test_truncated_file_of_an_initial_state_is_refused(tmp_path):
    duffer, file = model_of(duffing(), alpha=0.0, **NUMBERS), tmp_path / "start.npz"
    solve.periodic(duffer, SPEED).save(file)
    whole = file.read_bytes()
    for kept in (0, 300, len(whole) - 10):
        file.write_bytes(whole[:kept])
        with pytest.raises(FileError, match="is not a saved orbit or transient"):
            solve.transient(duffer, SPEED, 1, file)


def ringing(ratio):
    """Two masses, one on a soft spring and one on a stiff spring with 300 rad/s, whose loads are applied
    suddenly."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        damped = np.array([[0.2, 0.0], [0.0, 2 * ratio * 300.0]])
        load = np.stack((np.cos(phase), np.full(len(phase), 300.0**2)), axis=1)
        return one * np.eye(2), one * damped, one * np.diag([4.0, 300.0**2]), load

    return solve.PeriodicSystem(matrices, ["slow", "fast"])


def test_overshoot_of_a_stiff_mode_matches_the_closed_form():
    """From rest under a constant load, the largest displacement is 1 + exp(-πζ/√(1 - ζ²)) times the static
    one."""
    ratio = 0.01
    transient = solve.transient(ringing(ratio), 1.0, 2)
    over = 1 + np.exp(-np.pi * ratio / np.sqrt(1 - ratio**2))
    assert transient.peaks[0, 1] == pytest.approx(over, abs=transient.between)
    assert transient.between < 1e-4
    assert transient.record()["coordinates"]["fast"]["max"] == pytest.approx(over, rel=1e-4)


def test_too_few_stored_states_give_a_warning(monkeypatch):
    monkeypatch.setattr("solve.newton.transients._MOST_STATES", 256)
    transient = solve.transient(ringing(0.01), 1.0, 2)
    assert any(
        "too fast for the 256 states that are stored per period" in text for text in transient.warnings
    )
    assert abs(transient.peaks[0, 1] - 1.969) > 1e-3


def test_modes_unresolved_in_a_run_up_give_a_warning():
    """During the run-up, a stiff mode oscillates so often that its response to the sudden load cannot be
    computed."""
    numbers = {"zeta": 0.05, "k": 1e8, "alpha": 1.0, "f": 1e6}
    transient = solve.transient(model_of(duffing(), **numbers), turns=1, speeds="0:1 rad/s")
    assert any(text.startswith("ω_max h = ") for text in transient.warnings)
    assert any("the relative error of extrema is unknown" in text for text in transient.warnings)
    assert transient.peaks[0, 0] == pytest.approx(np.abs(transient.q[0, :-1]).max())


@pytest.mark.parametrize("nonlinear", [True, False])
@pytest.mark.parametrize("drive", [{"speed": 1.0}, {"speeds": "0:1 rad/s"}])
def test_stiff_linear_and_nonlinear_motions_are_integrated(drive, nonlinear):
    """A mode that is 1000 times as fast as the speed overshoots to twice the static displacement under a
    sudden load."""
    numbers = {"zeta": 0.05, "k": 1e6, "alpha": 1.0, "f": 1e4}
    transient = solve.transient(model_of(duffing(), **numbers), turns=1, nonlinear=nonlinear, **drive)
    over = 0.01 * (1 + np.exp(-np.pi * 0.05 / 1000))
    assert transient.between < 0.02
    assert transient.peaks[0, 0] == pytest.approx(over, rel=max(5e-4, transient.between))


def test_nonlinear_motion_that_is_too_stiff_is_refused_early(monkeypatch):
    monkeypatch.setattr("solve.model.integration._MAX_STEPS", 2**14)
    monkeypatch.setattr("solve.model.integration._MIN_STEPS", 2**6)
    model = model_of(duffing(), zeta=0.05, k=1e8, alpha=1.0, f=1e6)
    with pytest.raises(TransientError, match="with 16384 steps per period: its vibrations are too fast"):
        solve.transient(model, 1.0, 1, nonlinear=True)


@pytest.mark.slow
def test_fast_modes_require_small_steps_only_initially():
    """The first revolution has 760 000 steps. The first of 256 equal intervals contains more than the mean
    number permits."""
    transient = solve.transient(solve.load("cam"), speeds="0:5 rpm", turns=1, nonlinear=True)
    linear = solve.transient(solve.load("cam"), speeds="0:5 rpm", turns=1)
    assert transient.q[:, -1] == pytest.approx(linear.q[:, -1], rel=1e-3)


def test_nonlinear_motion_does_not_require_a_linear_orbit():
    """At the resonance of the linear equations, without damping, there is no linear orbit."""
    model = model_of(duffing(), zeta=0.0, k=1.0, alpha=1.0, f=0.4)
    transient = solve.transient(model, 1.0, 3, nonlinear=True)

    def rate(t, x):
        return [x[1], 0.4 * np.cos(t) - x[0] - x[0] ** 3]

    truth = solve_ivp(
        rate, (0, transient.time[-1]), [0, 0], "DOP853", transient.time, rtol=1e-12, atol=1e-13
    ).y
    np.testing.assert_allclose(transient.q[0], truth[0], rtol=0, atol=5e-5)
    with pytest.raises(ResonanceError):
        solve.transient(model, 1.0, 3, nonlinear=True, start="orbit")


def test_initial_state_of_another_model_is_refused(tmp_path):
    model = model_of(duffing(), alpha=0.0, **NUMBERS)
    solve.transient(model, SPEED, 1).save(tmp_path / "duffing.npz")
    with pytest.raises(FileError, match=r"duffing.npz' belongs to duffing; give a state of mathieu"):
        solve.transient(solve.load("mathieu"), 2.0, 1, tmp_path / "duffing.npz")


@pytest.mark.parametrize("drive", [{"speed": 2.0}, {"speeds": (0.0, 4.0)}, {"speeds": (1.0, 3.0)}])
def test_load_that_starts_within_a_revolution_moves_the_system(drive):
    followed, linear = (
        solve.transient(pushed(), turns=4, nonlinear=nonlinear, **drive) for nonlinear in (True, False)
    )
    for name in ("q", "qd"):
        ends = [getattr(each, name)[0, -1] for each in (followed, linear)]
        assert ends[0] == pytest.approx(ends[1], abs=1e-4)


def struck(blow, length):
    """Oscillator on a stop that is out of reach, struck by two short pulses of opposite sign per period."""
    rig = Mechanism("struck", "Struck oscillator")
    q = rig.coordinate("q", "m", "displacement")
    m, c, k, far = rig.parameters(
        m=("kg", "mass", "> 0"), c=("N s/m", "damping"), k=("N/m", "stiffness"), far=("m", "distance")
    )
    rig.kinetic, rig.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    rig.dissipation = c * rate(q) ** 2 / 2
    blows = rectangle(rig.phase, blow, blow + length) - rectangle(rig.phase, blow + 2, blow + 2 + length)
    rig.force(k * far * blows / 8 / length - k * Max(0, q - far), along=q)
    return solve.load(rig, m=1.3, c=0.2, k=2.1, far=3.0)


@pytest.mark.parametrize("drive", [{"speed": 1.7}, {"speeds": (0.0, 3.0)}, {"speeds": (4.0, 1.0)}])
@pytest.mark.parametrize("length", [1e-4, 0.007])
def test_nonlinear_motion_includes_short_pulses_between_breaks(drive, length):
    """Before it reaches the stop, the motion is linear, and the sum of the responses to the pulses."""
    first, last = drive.get("speeds", (1.7, 1.7))
    duration = 4 * np.pi / (first + last)
    slope = (last - first) / duration

    def time(phase):
        return 2 * phase / (first + np.sqrt(first**2 + 2 * slope * phase))

    decay = 0.2 / 1.3 / 2
    frequency = np.sqrt(2.1 / 1.3 - decay**2)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    expected = 0.0
    for begin, sign in ((0.9, 1.0), (2.9, -1.0)):
        ends = time(begin), time(begin + length)
        times = np.mean(ends) + nodes * np.diff(ends) / 2
        ages = duration - times
        response = np.exp(-decay * ages) * np.sin(frequency * ages) / (1.3 * frequency)
        expected += sign * 2.1 * 3.0 / 8 / length * np.diff(ends)[0] / 2 * (weights @ response)
    found = solve.transient(struck(0.9, length), turns=1, nonlinear=True, rtol=1e-4, **drive)
    assert np.abs(found.q).max() < 3
    assert found.q[0, -1] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("start", "length"), [(2.7182, 0.008), (0.4321, 0.03)])
def test_transients_include_short_load_pulses_without_breaks(start, length):
    """From rest, the first period ends at the convolution of the pulse with the impulse response."""
    stiffness, damping, period = 3.3, 0.2, 2 * np.pi

    def pulse(phase):
        inside = np.mod(phase - start, period) < length
        return inside * np.sin(np.pi * (phase - start) / length) ** 4 / length

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, damping * one, stiffness * one, pulse(phase)[:, None]

    transient = solve.transient(solve.PeriodicSystem(matrices, ["q"]), 1.0, 1)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    times = start + length * (nodes + 1) / 2
    frequency = np.sqrt(stiffness - damping**2 / 4)
    response = np.exp(-damping / 2 * (period - times)) * np.sin(frequency * (period - times)) / frequency
    expected = length / 2 * (weights @ (pulse(times) * response))
    assert transient.q[0, -1] == pytest.approx(expected, rel=1e-7)
