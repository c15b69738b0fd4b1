"""Orbits with contact at stops, compared with integration from event to event."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import solve
from tests.solve.newton.mechanisms import dashpot, duffing, model_of, stop

NUMBERS = {"zeta": 0.1, "k": 1.0, "kappa": 10.0, "gap": 0.5, "f": 1.0}
SPEED = 1.3


def integrated(start, numbers=NUMBERS, speed=SPEED, reach=float):
    """Integrate a mass with a stop over one period, in which two linear systems alternate. Return the final
    state, its derivatives with respect to the initial state, and the phases of contact and release.

    reach: function of the displacement that is compared with the gap; `abs` for stops on both sides."""
    zeta, k, kappa, gap, f = numbers.values()
    time, last, x, Phi, events = 0.0, 2 * np.pi / speed, np.array(start), np.eye(2), []
    while True:
        side = np.sign(x[0])
        touches = reach(x[0]) > gap or (reach(x[0]) == gap and side * x[1] > 0)
        A = np.array([[0, 1], [-k - kappa * touches, -2 * zeta]])

        def rate(t, y, A=A, push=kappa * gap * touches * side):
            load = np.array([0, f * np.cos(speed * t) + push])
            return np.concatenate((A @ y[:2] + load, (A @ y[2:].reshape(2, 2)).ravel()))

        def passes(t, y):
            return reach(y[0]) - gap

        passes.terminal, passes.direction = True, -1 if touches else 1
        run = solve_ivp(
            rate,
            (time, last),
            np.append(x, Phi.ravel()),
            "DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=passes,
            max_step=last / 512,
        )
        time, x, Phi = run.t[-1], run.y[:2, -1], run.y[2:, -1].reshape(2, 2)
        if run.status == 0:
            return x, Phi, events
        x[0] = np.sign(x[0]) * gap
        events.append(speed * float(time))


def by_imaginary_part(values):
    return values[np.argsort(values.imag)]


@pytest.fixture(scope="module")
def exact():
    """State of the orbit, its multipliers and its events, by Newton's method for the return map."""
    x = np.array([0.5, 0.5])
    x = solve_ivp(
        lambda t, y: [
            y[1],
            np.cos(SPEED * t) - 0.2 * y[1] - y[0] - 10 * max(0.0, y[0] - 0.5),
        ],
        (0, 60 * np.pi / SPEED),
        x,
        rtol=1e-8,
    ).y[:, -1]
    for _ in range(5):
        after, Phi, _ = integrated(x)
        x = x + np.linalg.solve(np.eye(2) - Phi, after - x)
    _, Phi, events = integrated(x)
    return x, by_imaginary_part(np.linalg.eigvals(Phi)), events


def test_orbit_with_a_stop_equals_integration(exact):
    state, multipliers, events = exact
    orbit = solve.nonlinear(model_of(stop(), **NUMBERS), SPEED)
    assert [orbit.q[0, 0], orbit.qd[0, 0]] == pytest.approx(state, abs=1e-10)
    np.testing.assert_allclose(by_imaginary_part(orbit.multipliers), multipliers, atol=1e-10)
    assert orbit.events == pytest.approx(events, abs=1e-9)
    assert orbit.summary_values["events"] == list(orbit.events)
    assert orbit.grazing == ()
    assert orbit.verdict == "asymptotically stable"


def test_methods_retain_their_order_with_events(exact):
    """Curves of Radau's method of order 9 are of order 8."""
    state, multipliers, _ = exact
    model = model_of(stop(), **NUMBERS)
    start, errors = solve.nonlinear(model, SPEED), []
    for steps in (8, 32):
        orbit = solve.nonlinear(model, SPEED, start, method="radau", steps=steps)
        off = by_imaginary_part(orbit.multipliers) - multipliers
        errors.append((abs(orbit.q[0, 0] - state[0]), np.abs(off).max()))
    orders = np.log2(np.array(errors[0]) / errors[1]) / 2
    assert orders.min() > 4


def test_verdict_of_a_grazing_orbit_is_undetermined():
    """Up to the clearance, the orbit is that of a linear oscillator, whose amplitude is known."""
    reach = NUMBERS["f"] / abs(1 - SPEED**2 + 2j * NUMBERS["zeta"] * SPEED)
    orbit = solve.nonlinear(model_of(stop(), **NUMBERS | {"gap": 1.00001 * reach}), SPEED)
    assert orbit.statistics("q").max == pytest.approx(reach, rel=1e-7)
    assert len(orbit.grazing) == 1
    assert orbit.verdict == "undetermined"
    assert any("grazes" in text for text in orbit.warnings)


def test_equations_without_switches_have_no_events():
    orbit = solve.nonlinear(model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.1), 0.5)
    assert (orbit.events, orbit.grazing) == ((), ())


def test_orbit_on_a_hard_stop_is_found_from_a_transient():
    """The contact is shorter than one step of the grids that are used for the search."""
    numbers = NUMBERS | {"zeta": 0.5, "kappa": 1e5}
    orbit = solve.nonlinear(model_of(stop(), **numbers), SPEED, rtol=1e-6)
    start = np.array([orbit.q[0, 0], orbit.qd[0, 0]])
    after, Phi, events = integrated(start, numbers)
    assert after == pytest.approx(start, abs=1e-6)
    assert orbit.events == pytest.approx(events, abs=1e-6)
    assert events[1] - events[0] < 2 * np.pi / 128
    expected = np.linalg.eigvals(Phi)
    np.testing.assert_allclose(by_imaginary_part(orbit.multipliers), by_imaginary_part(expected), atol=1e-6)


DAMPED = {"z": 0.1, "c": 0.4, "kappa": 5.0, "gap": 0.5, "f": 0.3, "one": 1.0}


def after_a_period(start, numbers=DAMPED):
    """State of the mass with the damped stop after one period, integrated from event to event."""
    z, c, kappa, gap, f, _ = numbers.values()
    x, time, last = np.array(start), 0.0, 2 * np.pi / SPEED
    while time < last:
        touches = x[0] > gap or (x[0] == gap and x[1] > 0)

        def rate(t, y, touches=touches):
            stop_force = f + kappa * (y[0] - gap) + c * y[1] if touches else 0.0
            return [y[1], np.cos(SPEED * t) - z * y[1] - y[0] - stop_force]

        def passes(t, y):
            return y[0] - gap

        passes.terminal, passes.direction = True, -1 if touches else 1
        run = solve_ivp(rate, (time, last), x, "DOP853", rtol=1e-13, atol=1e-14, events=passes)
        time, x = run.t[-1], run.y[:, -1]
        if run.status == 1:
            x[0] = gap
    return x


def differences(start, numbers=DAMPED):
    """Derivatives of the return map, by central differences."""
    pairs = [[after_a_period(start + side * d, numbers) for side in (1, -1)] for d in 1e-4 * np.eye(2)]
    return np.array([(one - other) / 2e-4 for one, other in pairs]).T


@pytest.mark.parametrize("z", [10.0, 13.0])
def test_small_multipliers_include_the_jumps_at_events(z):
    """The jumps have the determinant 1: the product of both multipliers follows from the damping."""
    orbit = solve.nonlinear(model_of(dashpot(), **DAMPED | {"z": z, "gap": 0.02}), SPEED)
    start, end = orbit.events
    touches = orbit.at(np.array([(start + end) / 2]))[0, 0] > 0.02
    contact = end - start if touches else 2 * np.pi - end + start
    expected = -(2 * np.pi * z + contact * DAMPED["c"]) / SPEED
    small, error = orbit.multipliers[1], orbit.multiplier_errors[1]
    assert abs(small) < 1e-16
    assert np.log(np.abs(orbit.multipliers)).sum() == pytest.approx(expected, abs=10 * error)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_multipliers_with_discontinuous_forces_equal_differences(engine):
    """Without saltation matrices, they would be 0.576 ± 0.200i."""
    model = model_of(dashpot(), **DAMPED)
    orbit = solve.nonlinear(model, SPEED, engine=engine)
    start = np.array([orbit.q[0, 0], orbit.qd[0, 0]])
    assert after_a_period(start) == pytest.approx(start, abs=1e-10)
    expected = by_imaginary_part(np.linalg.eigvals(differences(start)))
    np.testing.assert_allclose(by_imaginary_part(orbit.multipliers), expected, atol=1e-6)
    assert orbit.verdict == "asymptotically stable"
    assert len(orbit.events) == 2
    each = solve.nonlinear(model, SPEED, orbit, engine=engine, all_multipliers=True)
    np.testing.assert_allclose(by_imaginary_part(each.multipliers), expected, atol=1e-6)


@pytest.mark.parametrize("over", ["gap=0.5:0.2", "f=0.3:0.6"])
def test_branches_with_discontinuous_forces_equal_the_return_map(over):
    """The clearance changes the position of the switch; the preload changes the height of the jump."""
    name, last = over[: over.index("=")], float(over[over.index(":") + 1 :])
    found = solve.branch(model_of(dashpot(), **DAMPED), SPEED, over=over, points=20, rtol=1e-7)
    assert found.ended == ""
    assert found.values[-1] == last
    assert len(found.values) <= 10
    curve, numbers = found.curve(len(found.values) - 1), DAMPED | {name: last}
    zero = np.zeros(1)
    start = np.array([curve(zero)[0, 0], SPEED * curve(zero, 1)[0, 0]])
    for _ in range(4):
        start = start + np.linalg.solve(
            np.eye(2) - differences(start, numbers), after_a_period(start, numbers) - start
        )
    assert start[0] == pytest.approx(found.curves[-1, 0, 0], abs=1e-8)
    expected = by_imaginary_part(np.linalg.eigvals(differences(start, numbers)))
    np.testing.assert_allclose(by_imaginary_part(found.multipliers[-1]), expected, atol=1e-6)


def test_newtons_method_converges_quadratically_with_discontinuous_forces():
    """Without the saltation matrices, the iteration does not converge from the same initial guess."""
    model = model_of(dashpot(), **DAMPED | {"c": 3.0})
    orbit = solve.nonlinear(model, SPEED)
    assert solve.nonlinear(model, 1.02 * SPEED, orbit).iterations <= 6


@pytest.mark.parametrize("kappa", [5000.0, 30000.0])
def test_orbit_with_short_contacts_is_reproduced_from_itself(kappa):
    """Coarse grids have no orbit near it, because the contacts are shorter than their steps."""
    numbers, speed = NUMBERS | {"kappa": kappa}, 0.6
    model = model_of(stop(), **numbers)
    orbit = solve.nonlinear(model, speed)
    again = solve.nonlinear(model, speed, start=orbit)
    assert len(again.events) == 4
    state = np.array([again.q[0, 0], again.qd[0, 0]])
    assert state == pytest.approx([orbit.q[0, 0], orbit.qd[0, 0]], abs=1e-9)
    end, Phi, _ = integrated(state, numbers, speed)
    assert end == pytest.approx(state, abs=1e-9)
    assert again.spectral_radius == pytest.approx(np.abs(np.linalg.eigvals(Phi)).max(), rel=1e-7)
