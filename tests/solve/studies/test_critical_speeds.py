"""Critical speeds of systems whose frequencies are known."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import solve
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from tests.solve import systems

FREQUENCIES, ZETA = np.array([10.0, 37.0]), 0.02


def oscillators():
    """Two oscillators apart from each other, pushed at orders 1 to 4."""
    damping = np.diag(2 * ZETA * FREQUENCIES)

    def push(phase):
        wave = np.cos(np.outer(phase, np.arange(1, 5))).sum(axis=1)
        return np.column_stack((wave, wave))

    return systems.constant(np.eye(2), damping, np.diag(FREQUENCIES**2), push)


@pytest.fixture(scope="module")
def found():
    return solve.critical_speeds(oscillators(), np.linspace(2.2, 12.0, 30), figure="rms", orders=5)


def rms(speed):
    k = np.arange(1, 5) * speed
    size = 1 / np.sqrt((FREQUENCIES[0] ** 2 - k**2) ** 2 + (2 * ZETA * FREQUENCIES[0] * k) ** 2)
    return np.sqrt((size**2).sum() / 2)


def test_the_response_is_largest_where_its_closed_form_is(found):
    rows = {row.order: row for row in found.rows if row.mode == 1}
    for order in range(1, 5):
        near = FREQUENCIES[0] / order
        truth = minimize_scalar(lambda w: -rms(w), bounds=(0.95 * near, 1.05 * near), method="bounded")
        assert rows[order].response.speed == pytest.approx(truth.x, rel=1e-4)
        assert rows[order].response.height == pytest.approx(rms(truth.x), rel=1e-7)


def test_multipliers_turn_with_the_damped_frequency(found):
    decay, turn = ZETA * FREQUENCIES[0], FREQUENCIES[0] * np.sqrt(1 - ZETA**2)
    rows = {row.order: row for row in found.rows if row.mode == 1}
    for order in range(1, 5):
        near = turn / order

        def real_part(w):
            return -np.exp(-decay * 2 * np.pi / w) * np.cos(turn * 2 * np.pi / w)

        truth = minimize_scalar(real_part, bounds=(0.9 * near, 1.1 * near), method="bounded")
        assert rows[order].multiplier.speed == pytest.approx(truth.x, rel=1e-4)


def test_divisions_and_combinations_are_exact(found):
    divided = {(row.mode, row.order): row.division for row in found.rows if row.division}
    assert {order for mode, order in divided if mode == 1} == {1, 2, 3, 4}
    for (mode, order), speed in divided.items():
        assert speed == pytest.approx(FREQUENCIES[mode - 1] / order, rel=1e-12)
    assert found.combinations
    for one in found.combinations:
        exact = (FREQUENCIES[1] + one.sign * FREQUENCIES[0]) / one.order
        assert one.speed == pytest.approx(exact, rel=1e-12)


def test_a_range_may_be_one_text():
    text, numbers = (
        solve.critical_speeds(oscillators(), speeds, figure="rms", orders=2)
        for speeds in ("5:6:4 rad/s", np.linspace(5.0, 6.0, 4))
    )
    assert [row.speed for row in text.rows] == [row.speed for row in numbers.rows]


def test_bad_input():
    system = oscillators()
    with pytest.raises(ValueOutOfBoundsError, match="at least two speeds"):
        solve.critical_speeds(system, [3.0])
    with pytest.raises(UnknownNameError, match="q2"):
        solve.critical_speeds(system, [3.0, 4.0], "q0")
    with pytest.raises(UnknownNameError, match="max_abs"):
        solve.critical_speeds(system, [3.0, 4.0], figure="max_ab")
    with pytest.raises(ValueOutOfBoundsError, match="orders is 0"):
        solve.critical_speeds(system, [3.0, 4.0], orders=0)


def test_the_picture_has_response_multiplier_and_campbell_diagram(found):
    response, multiplier, campbell = found.plot().axes
    assert response.get_ylabel().startswith("rms q1")
    assert "multiplier" in multiplier.get_ylabel()
    assert "frequency (Hz)" in campbell.get_ylabel()
    shown = [axes.get_ylabel() for axes in found.plot(campbell=True).axes]
    assert shown == [response.get_ylabel(), campbell.get_ylabel()]
    for axes in (response, multiplier, campbell):
        marked = [line for line in axes.get_lines() if line.get_marker() in {"v", "o"}]
        named = [text.get_text() for text in axes.get_legend().get_texts()]
        assert {line.get_label() for line in marked} <= set(named)


def _growing(phase, speed):
    """q″ + c q′ + 4 q, c < 0 between the speeds 2 and 3, where K is frozen at 4 all the same."""
    one = np.ones((len(phase), 1, 1))
    damping = -0.1 if 2.0 < speed < 3.0 else 0.1
    return one, damping * one, 4.0 * one, np.cos(phase)[:, None]


def test_unstable_ranges_are_told_and_the_response_there_is_not_drawn():
    made = solve.critical_speeds(solve.PeriodicSystem(_growing, ["q"]), np.linspace(1.0, 4.0, 31), orders=3)
    ((low, high, radius),) = made.unstable_ranges
    assert 2.0 < low < 2.2
    assert 2.8 < high < 3.0
    assert radius == pytest.approx(np.exp(0.05 * 2 * np.pi / low), rel=1e-6)
    assert any("the motion is unstable from" in text for text in made.warnings)
    assert "Unstable among the speeds" in made._repr_html_()
    (curve,) = [line for line in made.plot().axes[0].get_lines() if line.get_marker() != "v"]
    x, y = np.array(curve.get_data())
    inside = (x > 2.2 * 30 / np.pi) & (x < 2.8 * 30 / np.pi)
    assert not np.isfinite(y[inside]).any()


def test_frozen_frequencies_that_mean_nothing_are_told():
    def hill(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, (1.0 + 2.0 * np.cos(phase))[:, None, None], np.cos(phase)[:, None]

    made = solve.critical_speeds(solve.PeriodicSystem(hill, ["q"]), np.linspace(4.0, 6.0, 5), orders=3)
    assert made.imaginary.all()
    assert any("means and divisions mean nothing" in text for text in made.warnings)


def test_the_curve_goes_through_the_maxima_that_are_marked(found):
    for axes in found.plot().axes[:2]:
        marks = [line for line in axes.get_lines() if line.get_marker() == "v"]
        points = set(zip(*axes.get_lines()[0].get_data(), strict=True))
        assert marks
        assert all(points.issuperset(zip(*mark.get_data(), strict=True)) for mark in marks)
