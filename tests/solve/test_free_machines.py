"""Free machines, compared with the complex solution of constant systems and DOP853."""

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate
from solve import PeriodicSystem
from solve.errors import MatricesError, UnbalancedLoadError
from tests.solve.free_machines import (
    DRAG,
    NONE,
    SHAFTS,
    SPEED,
    TORQUE,
    J,
    K,
    after_a_period,
    amplitudes,
    exact_multipliers,
    orders,
    train,
)
from tests.solve.kernel.test_lanes import needs_compiler
from tests.solve.period.test_rigid_body import block, chain
from tests.solve.references import multiplier_error


@pytest.mark.parametrize("engine", ["auto", "numpy"])
@pytest.mark.parametrize("C", [NONE, SHAFTS, DRAG], ids=["undamped", "shafts", "drag"])
def test_vibration_of_five_discs_matches_the_complex_solution(C, engine):
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
    speed = 6 * SPEED  # fewer harmonics of the modes than at the printed speed
    orbit = solve.periodic(train(C, mean=1.0 if C is DRAG else 0.0), speed, method, rtol=rtol)
    np.testing.assert_allclose(orders(orbit), amplitudes(speed, C), rtol=3 * rtol)
    for mode in orbit.rigid_body_modes:
        assert mode.vector == (1.0,) * 5
        if mode.damped:
            assert mode.drift == pytest.approx(1 / 0.07, rel=1e-6)


def test_approximate_methods_match_a_free_machine():
    """For constant matrices, `modal` is exact except for its curve, and the other method is exact."""
    M, stiffness = np.diag([1.0, 2.0]), 3 * np.array([[1.0, -1], [-1, 1]])
    system = train(0 * M, 0.0, M, stiffness, [1.0, 0.0])
    for method, error in (("modal", 1e-3), ("bahgat-willmert", 1e-12)):
        computed = orders(solve.periodic(system, 1.3, method))
        np.testing.assert_allclose(computed, amplitudes(1.3, 0 * M, M, stiffness, [1.0, 0.0]), rtol=error)


def _two_chains():
    """Constant symmetric matrices that couple all coordinates and have two rigid-body modes."""
    random = np.random.default_rng(1)
    mass, stiffness, modes = (
        random.normal(size=(5, 5)),
        random.normal(size=(5, 5)),
        random.normal(size=(5, 2)),
    )
    elastic = np.eye(5) - modes @ np.linalg.pinv(modes)
    return mass @ mass.T + 5 * np.eye(5), 50 * elastic @ stiffness @ stiffness.T @ elastic


@pytest.mark.parametrize("damping", [0.0, 1e-5])
@pytest.mark.parametrize(("M", "stiffness", "speed"), [(J, K, SPEED), (*_two_chains(), 3.0)])
def test_modal_multipliers_of_free_constant_machines_are_exact(M, stiffness, speed, damping):
    C, n = damping * stiffness, len(M)
    stability = solve.floquet(train(C, M=M, stiffness=stiffness), speed, method="modal")
    state = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, C)]]
    )
    truth = np.exp(np.linalg.eigvals(state) * 2 * np.pi / speed)
    rigid = 2 * len(stability.rigid_body_modes)
    elastic = stability.multipliers[np.argsort(np.abs(stability.multipliers - 1))][rigid:]
    truth = truth[np.argsort(np.abs(truth - 1))][rigid:]
    assert multiplier_error(elastic, truth) < 2e-11
    assert stability.error_estimate.multipliers < 1e-8
    assert stability.verdict == ("asymptotically stable" if damping else "stable")


@pytest.mark.parametrize(
    ("C", "verdict"),
    [
        (NONE, "stable"),
        (SHAFTS, "asymptotically stable"),
        (DRAG, "asymptotically stable"),
        (-SHAFTS, "unstable"),
    ],
)
def test_verdict_excludes_rigid_body_modes(C, verdict):
    for solved in (solve.floquet, solve.periodic):
        # The product of all multipliers, the fast ones among them, needs more than the default accuracy.
        computed = solved(train(C), SPEED, rtol=1e-12)
        assert computed.verdict == verdict
        count = 1 if C is DRAG else 2
        ones = computed.multipliers == 1.0
        assert ones.sum() == count
        assert (computed.exponents[ones] == 0).all()
        assert (np.diff(np.abs(computed.multipliers)) <= 1e-12 * np.abs(computed.multipliers[:-1])).all()
        exact = exact_multipliers(C, SPEED)
        others = np.delete(exact, np.argsort(np.abs(exact - 1))[:count])
        np.testing.assert_allclose(computed.spectral_radius, np.abs(others[0]), rtol=1e-7)
        np.testing.assert_allclose(
            np.sort(np.abs(computed.multipliers[~ones])), np.sort(np.abs(others)), rtol=1e-3, atol=1e-13
        )
        assert abs(computed.liouville) < 1e-4
        (mode,) = computed.rigid_body_modes
        assert (mode.vector, mode.damped) == ((1.0,) * 5, C is DRAG)
        assert mode.error < 1e-15
        assert any("rigid-body mode q1 : q2" in note for note in computed.notes)
        record = computed.record()["rigid_body_modes"]
        assert record[0].keys() == {"vector", "damped", "error", "drift"}


def test_all_multipliers_of_a_free_machine():
    stability = solve.floquet(train(DRAG), SPEED, all_multipliers=True)
    exact = exact_multipliers(DRAG, SPEED)
    np.testing.assert_allclose(np.abs(stability.multipliers), np.abs(exact), rtol=1e-7)
    assert (stability.multipliers == 1.0).sum() == 1
    assert stability.unresolved == 0
    assert stability.modes[0].unfolded == 0.0


def test_sweep_matches_the_complex_amplitudes():
    speeds = np.linspace(600, 3100, 20) * np.pi / 30
    for C in (NONE, DRAG):
        sweep = solve.sweep(train(C), speeds, spectra=["q1", "q5"], harmonics=2)
        truth = np.array([amplitudes(speed, C)[[0, 4]] for speed in speeds])
        made = np.stack([sweep.spectrum(name)[:, 2] for name in ("q1", "q5")], axis=1)
        np.testing.assert_allclose(made, truth, rtol=1e-9)
        assert (sweep.multipliers == 1.0).sum(axis=1).tolist() == [1 if C is DRAG else 2] * 20
        assert (sweep.results.verdicts == (0 if C is DRAG else 1)).all()


@pytest.mark.parametrize("mean", [3.0, -1e-4])
def test_unbalanced_mean_load_is_refused(mean):
    for C in (NONE, SHAFTS):
        with pytest.raises(UnbalancedLoadError, match=rf"mean torque .* is {mean:g} N m"):
            solve.periodic(train(C, mean), SPEED)
    swept = solve.sweep(train(SHAFTS, mean), [SPEED])
    assert f"is {mean:g} N m" in swept.results.failures[0]


def test_drag_balances_the_mean_load_by_a_drift():
    """q = w t + p(t): the drift w follows from the sum of all drag, and the static part of p from the drag
    torques."""
    orbit = solve.periodic(train(DRAG, mean=3.0), SPEED)
    (mode,) = orbit.rigid_body_modes
    assert mode.drift == pytest.approx(3 / 0.07, rel=1e-10)
    assert f"a steady velocity along this mode (q1: {3 / 0.07:.6g} per second)" in orbit.notes[0]
    twist = np.linalg.lstsq(K, 3 * TORQUE / 10 - DRAG.sum(axis=1) * 3 / 0.07)[0]
    twist -= np.diag(J) @ twist / np.trace(J)
    np.testing.assert_allclose(orbit.curve.mean, twist, rtol=1e-8)
    np.testing.assert_allclose(orders(orbit), amplitudes(SPEED, DRAG), rtol=1e-8)
    grown, start = after_a_period(train(DRAG, mean=3.0), SPEED, orbit)
    drift = np.repeat([3 / 0.07 * 0.06, 0.0], 5)
    np.testing.assert_allclose(grown - start, drift, atol=1e-8)
    assert orbit.residual < 1e-9


def test_one_of_two_uncoupled_chains_may_drift():
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
def test_geared_train_has_a_rigid_body_mode(speed):
    """Propeller, bull gear, and two turbines that rotate 11 and 17 times as fast. e is the vector of speed
    ratios."""
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
    """Two discs. The inertia of the first one varies with the phase, and C e = M′ e."""

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
def test_free_crank_train_conserves_its_momentum(c, verdict, method, rtol):
    """C e ≠ 0 is not drag here. The multiplier +1 is double, and the momentum of the vibration without drift
    is not zero."""
    system = crank(c)
    orbit = solve.periodic(system, 1.1, method, rtol=rtol)
    grown, start = after_a_period(system, 1.1, orbit)
    np.testing.assert_allclose(grown, start, atol=30 * rtol * np.abs(start).max())
    assert orbit.verdict in {verdict, "undetermined"} if method == "newmark" else orbit.verdict == verdict
    (mode,) = orbit.rigid_body_modes
    assert (mode.vector, mode.damped, mode.drift) == ((1.0, 1.0), False, None)
    assert (orbit.multipliers == 1).sum() == 2


def test_crank_train_with_drive_or_drag_matches_dop853():
    with pytest.raises(UnbalancedLoadError, match=r"is 0\.1 N m"):
        solve.periodic(crank(0.05, mean=0.1), 1.1)
    (mode,) = solve.periodic(crank(0.05, 0.2, 0.1), 1.1).rigid_body_modes
    assert mode.damped
    assert mode.drift == pytest.approx(0.5, rel=1e-9)
    with pytest.raises(MatricesError, match="use radau or gauss"):
        solve.periodic(crank(), 1.1, "fourier")


def test_gyroscopic_forces_conserve_momentum():
    G, stiffness, torque = np.array([[0.0, 0.7], [-0.7, 0]]), np.diag([0.0, 2.0]), np.array([1.0, 0.0])
    orbit = solve.periodic(train(G, 0.0, np.eye(2), stiffness, torque), 1.3)
    np.testing.assert_allclose(orders(orbit), amplitudes(1.3, G, np.eye(2), stiffness, torque), rtol=1e-8)
    assert orbit.verdict == "stable"


def test_varying_inertia_does_not_affect_the_rigid_body_mode():
    """M(φ) e is constant and C e = 0; only the inertial coupling varies with the phase."""
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


def test_single_free_disc_has_no_multiplier_for_the_verdict():
    """For J q″ = cos φ, q = -cos φ/(J Ω²)."""
    orbit = solve.periodic(train([[0]], 0.0, [[2.0]], [[0]], [1.0], order=1), 3.0)
    np.testing.assert_allclose(orders(orbit, 1), 1 / 18, rtol=1e-10)
    assert (orbit.verdict, orbit.spectral_radius) == ("stable", 0.0)
    assert orbit.multipliers.tolist() == [1, 1]


def test_chart_may_contain_free_and_supported_points():
    """The stiffness of a spring to ground passes through 0, at which the machine is free. The points agree
    with single solutions."""
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
    sweep = solve.sweep(system, [1.3], over={"g": [0.0, 0.5, 1.0]}, spectra=["q1"], harmonics=1)
    apart = np.array([[1.0, -1], [-1, 1]])
    for at, anchor in enumerate((0.0, 0.5, 1.0)):
        stiffness = 3 * apart + np.diag([anchor, 0])
        truth = amplitudes(1.3, 0.1 * apart, np.diag([1.0, 2]), stiffness, np.array([0.0, 1]), order=1)
        assert sweep.spectrum("q1")[at, 1] == pytest.approx(truth[0], rel=1e-8)
    assert (sweep.multipliers == 1).sum(axis=1).tolist() == [2, 0, 0]
    assert sweep.results.rigid.tolist() == [2, 0, 0]


@pytest.mark.parametrize("engine", ["numpy", pytest.param("compiled", marks=needs_compiler)])
@pytest.mark.parametrize("breaks", [(), (0.0, 2.0)])
def test_discontinuous_drag_has_the_effect_of_its_mean(breaks, engine):
    """For q̈ + c(φ) q̇ = cos φ, the velocity decays by exp(-∫c dφ/Ω) per period. Several points with their
    own tables, and a single point."""

    def at(phase, speed):
        one = np.ones((len(phase), 1, 1))
        c = np.where(np.mod(phase, 2 * np.pi) < 2.0, 0.3, 0.1) if breaks else 0.2 + 0.1 * np.cos(phase)
        return one, c[:, None, None] * one, 0 * one, np.cos(phase)[:, None]

    machine = PeriodicSystem(at, ["q"], breaks=breaks)
    whole = 0.3 * 2 + 0.1 * (2 * np.pi - 2) if breaks else 0.4 * np.pi
    speeds = np.array([0.7, 1.0, 1.9, 3.1, 4.2])
    sweep = solve.sweep(machine, speeds, engine=engine)
    expected = np.exp(-whole / speeds)
    np.testing.assert_allclose(np.abs(sweep.multipliers - 1).min(axis=1), 0.0)
    np.testing.assert_allclose(sweep.spectral_radius, expected, rtol=1e-9)
    for speed, radius in zip(speeds, expected, strict=True):
        assert solve.floquet(machine, speed, engine=engine).spectral_radius == pytest.approx(radius, rel=1e-9)
