"""Motions at varying speed, compared with the integration of hand-coded equations."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import sqrtm

import solve
from derive import Mechanism, pi, rate, rectangle, sin
from solve.equations import output_values
from solve.errors import LinearModelError, TransientError, UnitError, ValueOutOfBoundsError
from tests.solve.beams.test_springs import rotor
from tests.solve.model.test_damping import NUMBERS, chain

CRANK = {"motor": 0.7, "J": 0.2, "m": 8.0, "r": 0.15, "k": 60.0, "c": 0.4}


@cache
def crank():
    """Elastic shaft that drives a disc with a sliding mass, so that the inertia I(φ + q) varies."""
    made = Mechanism("crank", "Shaft, disc and slider")
    q = made.coordinate("q", "rad", "twist")
    motor = made.parameter("motor", "kg m^2", "motor")
    J, m, r, k, c = made.parameters(
        J=("kg m^2", "disc"), m=("kg", "slider"), r=("m", "stroke"), k=("N m/rad", "shaft"),
        c=("N m s/rad", "shaft"),
    )  # fmt: skip
    angle = made.phase + q
    inertia = motor * made.speed**2 + J * rate(angle) ** 2
    made.kinetic = (inertia + m * rate(r * sin(angle)) ** 2) / 2
    made.potential, made.dissipation = k * q**2 / 2, c * rate(q) ** 2 / 2
    made.output("slider", rate(rate(r * sin(angle))), "m/s^2", "acceleration of the slider")
    return made


def drive(time, first, last, end):
    """Phase, speed and acceleration if the speed varies linearly from first to last."""
    acceleration = (last - first) / end
    return first * time + acceleration * time**2 / 2, first + acceleration * time, acceleration


def integrated(rate_of, size, time):
    return solve_ivp(rate_of, (0, time[-1]), np.zeros(size), "DOP853", time, rtol=1e-12, atol=1e-14).y


def crank_rate(first, last, end, linear):
    """Right-hand side of I q̈ + c q̇ + k q = − I α − I′ θ̇²/2 with I = J + m r² cos² θ and θ = φ + q, or of
    this equation to first order in q."""
    J, mr2, k, c = CRANK["J"], CRANK["m"] * CRANK["r"] ** 2, CRANK["k"], CRANK["c"]

    def rate_of(t, x):
        q, v = x
        phi, speed, alpha = drive(t, first, last, end)
        theta = phi if linear else phi + q
        inertia = J + mr2 * np.cos(theta) ** 2
        slope, second = -mr2 * np.sin(2 * theta), -2 * mr2 * np.cos(2 * theta)
        load = -inertia * alpha - slope * (speed + v) ** 2 / 2
        if linear:
            load = -inertia * alpha - slope * (speed**2 / 2 + speed * v)
            load -= (slope * alpha + second * speed**2 / 2) * q
        return [v, (load - c * v - k * q) / inertia]

    return rate_of


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("ramp", [(0.0, 25.0), (25.0, 0.0), (8.0, 14.0)])
def test_run_up_and_run_down_of_crank(ramp, linear):
    model = solve.load(crank(), **CRANK)
    transient = solve.transient(model, turns=6, nonlinear=not linear, speeds=ramp)
    end = 2 * 6 * 2 * np.pi / sum(ramp)
    assert transient.time[-1] == pytest.approx(end)
    phi, *_ = drive(transient.time, *ramp, end)
    np.testing.assert_allclose(transient.phase, phi, atol=1e-9)
    truth = integrated(crank_rate(*ramp, end, linear), 2, transient.time)
    sizes = np.abs(truth).max(axis=1)
    atol = 1e-6 if linear else 1e-5
    np.testing.assert_allclose(transient.q[0] / sizes[0], truth[0] / sizes[0], rtol=0, atol=atol)
    np.testing.assert_allclose(transient.qd[0] / sizes[1], truth[1] / sizes[1], rtol=0, atol=atol)


@pytest.mark.parametrize("ramp", [(0.0, 25.0), (14.0, 8.0)])
def test_drive_work_balances_energy_and_dissipation(ramp):
    """∫ torque Ω dt equals the change of energy plus ∫ c q̇² dt. The energies are hand-coded."""
    transient = solve.transient(solve.load(crank(), **CRANK), turns=4, nonlinear=True, speeds=ramp)
    (q,), (v,), t = transient.q, transient.qd, transient.time
    speed = drive(t, *ramp, t[-1])[1]
    theta, turning = transient.phase + q, speed + v
    slider = CRANK["r"] * np.cos(theta) * turning
    energy = (CRANK["motor"] * speed**2 + CRANK["J"] * turning**2 + CRANK["m"] * slider**2) / 2
    energy += CRANK["k"] * q**2 / 2
    power = transient.outputs["drive_torque"] * speed - CRANK["c"] * v**2
    given = CubicSpline(t, power).antiderivative()(t)
    np.testing.assert_allclose(given, energy - energy[0], rtol=0, atol=2e-6 * np.abs(energy).max())
    # Of the constant speed's formulas the motor's part is lost.
    steady = output_values(
        transient.system, transient.phase, speed, transient.q, transient.qd, transient._joined(2)
    )
    lost = transient.outputs["drive_torque"] - steady["drive_torque"]
    np.testing.assert_allclose(lost, CRANK["motor"] * transient.acceleration, rtol=1e-9)


@pytest.mark.parametrize("linear", [True, False])
def test_outputs_include_the_acceleration_of_the_drive(linear):
    transient = solve.transient(
        solve.load(crank(), **CRANK), turns=3, nonlinear=not linear, speeds=(3.0, 20.0)
    )
    _, speed, alpha = drive(transient.time, 3.0, 20.0, transient.time[-1])
    states = np.stack((transient.q[0], transient.qd[0]), axis=1)
    rates = crank_rate(3.0, 20.0, transient.time[-1], linear)
    a = np.array([rates(t, x)[1] for t, x in zip(transient.time, states, strict=True)])
    theta, turning = transient.phase + transient.q[0], speed + transient.qd[0]
    expected = CRANK["r"] * (np.cos(theta) * (alpha + a) - np.sin(theta) * turning**2)
    size = np.abs(expected).max()
    np.testing.assert_allclose(transient.outputs["slider"], expected, rtol=0, atol=1e-6 * size)
    record = transient.record()["outputs"]["slider"]
    between = CubicSpline(transient.time, transient.outputs["slider"])(
        np.linspace(0, transient.time[-1], 10**5)
    )
    assert record["max"] == pytest.approx(between.max(), rel=1e-5)
    np.testing.assert_array_equal(transient.to_xarray()["slider"], transient.outputs["slider"])


@pytest.mark.parametrize("nonlinear", [True, False])
def test_nearly_constant_speed_gives_the_constant_speed_motion(nonlinear):
    cam = solve.load("cam")
    ends = [
        solve.transient(cam, turns=2, nonlinear=nonlinear, **given).motions[-1, 0, :, -1]
        for given in ({"speed": 31.0}, {"speeds": (31.0, 31.0 * (1 + 1e-8))})
    ]
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-5)


def test_beams_are_loaded_by_the_acceleration_of_their_links():
    """Stiff arm on springs and dashpots: (μL + m) ẍ + c ẋ + k x = −(μL/2 + m) L d²(cos φ)/dt²."""
    numbers = {"E": 1e14, "A": 1e-4, "I": 1e-5, "rho": 5e3, "L": 0.5, "m": 0.4}
    model = solve.load(rotor(), **numbers, kx=900.0, ky=2500.0, kt=1e9, c=8.0)
    transient = solve.transient(model, turns=1, speeds="0:40 rad/s")
    mass, unbalance = 0.65, 0.525 * 0.5

    def rate_of(t, x):
        phi, speed, alpha = drive(t, 0.0, 40.0, transient.time[-1])
        load = unbalance * (speed**2 - 1j * alpha) * np.exp(1j * phi)
        ax = (load.real - 8.0 * x[2] - 900.0 * x[0]) / mass
        return [x[2], x[3], ax, (load.imag - 8.0 * x[3] - 2500.0 * x[1]) / mass]

    truth = integrated(rate_of, 4, transient.time)
    for row, name in enumerate(("O_x", "O_y")):
        error = np.abs(transient.values(name) - truth[row]).max() / np.abs(truth[row]).max()
        assert error < 1e-5
    _, _, ax, ay = np.transpose([rate_of(t, x) for t, x in zip(transient.time, truth.T, strict=True)])
    phi, speed, alpha = drive(transient.time, 0.0, 40.0, transient.time[-1])
    direction, own = np.exp(1j * phi), ax + 1j * ay
    force = mass * own + unbalance * (1j * alpha - speed**2) * direction
    moment = (0.25 / 3 + 0.4) * 0.5**2 * alpha + unbalance * np.imag(np.conj(direction) * own)
    for name, expected in (("O_force_x", force.real), ("O_force_y", force.imag), ("O_moment", moment)):
        # At the first instant nothing is bent yet that could bear the arm.
        error = np.abs(transient.values(name) - expected)[1:].max() / np.abs(expected).max()
        assert error < 1e-5


def test_field_is_loaded_by_the_acceleration():
    """Pinned link that rotates about its start, with T = ∫μ (ẇ + x Ω)²/2 dx: the load on each mode is −α ∫μ x
    ψ_k dx."""
    made = Mechanism("link", "Turning link")
    L, mu, EI = made.parameters(L=("m", "length"), mu=("kg/m", "mass"), EI=("N m^2", "stiffness"))
    modes = made.option("modes", range(1, 6), default=3)
    beam = made.field("w", "m", "deflection", length=L, shape=lambda k, xi: sin(k * pi * xi), modes=modes)
    velocity = rate(beam.deflection) + beam.position * made.speed
    made.kinetic = beam.integral(mu * velocity**2) / 2
    made.potential = beam.integral(EI * beam.curvature**2) / 2
    transient = solve.transient(solve.load(made, L=2.0, mu=3.0, EI=50.0), turns=4, speeds="0:20 rad/s")
    alpha = 20.0 / transient.time[-1]
    torque = 3.0 * 2.0**3 / 3 * alpha
    for k in (1, 2, 3):
        omega = (k * np.pi / 2.0) ** 2 * np.sqrt(50.0 / 3.0)
        load = -alpha * 2 * 2.0 * (-1) ** (k + 1) / (k * np.pi)
        expected = load / omega**2 * (1 - np.cos(omega * transient.time))
        np.testing.assert_allclose(transient.q[k - 1], expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        # What ∫μ x ẅ dx takes.
        torque += 3.0 * 2.0**2 * (-1) ** (k + 1) / (k * np.pi) * load * np.cos(omega * transient.time)
    np.testing.assert_allclose(
        transient.outputs["drive_torque"], torque, rtol=0, atol=1e-6 * np.abs(torque).max()
    )


def test_run_up_with_jumps_and_modal_damping_matches_integration():
    """The reference integrates interval by interval, each with C = 2ζ M √(M⁻¹K)."""
    model = solve.load(chain(lambda phase: rectangle(phase, 1, 3), 1), e=0.5, zeta1=0.04, **NUMBERS)
    transient = solve.transient(model, turns=3, speeds="1:6 rad/s")
    M, end, state = np.diag([2.0, 4.0]), transient.time[-1], np.zeros(4)
    K = {True: np.array([[125.0, -50], [-50, 50]]), False: np.array([[100.0, -50], [-50, 50]])}
    C = {key: 2 * 0.04 * M @ sqrtm(np.linalg.solve(M, k)).real for key, k in K.items()}
    alpha = 5.0 / end
    phases = sorted({0.0, *(2 * np.pi * k + b for k in range(3) for b in (0.0, 1.0, 3.0)), 6 * np.pi})
    times = (-1 + np.sqrt(1 + 2 * alpha * np.array(phases))) / alpha
    for phase, start, stop in zip(phases[:-1], times[:-1], times[1:], strict=True):
        inside = abs(phase % (2 * np.pi) - 1.0) < 1e-9

        def rate_of(t, x, inside=inside):
            phi, *_ = drive(t, 1.0, 6.0, end)
            force = [0.0, np.cos(phi)] - C[inside] @ x[2:] - K[inside] @ x[:2]
            return np.concatenate((x[2:], np.linalg.solve(M, force)))

        state = solve_ivp(rate_of, (start, stop), state, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    np.testing.assert_allclose(np.append(transient.q[:, -1], transient.qd[:, -1]), state, rtol=1e-5)


def test_run_up_starts_on_an_orbit_and_can_be_resumed(tmp_path):
    model = solve.load(crank(), **CRANK)
    orbit = solve.periodic(model, 8.0)
    transient = solve.transient(model, turns=4, start="orbit", speeds="8:14 rad/s")
    np.testing.assert_allclose(
        (transient.q[0, 0], transient.qd[0, 0]), (orbit.q[0, 0], orbit.qd[0, 0]), rtol=1e-6
    )
    transient.save(str(tmp_path / "up.npz"))
    on = solve.transient(model, 14.0, 1, tmp_path / "up.npz")
    np.testing.assert_allclose(
        (on.q[0, 0], on.qd[0, 0]), (transient.q[0, -1], transient.qd[0, -1]), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({}, ValueOutOfBoundsError, "a constant speed, or the first"),
        ({"speed": 3.0, "speeds": "0:3 rad/s"}, ValueOutOfBoundsError, "a constant speed, or the first"),
        ({"speeds": "0:0 rad/s"}, UnitError, "give two, such as '300:600 rpm', not both 0"),
        ({"speeds": "0:3:5 rad/s"}, UnitError, "give two"),
        ({"speeds": "0:3"}, UnitError, "give two|without a unit"),
        ({"speeds": "-3:3 rad/s"}, ValueOutOfBoundsError, "speed is -3 rad/s; allowed: finite, 0 or more"),
        ({"speeds": "0:3 rad/s", "start": "orbit"}, ValueOutOfBoundsError, "there is no orbit at speed 0"),
    ],
)
def test_invalid_input_is_refused(given, error, words):
    with pytest.raises(error, match=words):
        solve.transient(solve.load(crank(), **CRANK), turns=2, **given)


def test_system_for_constant_speeds_only_is_refused():
    def oscillator(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]

    system = solve.PeriodicSystem(oscillator, ["q"])
    with pytest.raises(TransientError, match="is stated for constant speeds only"):
        solve.transient(system, turns=2, speeds="0:3 rad/s")
    with pytest.raises(LinearModelError, match="linear by construction"):
        solve.transient(solve.load("four_bar"), turns=1, nonlinear=True, speeds="0:9 rad/s")
