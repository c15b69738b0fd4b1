"""JSON records of results and conversion of their values."""

import json
import math

import numpy as np
import pytest

import solve
from solve.errors import MatricesError
from solve.results.contents import to_json
from solve.results.periodic_motion import QuasiStatic
from solve.results.stability import method_text
from tests.solve.results.problems import SPEED, orbit, oscillators


def test_records_are_json_without_nan():
    record = orbit().record(harmonics=3, quasi_static=True)
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["case"] is None
    assert record["parameters"] == {}
    assert len(record["coordinates"]["x"]["harmonics"]) == 4
    assert record["coordinates"]["x"]["rms"] == pytest.approx(
        math.hypot(0.5, 0.5**0.5 / abs(-5 + 1.2j)), rel=1e-9
    )
    assert record["quasi_static"]["coordinates"]["x"]["max"] == pytest.approx(0.75, rel=1e-12)
    assert solve.floquet(oscillators(), SPEED).record()["error_estimate"]["orbit"] is None


def test_values_are_converted_to_json_data():
    assert to_json({"a": (1, float("inf"), float("nan"), 2j, "text", None, True)}) == {
        "a": [1, None, None, [0.0, 2.0], "text", None, True]
    }


@pytest.mark.parametrize(
    ("method", "words"),
    [
        (solve.Newmark(), "newmark (gamma 0.5, beta 0.25)"),
        (solve.Radau(5), "radau (order 5)"),
        (solve.RungeKutta4(), "rk4"),
    ],
)
def test_record_contains_method_settings(method, words):
    assert method_text(method) == words


def test_singular_stiffness_gives_no_quasi_static_solution():
    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, one, 0.0 * one, np.cos(phase)[:, None]

    with pytest.raises(MatricesError, match="quasi-static"):
        QuasiStatic(solve.PeriodicSystem(matrices, ["q"]), SPEED).statistics("q")
