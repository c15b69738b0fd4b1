"""Mechanisms without coordinates: drive torque and outputs over a revolution, compared with closed forms;
vibration requests are refused."""

import math
import pickle

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate, sin, sqrt
from solve.errors import DesiredMotionError, NoVibrationError, SolveError, ValueOutOfBoundsError
from tests.derive.modules import module_of

NUMBERS = {"J": 0.1, "m": 2.0, "r": 0.05, "L": 0.2, "F": 30.0}
FOUR_BAR = {"a": 0.1, "b": 0.32, "c": 0.25, "d": 0.3, "J": 0.4, "c4": 0.7}
OMEGA = 60.0


def slider_crank():
    made = Mechanism("crank", "Rigid slider-crank")
    J, m = made.parameters(J=("kg m^2", "crank", ">= 0"), m=("kg", "slider", "> 0"))
    r, L, F = made.parameters(r=("m", "crank", "> 0"), L=("m", "rod", "> 0"), F=("N", "against the slider"))
    x = r * cos(made.phase) + sqrt(L**2 - r**2 * sin(made.phase) ** 2)
    made.kinetic = (J * made.speed**2 + m * rate(x) ** 2) / 2
    made.force(-F, along=x)
    made.output("x", x, "m", "place of the slider")
    made.output("v", rate(x), "m/s", "its velocity")
    made.sketch("crank", [(0, 0), (r * cos(made.phase), r * sin(made.phase)), (x, 0 * made.metre)])
    return made


def four_bar():
    made = Mechanism("linkage", "Rigid four-bar whose follower turns a brake")
    a, b, c, d = made.parameters(
        a=("m", "crank", "> 0"),
        b=("m", "coupler", "> 0"),
        c=("m", "follower", "> 0"),
        d=("m", "ground", "> 0"),
    )
    J, c4 = made.parameters(J=("kg m^2", "follower", "> 0"), c4=("N m s/rad", "brake", ">= 0"))
    _, phi4 = made.four_bar("phi3", "phi4", crank=a, coupler=b, follower=c, ground=d)
    made.kinetic, made.dissipation = J * rate(phi4) ** 2 / 2, c4 * rate(phi4) ** 2 / 2
    made.output("angle", phi4, "rad", "angle of the follower")
    return made


@pytest.fixture(scope="module")
def crank():
    return solve.load(slider_crank, **NUMBERS)


def slider(phase):
    """Return the position of the slider and its first two derivatives with respect to the phase, derived by
    hand."""
    r, L = NUMBERS["r"], NUMBERS["L"]
    root = np.sqrt(L**2 - (r * np.sin(phase)) ** 2)
    u = r**2 * np.sin(phase) * np.cos(phase)
    first = -r * np.sin(phase) - u / root
    second = -r * np.cos(phase) - r**2 * np.cos(2 * phase) / root - u**2 / root**3
    return r * np.cos(phase) + root, first, second


def test_torque_of_a_slider_crank_matches_the_closed_form(crank):
    """(d/dt of the kinetic energy + F x′ Ω)/Ω = m Ω² x′ x″ + F x′."""
    orbit = solve.periodic(crank, OMEGA)
    x, first, second = slider(orbit.phase)
    torque = NUMBERS["m"] * OMEGA**2 * first * second + NUMBERS["F"] * first
    assert orbit.outputs["drive_torque"] == pytest.approx(torque, rel=1e-12, abs=1e-12)
    assert orbit.outputs["x"] == pytest.approx(x, rel=1e-14)
    assert orbit.outputs["v"] == pytest.approx(OMEGA * first, rel=1e-12, abs=1e-14)
    fine = np.linspace(0, 2 * math.pi, 2_000_001)
    _, first, second = slider(fine)
    every = NUMBERS["m"] * OMEGA**2 * first * second + NUMBERS["F"] * first
    assert orbit.statistics("drive_torque").max == pytest.approx(every.max(), rel=1e-10)
    assert orbit.statistics("drive_torque").min == pytest.approx(every.min(), rel=1e-10)
    assert orbit.harmonics("x", 2)[0][0] == pytest.approx(np.mean(slider(fine[:-1])[0]), rel=1e-10)


def test_torque_of_a_four_bar_matches_finite_differences():
    """The torque is (J φ̈₄ + c₄ φ̇₄) φ₄′. The angle follows from the law of cosines in the triangle of pin,
    joint and pivot, and its derivatives from finite differences."""
    a, b, c, d = (FOUR_BAR[name] for name in "abcd")

    def follower(phase):
        diagonal = a * np.exp(1j * phase) - d
        s = abs(diagonal)
        return np.angle(diagonal) - math.acos((c**2 + s**2 - b**2) / (2 * c * s))

    orbit, h = solve.periodic(solve.load(four_bar, **FOUR_BAR), OMEGA), 2e-3
    for phase in (0.3, 1.9, 4.4):
        angle = np.unwrap([follower(phase + k * h) for k in range(-2, 3)])
        first = angle @ [1, -8, 0, 8, -1] / (12 * h)
        second = angle @ [-1, 16, -30, 16, -1] / (12 * h**2)
        torque = (FOUR_BAR["J"] * OMEGA**2 * second + FOUR_BAR["c4"] * OMEGA * first) * first
        computed = orbit.signal("angle")(np.array([phase]))[0]
        assert np.exp(1j * computed) == pytest.approx(np.exp(1j * angle[2]), rel=1e-12)
        assert orbit.signal("drive_torque")(np.array([phase]))[0] == pytest.approx(torque, rel=1e-8)


def test_rigid_mechanism_has_no_vibration(crank):
    orbit = solve.periodic(crank, "600 rpm")
    assert (crank.n, crank.coordinates, orbit.q.shape) == (0, (), (0, len(orbit.phase)))
    assert (orbit.multipliers.size, orbit.exponents.size, orbit.stable) == (0, 0, None)
    record = orbit.record()
    assert record["verdict"] is record["spectral_radius"] is record["stable"] is None
    assert orbit.warnings == []
    assert pickle.loads(pickle.dumps(crank)).outputs == crank.outputs


def test_record_of_a_rigid_mechanism_has_the_usual_types(crank):
    """Numbers and lists are in the same places as in other records."""
    record, other = solve.periodic(crank, 30.0).record(), solve.periodic(solve.load("cam"), 30.0).record()
    for name in ("unresolved", "multipliers", "rigid_body_modes", "outputs", "coordinates", "warnings"):
        assert type(record[name]) is type(other[name]), name


def test_sweep_of_a_rigid_mechanism_matches_single_points(crank):
    """Statistics agree with `periodic`; refused values fail individually."""
    sweep = solve.sweep(
        crank, ["300 rpm", "600 rpm"], over={"r": [0.05, 0.1, 0.25]}, spectra=["drive_torque"]
    )
    for point in sweep.points:
        if point.parameters["r"] > NUMBERS["L"]:
            assert "kinetic energy is not real" in (point.error or "")
            continue
        orbit = solve.periodic(crank.varied(point.parameters), point.speed)
        for name in crank.outputs:
            assert point.statistics[name] == pytest.approx(orbit.statistics(name), rel=1e-12, abs=1e-14)
    amplitudes, _ = solve.periodic(crank, "300 rpm").harmonics("drive_torque")
    assert sweep.spectrum("drive_torque")[0] == pytest.approx(amplitudes, rel=1e-9, abs=1e-12)
    assert sweep.plot().axes
    with pytest.raises(DesiredMotionError):
        crank.varied({"r": 0.25})


def test_results_of_a_rigid_mechanism_are_saved(crank, tmp_path):
    orbit = solve.periodic(crank, OMEGA)
    for ending in (".npz", ".csv", ".mat", ".nc"):
        orbit.save(tmp_path / f"orbit{ending}")
    again = solve.open(tmp_path / "orbit.npz")
    assert again.statistics("drive_torque") == orbit.statistics("drive_torque")
    assert again.record() == orbit.record()
    assert again.plot(["drive_torque"]).axes
    sweep = solve.sweep(crank, [OMEGA, 2 * OMEGA])
    sweep.save(tmp_path / "sweep.npz")
    assert solve.open(tmp_path / "sweep.npz").record() == sweep.record()


def test_animation_of_a_rigid_mechanism_matches_its_kinematics(crank, tmp_path):
    animation = solve.animate(crank, OMEGA, frames=5)
    x, *_ = slider(np.array([0.7]))
    assert animation.lines(np.array([0.7]), 1.0)["crank"][-1, 0] == pytest.approx(complex(x[0], 0))
    animation.save(tmp_path / "crank.gif")
    assert "rigid motion" in animation.title


@pytest.mark.parametrize(
    "work",
    [
        lambda model: solve.floquet(model, OMEGA),
        lambda model: solve.nonlinear(model, OMEGA),
        lambda model: solve.bands(model, [10.0, 20.0]),
        lambda model: solve.critical_speeds(model, [10.0, 20.0]),
        lambda model: solve.chart(model, {"speed": [10.0, 20.0]}, {"m": [1.0, 2.0]}),
        lambda model: solve.compare(model, OMEGA),
        lambda model: solve.frequencies(model),
        lambda model: solve.transient(model, OMEGA),
        lambda model: solve.branch(model, (10.0, 20.0)),
        lambda model: solve.sensitivities(model, OMEGA),
        lambda model: solve.validity(model, [10.0, 20.0]),
        lambda model: solve.report(model, OMEGA),
        lambda model: solve.state_space(model, OMEGA),
        lambda model: solve.periodic(model, OMEGA).quasi_static,
        lambda model: solve.prove(model, OMEGA),
        lambda model: solve.prove(solve.periodic(model, OMEGA)),
    ],
)
def test_vibration_requests_are_refused(crank, work):
    with pytest.raises(NoVibrationError, match="crank has no coordinates"):
        work(crank)


def test_store_is_refused(crank, tmp_path):
    with pytest.raises(ValueOutOfBoundsError, match="omit the store"):
        solve.sweep(crank, [OMEGA], store=tmp_path / "store")


def test_generated_module_has_no_coordinates():
    module = module_of(slider_crank())
    assert module.COORDINATES == ()
    assert "no equations of motion" in module.NO_EQUATIONS
    assert not hasattr(module, "residual")


def test_empty_mechanism_is_refused():
    with pytest.raises(Exception, match="has no coordinates; declare one with coordinates"):
        module_of(Mechanism("empty", "Nothing"))


def test_mechanism_with_outputs_only_is_solved():
    made = Mechanism("law", "A law of motion")
    h = made.parameter("h", "mm", "lift")
    made.decline_drive_torque("nothing has mass")
    made.output("lift", h * (1 - cos(made.phase)) / 2, "mm", "of the follower")
    assert solve.periodic(solve.load(made, h=8), 1.0).statistics("lift").max == pytest.approx(8, rel=1e-14)
    assert issubclass(NoVibrationError, SolveError)


def test_no_figure_is_negative_zero():
    """Statistics of a torque that is zero over the whole revolution are 0, not -0."""
    made = Mechanism("still", "Fixed slider")
    x = made.parameter("x", "m", "place", "> 0")
    made.output("place", -(x - x * (cos(made.phase) ** 2 + sin(made.phase) ** 2)), "m", "change of the place")
    made.output("position", x * cos(made.phase), "m", "position")
    sweep = solve.sweep(solve.load(made, x=1.0), [OMEGA])
    figures = np.array(
        [sweep.figures("drive_torque", name) for name in ("max", "min", "max_abs", "mean", "rms")]
    )
    assert np.array_equal(figures, np.zeros((5, 1)))
    assert not np.signbit(figures).any()
