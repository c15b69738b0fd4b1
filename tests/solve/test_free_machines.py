"""Free machines, compared with the complex solution of constant systems and DOP853."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

import solve
from derive import Mechanism, cos, rate
from solve import PeriodicSystem
from solve.errors import MatricesError, NoDerivativeError, UnbalancedLoadError
from solve.results.orbit import Orbit
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.period.test_rigid_body import CHAIN, block, chain

J = np.diag([3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05])
K = chain(CHAIN)
NONE, SHAFTS = 0 * K, 1e-4 * K
DRAG = SHAFTS + np.diag([0, 0, 0.05, 0, 0.02])
TORQUE = np.array([10.0, 0, 0, 0, 0])
SPEED = 1000 * np.pi / 30


def train(C=NONE, mean=0.0, M=J, stiffness=K, torque=TORQUE, order=2):
    """Discs under a torque proportional to cos kφ and a mean torque on the first."""
    M, C, stiffness, torque = (np.asarray(part, dtype=float) for part in (M, C, stiffness, torque))

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        d = np.cos(order * phase)[:, None] * torque + mean * np.eye(len(M))[0]
        return one * M, one * C, one * stiffness, d

    return PeriodicSystem(matrices, [f"q{at + 1}" for at in range(len(M))])


def amplitudes(speed, C=NONE, M=J, stiffness=K, torque=TORQUE, order=2):
    """Amplitudes by the complex solution."""
    rate_ = order * speed
    return np.abs(np.linalg.solve(stiffness + 1j * rate_ * C - rate_**2 * M, torque))


def orders(orbit: Orbit, order=2):
    return np.array([orbit.harmonics(name)[0][order] for name in orbit.coordinates])


def exact_multipliers(C, speed, M=J, stiffness=K):
    """Exact multipliers in descending order of modulus."""
    zero, one = np.zeros_like(M), np.eye(len(M))
    A = np.block([[zero, one], [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, C)]])
    rho = np.exp(np.linalg.eigvals(A) * 2 * np.pi / speed)
    return rho[np.argsort(-np.abs(rho), kind="stable")]


def after_a_period(system, speed, orbit):
    """State (2n,) after a period of integration by DOP853 from the first state of the orbit, and that first
    state."""

    def f(t, y):
        M, C, stiffness, d = (part[0] for part in system.at(np.array([speed * t]), speed))
        q, v = np.split(y, 2)
        return np.concatenate((v, np.linalg.solve(M, d - C @ v - stiffness @ q)))

    start = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    solved = solve_ivp(f, (0, system.period / speed), start, "DOP853", rtol=1e-12, atol=1e-14)
    return solved.y[:, -1], start


@pytest.mark.parametrize("engine", ["auto", "numpy"])
@pytest.mark.parametrize("C", [NONE, SHAFTS, DRAG], ids=["undamped", "shafts", "drag"])
def test_five_discs_vibrate_as_by_the_complex_solve(C, engine):
    orbit = solve.periodic(train(C), SPEED, engine=engine)
    np.testing.assert_allclose(orders(orbit), amplitudes(SPEED, C), rtol=1e-9)
    assert np.abs(orbit.curve.mean).max() < 1e-12 * np.abs(orbit.q).max()
    assert orbit.residual < 1e-9
    assert not orbit.warnings
    if C is NONE:
        printed = [1.348765, 0.498176, 0.358787, 1.089392, 1.395448]
        np.testing.assert_allclose(1e3 * orders(orbit), printed, atol=5e-7)


@pytest.mark.parametrize(
    ("method", "rtol"),
    [("radau", 1e-8), ("fourier", 1e-8), ("hill", 1e-8), ("rk4", 1e-6), ("hsu", 1e-4), ("newmark", 1e-4)],
)
@pytest.mark.parametrize("C", [NONE, DRAG], ids=["undamped", "drag"])
def test_all_methods_solve_the_same_machine(C, method, rtol):
    orbit = solve.periodic(train(C, mean=1.0 if C is DRAG else 0.0), SPEED, method, rtol=rtol)
    np.testing.assert_allclose(orders(orbit), amplitudes(SPEED, C), rtol=3 * rtol)
    for mode in orbit.rigid_body_modes:
        assert mode.vector == (1.0,) * 5
        if mode.damped:
            assert mode.drift == pytest.approx(1 / 0.07, rel=1e-6)


def test_approximations_are_those_of_the_machine():
    """`modal` uncouples constant matrices exactly, except for its curve; the other is exact."""
    for method, error in (("modal", 1e-3), ("bahgat-willmert", 1e-12)):
        found = orders(solve.periodic(train(), SPEED, method))
        np.testing.assert_allclose(found, amplitudes(SPEED), rtol=error)


@pytest.mark.parametrize(
    ("C", "verdict"),
    [
        (NONE, "stable"),
        (SHAFTS, "asymptotically stable"),
        (DRAG, "asymptotically stable"),
        (-SHAFTS, "unstable"),
    ],
)
def test_the_verdict_excludes_rigid_body_modes(C, verdict):
    for found in (solve.floquet(train(C), SPEED), solve.periodic(train(C), SPEED)):
        assert found.verdict == verdict
        count = 1 if C is DRAG else 2
        ones = found.multipliers == 1.0
        assert ones.sum() == count
        assert (found.exponents[ones] == 0).all()
        assert (np.diff(np.abs(found.multipliers)) <= 1e-12 * np.abs(found.multipliers[:-1])).all()
        exact = exact_multipliers(C, SPEED)
        others = np.delete(exact, np.argsort(np.abs(exact - 1))[:count])
        np.testing.assert_allclose(found.spectral_radius, np.abs(others[0]), rtol=1e-7)
        np.testing.assert_allclose(
            np.sort(np.abs(found.multipliers[~ones])), np.sort(np.abs(others)), rtol=1e-3, atol=1e-13
        )
        assert abs(found.liouville) < 1e-4
        (mode,) = found.rigid_body_modes
        assert (mode.vector, mode.damped) == ((1.0,) * 5, C is DRAG)
        assert mode.error < 1e-15
        assert any("rigid-body mode q1 : q2" in note for note in found.notes)
        record = found.record()["rigid_body_modes"]
        assert record[0].keys() == {"vector", "damped", "error", "drift"}


def test_every_multiplier_of_a_free_machine():
    found = solve.floquet(train(DRAG), SPEED, all_multipliers=True)
    exact = exact_multipliers(DRAG, SPEED)
    np.testing.assert_allclose(np.abs(found.multipliers), np.abs(exact), rtol=1e-7)
    assert (found.multipliers == 1.0).sum() == 1
    assert found.unresolved == 0
    assert found.modes[0].unfolded == 0.0


def test_twenty_speeds_are_those_of_the_complex_solve():
    speeds = np.linspace(600, 3100, 20) * np.pi / 30
    for C in (NONE, DRAG):
        found = solve.sweep(train(C), speeds, spectra=["q1", "q5"], harmonics=2)
        truth = np.array([amplitudes(speed, C)[[0, 4]] for speed in speeds])
        made = np.stack([found.spectrum(name)[:, 2] for name in ("q1", "q5")], axis=1)
        np.testing.assert_allclose(made, truth, rtol=1e-9)
        assert (found.multipliers == 1.0).sum(axis=1).tolist() == [1 if C is DRAG else 2] * 20
        assert (found.results.verdicts == (0 if C is DRAG else 1)).all()


@pytest.mark.parametrize("mean", [3.0, -1e-4])
def test_a_load_that_drives_the_machine_is_refused_with_its_mean(mean):
    for C in (NONE, SHAFTS):
        with pytest.raises(UnbalancedLoadError, match=rf"mean torque .* is {mean:g} N m"):
            solve.periodic(train(C, mean), SPEED)
    swept = solve.sweep(train(SHAFTS, mean), [SPEED])
    assert f"is {mean:g} N m" in swept.results.failures[0]


def test_drag_balances_the_mean_load_by_a_drift():
    """q = w t + p(t): w from the sum of all drag, p the static twist due to the drag torques."""
    orbit = solve.periodic(train(DRAG, mean=3.0), SPEED)
    (mode,) = orbit.rigid_body_modes
    assert mode.drift == pytest.approx(3 / 0.07, rel=1e-10)
    assert f"a steady velocity along it (q1: {3 / 0.07:.6g} per second)" in orbit.notes[0]
    twist = np.linalg.lstsq(K, 3 * TORQUE / 10 - DRAG.sum(axis=1) * 3 / 0.07)[0]
    twist -= np.diag(J) @ twist / np.trace(J)
    np.testing.assert_allclose(orbit.curve.mean, twist, rtol=1e-8)
    np.testing.assert_allclose(orders(orbit), amplitudes(SPEED, DRAG), rtol=1e-8)
    grown, start = after_a_period(train(DRAG, mean=3.0), SPEED, orbit)
    drift = np.repeat([3 / 0.07 * 0.06, 0.0], 5)
    np.testing.assert_allclose(grown - start, drift, atol=1e-8)
    assert orbit.residual < 1e-9


def test_of_two_uncoupled_chains_one_may_drift():
    M, stiffness = np.diag([1.0, 2, 1, 3, 1]), block(chain([30.0, 20]), chain([50.0]))
    C = 0.01 * stiffness + np.diag([0.0, 0.2, 0, 0, 0])
    torque = np.array([1.0, 0, 0, 2, 0])
    system = train(C, 0.5, M, stiffness, torque)
    orbit = solve.periodic(system, 1.3)
    np.testing.assert_allclose(orders(orbit), amplitudes(1.3, C, M, stiffness, torque), rtol=1e-8)
    free, dragged = orbit.rigid_body_modes
    assert (free.vector, free.damped, free.drift) == ((0, 0, 0, 1, 1), False, None)
    assert (dragged.vector, dragged.damped) == ((1, 1, 1, 0, 0), True)
    assert dragged.drift == pytest.approx(0.5 / 0.2, rel=1e-9)
    assert (orbit.multipliers == 1).sum() == 3


@pytest.mark.parametrize("speed", [5.0, 11.0, 23.0, 40.0, 80.0])
def test_a_geared_train(speed):
    """Propeller, bull gear and two turbines that rotate 11 and 17 times as fast: e is the ratio of speeds."""
    ratios = np.array([1.0, 1.0, 11.0, 17.0])
    M = np.diag([6000.0, 800.0, 9.0, 3.0])
    stiffness = np.zeros((4, 4))
    for row, k in ((np.array([1.0, -1, 0, 0]), 4e6), *_meshes(ratios, 3e5, 2e5)):
        stiffness += k * np.outer(row, row)
    C = 2e-4 * stiffness
    torque = np.array([1e3, 0, 0, 0])
    orbit = solve.periodic(train(C, 0.0, M, stiffness, torque, order=4), speed)
    truth = amplitudes(speed, C, M, stiffness, torque, order=4)
    np.testing.assert_allclose(orders(orbit, 4), truth, rtol=1e-6)
    np.testing.assert_allclose(orbit.rigid_body_modes[0].vector, ratios / 17, rtol=1e-12)
    assert orbit.verdict == "asymptotically stable"


def _meshes(ratios, *stiffnesses):
    for at, k in enumerate(stiffnesses, start=2):
        row = np.zeros(4)
        row[[1, at]] = ratios[at], -1.0
        yield row, k


def crank(c=0.0, drag=0.0, mean=0.0):
    """Two discs, where the inertia of the first varies with the phase: C e = M′ e."""

    def matrices(phase, speed):
        M = np.zeros((len(phase), 2, 2))
        M[:, 0, 0], M[:, 1, 1] = 1 + 0.3 * np.cos(phase), 2.0
        apart = np.array([[1.0, -1], [-1, 1]])
        C = np.tile(c * apart, (len(phase), 1, 1))
        C[:, 0, 0] += drag - 0.3 * speed * np.sin(phase)
        stiffness = 3 * (1 + 0.2 * np.cos(phase))[:, None, None] * apart
        d = np.zeros((len(phase), 2))
        d[:, 0] = np.cos(2 * phase) + mean
        return M, C, stiffness, d

    return PeriodicSystem(matrices, ["q1", "q2"])


@pytest.mark.parametrize(
    ("method", "rtol"), [("auto", 1e-8), ("radau", 1e-8), ("rk4", 1e-5), ("newmark", 1e-5)]
)
@pytest.mark.parametrize(("c", "verdict"), [(0.0, "stable"), (0.05, "asymptotically stable")])
def test_a_free_crank_train_conserves_its_momentum(c, verdict, method, rtol):
    """C e ≠ 0 is not drag here: +1 is double, and the momentum of the drift-free vibration is not zero."""
    system = crank(c)
    orbit = solve.periodic(system, 1.1, method, rtol=rtol)
    grown, start = after_a_period(system, 1.1, orbit)
    np.testing.assert_allclose(grown, start, atol=30 * rtol * np.abs(start).max())
    assert orbit.verdict in {verdict, "undetermined"} if method == "newmark" else orbit.verdict == verdict
    (mode,) = orbit.rigid_body_modes
    assert (mode.vector, mode.damped, mode.drift) == ((1.0, 1.0), False, None)
    assert (orbit.multipliers == 1).sum() == 2


def test_a_crank_train_that_is_driven_or_dragged():
    with pytest.raises(UnbalancedLoadError, match=r"is 0\.1 N m"):
        solve.periodic(crank(0.05, mean=0.1), 1.1)
    (mode,) = solve.periodic(crank(0.05, 0.2, 0.1), 1.1).rigid_body_modes
    assert mode.damped
    assert mode.drift == pytest.approx(0.5, rel=1e-9)
    with pytest.raises(MatricesError, match="use radau or gauss"):
        solve.periodic(crank(), 1.1, "fourier")


def test_gyroscopic_forces_conserve_a_momentum_too():
    G, stiffness, torque = np.array([[0.0, 0.7], [-0.7, 0]]), np.diag([0.0, 2.0]), np.array([1.0, 0.0])
    orbit = solve.periodic(train(G, 0.0, np.eye(2), stiffness, torque), 1.3)
    np.testing.assert_allclose(orders(orbit), amplitudes(1.3, G, np.eye(2), stiffness, torque), rtol=1e-8)
    assert orbit.verdict == "stable"


def test_inertia_that_varies_against_the_rigid_body_mode_alone():
    """M(φ) e is constant and C e = 0: the coupling of the inertias varies with the phase."""
    apart = np.array([[1.0, -1], [-1, 1]])

    def matrices(phase, speed):
        swing = np.cos(phase)[:, None, None]
        M = np.diag([1.0, 2.0]) + 0.4 * swing * apart
        C = 0.05 * apart - 0.4 * speed * np.sin(phase)[:, None, None] * apart
        d = np.stack((np.cos(2 * phase), np.sin(phase)), axis=1)
        return M, C, 3 * apart * np.ones_like(swing), d

    system = PeriodicSystem(matrices, ["q1", "q2"])
    orbit = solve.periodic(system, 0.9)
    grown, start = after_a_period(system, 0.9, orbit)
    np.testing.assert_allclose(grown, start, atol=1e-9)
    assert np.abs(np.diag([1.0, 2.0]) @ orbit.curve.mean).sum() < 1  # finite; its sum below is the mean
    assert abs(np.array([1.0, 2.0]) @ orbit.curve.mean) < 1e-10


def test_a_single_free_disc():
    """J q″ = cos φ: q = -cos φ/(J Ω²), and no multiplier remains for the verdict."""
    orbit = solve.periodic(train([[0]], 0.0, [[2.0]], [[0]], [1.0], order=1), 3.0)
    np.testing.assert_allclose(orders(orbit, 1), 1 / 18, rtol=1e-10)
    assert (orbit.verdict, orbit.spectral_radius) == ("stable", 0.0)
    assert orbit.multipliers.tolist() == [1, 1]


def cubic(T0=0.0, b=0.0):
    machine = Mechanism("cubic", "Two free discs and a shaft that stiffens")
    q1, q2 = machine.coordinates(q1=("rad", "disc 1"), q2=("rad", "disc 2"))
    J1, J2 = machine.parameters(J1=("kg m^2", "disc 1", "> 0"), J2=("kg m^2", "disc 2", "> 0"))
    k, k3 = machine.parameters(k=("N m/rad", "shaft"), k3=("N m/rad^3", "stiffening"))
    c, drag = machine.parameters(c=("N m s/rad", "shaft"), b=("N m s/rad", "drag"))
    T, mean = machine.parameters(T=("N m", "amplitude"), T0=("N m", "mean"))
    machine.kinetic = (J1 * rate(q1) ** 2 + J2 * rate(q2) ** 2) / 2
    machine.potential = k * (q1 - q2) ** 2 / 2 + k3 * (q1 - q2) ** 4 / 4
    machine.dissipation = c * rate(q1 - q2) ** 2 / 2 + drag * rate(q2) ** 2 / 2
    machine.force(T * cos(machine.phase) + mean, along=q1)
    machine.output("drag", drag * rate(q2), "N m", "torque of the drag")
    return solve.load(machine, J1=1.0, J2=2.0, k=3.0, k3=0.5, c=0.02, b=b, T=1.0, T0=T0)


@pytest.mark.parametrize(("T0", "b"), [(0.0, 0.0), (0.3, 0.1)])
def test_nonlinear_orbits_of_a_free_machine(T0, b):
    orbit = solve.nonlinear(cubic(T0, b), 1.3)

    def f(t, y):
        q1, q2, v1, v2 = y
        shaft = 3 * (q1 - q2) + 0.5 * (q1 - q2) ** 3 + 0.02 * (v1 - v2)
        return [v1, v2, np.cos(1.3 * t) + T0 - shaft, (shaft - b * v2) / 2]

    start = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    grown = solve_ivp(f, (0, orbit.period), start, "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    drift = T0 / b if b else 0.0
    np.testing.assert_allclose(grown - start, np.repeat([drift * orbit.period, 0], 2), atol=1e-9)
    assert orbit.verdict == "asymptotically stable"
    (mode,) = orbit.rigid_body_modes
    assert mode.vector == (1.0, 1.0)
    assert orbit.statistics("drag").mean == pytest.approx(T0, abs=1e-10)
    if b:
        assert mode.drift == pytest.approx(drift, rel=1e-9)


def test_motions_in_time_lead_to_the_nonlinear_orbit_of_a_machine_that_drifts():
    """However far they have turned; the drift is T0/b."""
    machine = cubic(T0=0.3, b=2.0)
    run = solve.transient(machine, 1.3, turns=40, nonlinear=True)
    assert run.reached is not None
    assert run.warnings == []
    end = run.q[:, -1], run.qd[:, -1]
    found = [run.orbit, *(solve.nonlinear(machine, 1.3, start) for start in (None, run, end))]
    found.append(solve.nonlinear(machine, 1.3, periods=2))
    assert [orbit.found_by for orbit in found[-3:]] == ["start", "start", "transient"]
    for orbit in found:
        assert orbit.rigid_body_modes[0].drift == pytest.approx(0.15, rel=1e-6)
        assert orbit.statistics("q1").max_abs == pytest.approx(found[1].statistics("q1").max_abs, rel=1e-5)


def test_a_nonlinear_machine_that_is_driven_is_refused():
    with pytest.raises(UnbalancedLoadError, match=r"is 0\.3 N m"):
        solve.nonlinear(cubic(T0=0.3), 1.3)


def mechanism(**numbers):
    """The chain as a mechanism, with drag at disc 3 and outputs."""
    names = range(1, 6)
    machine = Mechanism("drive_train", "Five discs on a shaft that turns freely")
    q = machine.coordinates(**{f"q{at}": ("rad", f"disc {at}") for at in names})
    inertias = machine.parameters(**{f"J{at}": ("kg m^2", f"disc {at}", "> 0") for at in names})
    k = machine.parameters(**{f"k{at}": ("N m/rad", f"shaft {at}", "> 0") for at in range(1, 5)})
    c, b = machine.parameters(c=("s", "damping of the shafts", ">= 0"), b=("N m s/rad", "drag", ">= 0"))
    T, T0 = machine.parameters(T=("N m", "torque of order 2"), T0=("N m", "mean torque"))
    twist = [one - other for one, other in pairwise(q)]
    machine.kinetic = sum(j * rate(angle) ** 2 for j, angle in zip(inertias, q, strict=True)) / 2
    machine.potential = sum(each * angle**2 for each, angle in zip(k, twist, strict=True)) / 2
    losses = sum(c * each * rate(angle) ** 2 for each, angle in zip(k, twist, strict=True))
    machine.dissipation = (losses + b * rate(q[2]) ** 2) / 2
    machine.force(T0 + T * cos(2 * machine.phase), along=q[0])
    machine.output("shaft", k[3] * twist[3], "N m", "torque in the last shaft")
    machine.output("drag", b * rate(q[2]), "N m", "torque of the drag")
    given = {f"J{at}": float(J[at - 1, at - 1]) for at in names}
    given |= {f"k{at}": float(each) for at, each in enumerate(CHAIN, start=1)}
    return solve.load(machine, **{**given, "c": 1e-4, "b": 0.0, "T": 10.0, "T0": 0.0, **numbers})


ALL = ["periodic", "sweep", "chart", "compare", "critical", "sensitivity", "validity"]


@pytest.mark.parametrize("command", ALL)
def test_all_commands_agree(command):
    machine, truth = mechanism(), amplitudes(SPEED, SHAFTS)
    if command == "periodic":
        assert orders(solve.periodic(machine, SPEED)) == pytest.approx(truth, rel=1e-8)
    elif command == "sweep":
        found = solve.sweep(machine, [SPEED], over={"T": [10.0, 20.0]}, spectra=["q5"], harmonics=2)
        assert found.spectrum("q5")[:, 2] == pytest.approx(np.array([1, 2]) * truth[4], rel=1e-8)
    elif command == "chart":
        for of, value in (("q5.harmonic2", truth[4]), ("rho1.abs", 1.0)):
            chart = solve.chart(machine, {"speed": [SPEED, 1.1 * SPEED]}, {"c": [1e-4, 2e-4]}, of=of)
            assert chart.values[0, 0] == pytest.approx(value, rel=1e-8)
        assert "rigid-body modes at all points" in chart.notes[0]
        exact = np.abs(exact_multipliers(SHAFTS, SPEED)[2])
        assert chart.spectral_radius[0, 0] == pytest.approx(exact, rel=1e-8)
        assert set(chart.verdicts.ravel()) == {"asymptotically stable"}
    elif command == "compare":
        found = solve.compare(machine, SPEED, ["gauss", "fourier"], targets=[1e-6])
        assert orders(found.reference) == pytest.approx(truth, rel=1e-8)
        assert all(row.orbit_error <= 1e-6 for row in found.rows if row.target)
    elif command == "critical":
        found = solve.critical_speeds(machine, np.linspace(2000, 3000, 21) * np.pi / 30, figure="rms")
        (row,) = (row for row in found.rows if row.response)
        assert (row.mode, row.order) == (2, 2)
        around = row.response.speed * (1 + 1e-3 * np.array([-1, 0, 1]))
        below, top, above = (amplitudes(speed, SHAFTS)[0] for speed in around)
        assert top > max(below, above)
        assert row.response.height == pytest.approx(top / np.sqrt(2), rel=1e-6)
    elif command == "sensitivity":
        found = solve.sensitivities(machine, SPEED, of=["q5.harmonic2", "shaft.max_abs"], by=["T", "J1"])
        assert found.elasticities("q5.harmonic2")["T"] == pytest.approx(1.0, rel=1e-8)
        changed = [amplitudes(SPEED, SHAFTS, J + np.diag([h, 0, 0, 0, 0]))[4] for h in (-1e-8, 1e-8)]
        slope = (changed[1] - changed[0]) / 2e-8
        assert found.elasticities("q5.harmonic2")["J1"] == pytest.approx(slope * 3.5e-3 / truth[4], rel=1e-6)
    else:
        found = solve.validity(machine, [SPEED])
        assert np.isfinite(found.sweep.figures("q5")).all() if hasattr(found, "sweep") else True


@pytest.mark.parametrize("numbers", [{"T0": 0.0, "b": 0.0}, {"T0": 3.0, "b": 0.07}], ids=["free", "dragged"])
def test_sensitivities_of_a_free_machine(numbers):
    """Against differences of orbits; static twist and drift are among the quantities."""
    of = ["q1.harmonic2", "q5.max_abs", "q2.max", "q3.min", "q2.mean", "shaft.max", "drag.max"]
    of.append("spectral_radius")
    by, numbers = ["J1", "k2", "c", "T", "speed"], {"c": 1e-5, **numbers}
    if numbers["b"]:
        by.append("b")
    else:
        of.remove("drag.max")
    machine = mechanism(**numbers)
    found = solve.sensitivities(machine, SPEED, of=of, by=by)

    def values(name, step):
        speed = SPEED + step * (name == "speed")
        changed = {} if name == "speed" else {name: machine.parameters[name] + step}
        orbit = solve.periodic(machine.varied(changed), speed)
        figures = [orbit.statistics(each.split(".")[0]) for each in of[1:-1]]
        of_turn = [getattr(each, text.split(".")[1]) for each, text in zip(figures, of[1:-1], strict=True)]
        return np.array([orbit.harmonics("q1")[0][2], *of_turn, orbit.spectral_radius])

    sizes = np.abs(values("T", 0.0))
    for at, name in enumerate(by):
        given = SPEED if name == "speed" else machine.parameters[name]
        step = 1e-4 * given
        differences = (values(name, step) - values(name, -step)) / (2 * step)
        made = np.array([found.found[text].derivatives[at] for text in of])
        # Round-off and errors of the orbits, 1e-10 of each quantity, over the step; the mean may be zero.
        allowed = 1e-6 * np.maximum(sizes, 1e-4 * (np.array(of) == "q2.mean")) / given
        assert (np.abs(made - differences) <= 2e-6 * np.abs(differences) + allowed).all()


def test_critical_speeds_of_a_free_machine_move_with_its_frequencies():
    """dω/dk4 = (φ4 - φ5)²/(2ω) for modes φ of unit modal mass. The response is a harmonic, whose largest and
    smallest values are equally large. Other modes and the slope of envelopes move maxima by 1e-4 of this."""
    speeds = np.linspace(2000, 5000, 31) * np.pi / 30
    found = solve.critical_speeds(mechanism(c=1e-6), speeds, "q5")
    squares, shapes = eigh(K, J)
    slopes = (shapes[3] - shapes[4]) ** 2 / 2 / np.sqrt(np.maximum(squares, 1e-9))
    derived = solve.speed_sensitivities(found, ["k4"])
    assert derived.warnings == []
    for way in ("response", "multiplier"):
        rows = [row for row in found.rows if getattr(row, way)]
        assert len(rows) == 2
        for number, row in enumerate(rows, start=1):
            truth = slopes[row.mode - 1] / row.order
            assert derived[f"{way}{number}"]["k4"] == pytest.approx(truth, rel=2e-4)


def test_multipliers_of_free_machines_have_derivatives_at_any_speed():
    """Also where the double +1 of the rigid-body mode cannot be separated from them: at the first speed only
    the monodromy matrix gives their vectors. With damping in proportion to K, |ρ| = exp(-c ω²π/Ω)."""
    squares, shapes = eigh(K, J)
    slopes = (shapes[3] - shapes[4]) ** 2
    for speed in (170.3159590038997, *np.random.default_rng(11).uniform(50, 320, 8)):
        found = solve.sensitivities(mechanism(c=1e-5), speed, ["rho3.abs", "rho5.abs"], ["k4"])
        assert found.warnings == []
        for at, mode in ((3, 1), (5, 2)):
            rate = -1e-5 * np.pi / speed
            truth = rate * slopes[mode] * np.exp(rate * squares[mode])
            assert found[f"rho{at}.abs"]["k4"] == pytest.approx(truth, rel=1e-7)


def test_rigid_body_modes_are_the_first_of_multipliers_on_the_unit_circle():
    machine = mechanism(c=0.0)
    for speed in (500, 700, 1000, 1500, 2000):
        orbit = solve.periodic(machine, f"{speed} rpm")
        assert orbit.multipliers[:2].tolist() == [1, 1]
        found = solve.sensitivities(machine, f"{speed} rpm", ["rho3.abs", "exponent3.im"], ["k4"])
        assert found.warnings == []
        assert found["rho3.abs"]["k4"] == pytest.approx(0.0, abs=1e-12)


def test_drag_without_a_mean_load_leaves_no_steady_velocity():
    (note,) = solve.periodic(mechanism(b=0.07), SPEED).notes
    assert note.endswith("; it has no steady velocity along it")


def test_more_turns_are_asked_for_where_they_help():
    for damping, words in ((1e-4, "give more turns"), (0.0, "start on the orbit")):
        run = solve.transient(mechanism(c=damping), SPEED, turns=5)
        assert run.warnings[0].endswith(words)


def test_bands_name_rigid_body_modes():
    found = solve.bands(mechanism(), "500:3000:5 rpm")
    assert found.notes[0].startswith("rigid-body modes: ")
    assert list(found) == []


def test_a_rigid_body_mode_has_no_derivatives():
    found = solve.sensitivities(mechanism(b=0.07), SPEED, of=["rho1.abs", "rho3.abs"], by=["k1", "c"])
    (warning,) = found.warnings
    assert "rho1.abs is of a rigid-body mode" in warning
    assert np.isfinite(list(found["rho3.abs"].values())).all()


def test_sensitivities_of_a_train_that_conserves_its_momentum_are_refused():
    machine = Mechanism("crank_train", "Two discs, one of varying inertia")
    q1, q2 = machine.coordinates(q1=("rad", "crank"), q2=("rad", "wheel"))
    J1, k = machine.parameters(J1=("kg m^2", "crank", "> 0"), k=("N m/rad", "shaft", "> 0"))
    T = machine.parameter("T", "N m", "torque")
    machine.kinetic = J1 * ((1 + cos(machine.phase) / 3) * rate(q1) ** 2 + 2 * rate(q2) ** 2) / 2
    machine.potential = k * (q1 - q2) ** 2 / 2
    machine.force(T * cos(2 * machine.phase), along=q2)
    system = solve.load(machine, J1=1.0, k=3.0, T=1.0)
    orbit = solve.periodic(system, 1.1)
    grown, start = after_a_period(system, 1.1, orbit)
    np.testing.assert_allclose(grown, start, atol=1e-8)
    with pytest.raises(NoDerivativeError, match="add drag"):
        solve.sensitivities(system, 1.1, of="q1.max_abs", by=["k"])


def test_a_free_orbit_is_read_from_its_file(tmp_path):
    orbit = solve.periodic(train(DRAG, mean=1.0), SPEED)
    orbit.save(tmp_path / "orbit.nc")
    again = solve.open(tmp_path / "orbit.nc")
    assert again.rigid_body_modes == orbit.rigid_body_modes
    np.testing.assert_array_equal(again.qd, orbit.qd)
    assert again.notes == orbit.notes


def test_points_with_and_without_a_spring_to_ground_in_one_chart():
    """A spring to ground that passes 0 makes one point of a chart free; the others agree with single
    solutions."""
    machine = Mechanism("anchored", "Two discs on a spring to ground")
    q1, q2 = machine.coordinates(q1=("rad", "disc 1"), q2=("rad", "disc 2"))
    k, g, c = machine.parameters(k=("N m/rad", "shaft"), g=("N m/rad", "anchor"), c=("N m s/rad", "shaft"))
    machine.kinetic = (
        sum(
            machine.parameter(f"J{at}", "kg m^2", "disc", "> 0") * rate(q) ** 2
            for at, q in ((1, q1), (2, q2))
        )
        / 2
    )
    machine.potential = (k * (q1 - q2) ** 2 + g * q1**2) / 2
    machine.dissipation = c * rate(q1 - q2) ** 2 / 2
    machine.force(machine.parameter("T", "N m", "torque") * cos(machine.phase), along=q2)
    system = solve.load(machine, J1=1.0, J2=2.0, k=3.0, g=1.0, c=0.1, T=1.0)
    found = solve.sweep(system, [1.3], over={"g": [0.0, 0.5, 1.0]}, spectra=["q1"], harmonics=1)
    apart = np.array([[1.0, -1], [-1, 1]])
    for at, anchor in enumerate((0.0, 0.5, 1.0)):
        stiffness = 3 * apart + np.diag([anchor, 0])
        truth = amplitudes(1.3, 0.1 * apart, np.diag([1.0, 2]), stiffness, np.array([0.0, 1]), order=1)
        assert found.spectrum("q1")[at, 1] == pytest.approx(truth[0], rel=1e-8)
    assert (found.multipliers == 1).sum(axis=1).tolist() == [2, 0, 0]
    assert found.results.rigid.tolist() == [2, 0, 0]


@pytest.mark.parametrize(("T0", "b"), [(0.0, 0.0), (0.3, 0.1)])
def test_a_branch_of_a_free_machine_is_that_of_its_orbits(T0, b):
    system = cubic(T0, b)
    found = solve.branch(system, "1.3:1.5 rad/s")
    orbit = solve.nonlinear(system, 1.5)
    largest = [orbit.statistics(name).max_abs for name in orbit.coordinates]
    last = int(np.abs(found.speeds - 1.5).argmin())
    assert found.speeds[last] == pytest.approx(1.5, rel=1e-9)
    np.testing.assert_allclose(found.peaks[last], largest, rtol=1e-5)


@pytest.mark.parametrize("engine", ["numpy", pytest.param("compiled", marks=needs_compiler)])
@pytest.mark.parametrize("breaks", [(), (0.0, 2.0)])
def test_discontinuous_drag_decays_as_its_mean(breaks, engine):
    """q̈ + c(φ) q̇ = cos φ: the velocity decays by exp(-∫c dφ/Ω) per period; several points with their own
    tables, and a single point."""

    def at(phase, speed):
        one = np.ones((len(phase), 1, 1))
        c = np.where(np.mod(phase, 2 * np.pi) < 2.0, 0.3, 0.1) if breaks else 0.2 + 0.1 * np.cos(phase)
        return one, c[:, None, None] * one, 0 * one, np.cos(phase)[:, None]

    machine = PeriodicSystem(at, ["q"], breaks=breaks)
    whole = 0.3 * 2 + 0.1 * (2 * np.pi - 2) if breaks else 0.4 * np.pi
    speeds = np.array([0.7, 1.0, 1.9, 3.1, 4.2])
    found = solve.sweep(machine, speeds, engine=engine)
    expected = np.exp(-whole / speeds)
    np.testing.assert_allclose(np.abs(found.multipliers - 1).min(axis=1), 0.0)
    np.testing.assert_allclose(found.spectral_radius, expected, rtol=1e-9)
    for speed, radius in zip(speeds, expected, strict=True):
        assert solve.floquet(machine, speed, engine=engine).spectral_radius == pytest.approx(radius, rel=1e-9)


@pytest.mark.parametrize(("T0", "drag"), [(0.0, 0.0), (1.0, 0.4)])
def test_a_transient_reaches_the_orbit_of_a_free_machine(T0, drag):
    """A steady motion along the rigid-body mode is excluded: the drift, or the offset from the initial
    state."""
    shaft = np.array([[1.0, -1.0], [-1.0, 1.0]])
    C = 0.8 * shaft + np.diag([0.0, drag])
    machine = train(C, T0, np.diag([1.0, 2.0]), 5.0 * shaft, np.array([1.0, 0.0]), 1)
    found = solve.transient(machine, 1.3, 60)
    assert found.reached is not None
    assert found.reached < 60
    assert found.distances[0].max() > 1e-2
    assert not [text for text in found.warnings if "not reached" in text]
