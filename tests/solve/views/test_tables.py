"""Tables of user systems without a model."""

import io
import math
import re

import numpy as np
import pytest
from rich.console import Console

import solve
from solve.results.contents import Column
from solve.views.show import printout
from solve.views.tables import table_of
from tests.solve.results.problems import SPEED, chain, orbit


def text_of(report, width=80):
    stream = io.StringIO()
    Console(file=stream, width=width, highlight=False).print(report)
    return stream.getvalue()


def test_user_system_is_reported():
    """x is 1/2 + cos(φ + ψ)/|4 - 9 + 1.2i| with tan ψ = -1.2/(4 - 9). Its maximum lies at φ = 166.5°."""
    text = text_of(printout(orbit()))
    assert "two oscillators" in text
    assert "28.6479 rpm = 3 rad/s" in text
    rows = [line.split() for line in text.splitlines()]
    assert ["x", "mm", "694.4775", "166.5°", "305.5225", "346.5°", "500.0000"] in rows


def test_harmonics_below_the_error_are_not_shown():
    """The load of phi contains only harmonic 3. With constant coefficients, so does the response."""
    rows = [line.split() for line in text_of(printout(orbit())).splitlines()]
    (row,) = (row for row in rows if row[:2] == ["φ", "3:"])
    assert row[-2:] == ["–", "–"]


def test_phases_are_drive_angles_for_any_period():
    """A period consists of two revolutions of the drive: the maximum of cos(φ/2 + ψ) lies at twice the angle
    that it has over one revolution."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.4 * one, 4.0 * one, np.cos(phase / 2)[:, None]

    system = solve.PeriodicSystem(matrices, ["x"], period=4 * math.pi)
    behind = 2 * math.degrees(math.atan2(0.4 * SPEED / 2, 4.0 - (SPEED / 2) ** 2))
    rows = [line.split() for line in text_of(printout(solve.periodic(system, SPEED))).splitlines()]
    (row,) = (row for row in rows if row[:1] == ["x"] and len(row) == 6)
    assert [row[2], row[4]] == [f"{behind:.1f}°", f"{behind + 360:.1f}°"]


def test_constant_quantities_have_no_phase_of_their_extrema():
    """x = 2 and y = cos(φ)/(4.3 - 1), with forces that are coupled by x + y."""

    def matrices(phase, speed):
        couple = np.ones((len(phase), 1, 1)) * np.array([[1.0, 1.0], [0.0, 1.0]])
        loads = np.stack((8.6 + np.cos(phase), np.cos(phase)), axis=1)
        return couple, 0.0 * couple, 4.3 * couple, loads

    system = solve.PeriodicSystem(matrices, ["x", "y"])
    rows = [line.split() for line in text_of(printout(solve.periodic(system, 1.0))).splitlines()]
    assert ["x", "2.000000", "–", "2.000000", "–", "2.000000"] in rows
    assert ["y", "0.3030303", "0.0°", "-0.3030303", "180.0°", "0.0000000"] in rows


def test_phase_at_the_period_end_is_shown_as_zero():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.0 * one, 40.0 * one, np.cos(phase + 1e-5)[:, None]

    orbit = solve.periodic(solve.PeriodicSystem(matrices, ["x"]), SPEED)
    assert math.degrees(orbit.statistics("x").max_phase) == pytest.approx(360.0, abs=0.01)
    text = text_of(printout(orbit))
    assert " 0.0°" in text
    assert "360.0°" not in text


def test_many_multipliers_are_counted_not_listed():
    text = text_of(printout(solve.floquet(chain(20), SPEED, rtol=1e-4)))
    assert "smaller" in text
    assert len(text.splitlines()) < 25


def test_zero_orbit_is_reported_and_drawn():
    """There is no force: q = 0, with an empty spectrum. The period is π, so that orders of rotation are
    even."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, (2.0 + np.cos(2 * phase))[:, None, None], 0.0 * one[:, 0]

    rest = solve.periodic(solve.PeriodicSystem(matrices, ["q"], period=math.pi), 1.0)
    rows = [line.split() for line in text_of(printout(rest)).splitlines()]
    assert ["q", "–", "–", "–"] in rows
    for scale in ("linear", "dB"):
        assert rest.plot(scale=scale).axes[0].get_xlim() == (0.0, 180.0)


def test_orders_of_rotation_are_counted_per_revolution():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 2.0 * one, np.cos(4 * phase)[:, None]

    orbit = solve.periodic(solve.PeriodicSystem(matrices, ["q"], period=math.pi), 1.0)
    rows = [line.split() for line in text_of(printout(orbit)).splitlines()]
    amplitude = 1.0 / abs(2.0 - 16.0 + 0.4j)
    strongest = next(row for row in rows if row and row[0] == "q" and row[1].endswith(":"))
    assert strongest[1] == "4:"
    assert float(strongest[2]) == pytest.approx(amplitude, rel=1e-3)
    assert orbit.record()["coordinates"]["q"]["harmonics"][2] == pytest.approx(amplitude, rel=1e-7)


def test_greek_letters_are_shown_but_spelled_out_in_files(tmp_path):
    sweep = solve.sweep(solve.load("mathieu", zeta=0.1), over="epsilon=0:1:3")
    for text in (text_of(printout(sweep)), sweep._repr_html_()):
        assert "ε (1/s²)" in text
        assert not re.search("epsilon|1/s\\^2", text)
    assert "zeta=0.1" in text_of(printout(sweep, ["zeta=0.1"])), "what the user typed stays as it was typed"
    sweep.save(tmp_path / "found.csv")
    assert "epsilon" in (tmp_path / "found.csv").read_text(encoding="utf-8").splitlines()[0]
    assert sweep.record()["points"][0]["parameters"] == {"epsilon": 0.0}


def test_notebook_shows_a_result_once_with_left_aligned_text(monkeypatch, capsys):
    """Rich consoles display their output themselves in a notebook."""
    stability = solve.floquet(solve.load("mathieu"), "1 rad/s")
    alone = repr(stability)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert repr(stability) == alone
    assert capsys.readouterr().out == ""
    method = re.search("<td([^>]*)>gauss", stability._repr_html_())
    assert method is not None
    assert "text-align: left" in method[1]


def test_long_tables_state_which_rows_they_show():
    """Every third of 100 rows fits into 40 rows."""
    lines = text_of(table_of("Squares", {"n": Column(np.arange(100), heading="n")}, most=40)).split("\n")
    assert "Squares; one row in 3 of 100" in lines
    assert [line.strip() for line in lines if line.strip().isdigit()] == [str(n) for n in range(0, 100, 3)]
    assert "one row" not in text_of(table_of("Squares", {"n": Column(np.arange(40), heading="n")}, most=40))
