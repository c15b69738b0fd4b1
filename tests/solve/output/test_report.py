"""Tables and records of systems that no model describes."""

import io
import json

import pytest
from rich.console import Console

import solve
from solve.output.record import orbit_record, plain, stability_record
from solve.output.report import described, orbit_report, stability_report
from tests.solve.output.problems import SPEED, chain, orbit, oscillators


def text_of(report, width=80):
    stream = io.StringIO()
    Console(file=stream, width=width, highlight=False).print(report)
    return stream.getvalue()


def test_a_system_of_ones_own_is_reported():
    """x is 1/2 + cos(φ + ψ)/|4 - 9 + 1.2i|, tan ψ = -1.2/(4 - 9): its maximum lies at φ = 166.5°."""
    text = text_of(orbit_report(orbit()))
    assert "two oscillators" in text
    assert "28.6479 rpm = 3 rad/s" in text
    rows = [line.split() for line in text.splitlines()]
    assert ["x", "mm", "694.4775", "166.5°", "305.5225", "346.5°", "500.0000"] in rows


def test_records_are_json_without_nan():
    record = orbit_record(orbit(), harmonics=3, quasi_static=True)
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["case"] is None
    assert record["parameters"] == {}
    assert len(record["coordinates"]["x"]["harmonics"]) == 4
    assert record["quasi_static"]["coordinates"]["x"]["max"] == pytest.approx(0.75, rel=1e-12)
    assert stability_record(solve.floquet(oscillators(), SPEED))["error_estimate"]["orbit"] is None


def test_plain_data():
    assert plain({"a": (1, float("inf"), float("nan"), 2j, "text", None, True)}) == {
        "a": [1, None, None, [0.0, 2.0], "text", None, True]
    }


def test_many_multipliers_are_counted_not_listed():
    text = text_of(stability_report(solve.floquet(chain(20), SPEED, rtol=1e-4)))
    assert "smaller" in text
    assert len(text.splitlines()) < 25


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (solve.Newmark(), "newmark (gamma 0.5, beta 0.25)"),
        (solve.Radau(5), "radau (order 5)"),
        (solve.RungeKutta4(), "rk4"),
    ],
)
def test_methods_are_named_with_their_settings(method, words):
    assert described(method) == words
