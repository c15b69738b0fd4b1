"""Warnings about fits: correlated residuals, wrong units or signs, and duplicate rows."""

import numpy as np
import pytest

import solve
from solve.results.fit import Channel
from solve.studies.fit_diagnostics import diagnose
from tests.solve.derivatives.test_sensitivities import model
from tests.solve.studies.test_fit import TRUE, curve, table_file


@pytest.fixture
def file(tmp_path):
    return lambda rows: table_file(tmp_path / "q.csv", "phase (rad),speed (rad/s),q (1)", rows)


@pytest.mark.parametrize("count", [20, 100])
def test_residual_diagnosis_has_few_false_alarms(count):
    """The residuals are those of a fit of three waves. With a false-alarm probability of 1 %, more than 20
    alarms in 1000 fits occur with a probability of 0.1 %."""
    rng, at = np.random.default_rng(5), 2 * np.pi / count * np.arange(count)
    waves = np.linalg.qr(np.stack((np.cos(at), np.sin(at), np.cos(2 * at)), axis=1))[0]
    reported = {0.0: 0, 3.0: 0}
    for size in reported:
        for _ in range(1000):
            noise = rng.standard_normal(count) + size * np.cos(4 * at + rng.uniform(0, 6))
            left = noise - waves @ (waves.T @ noise)
            channel = Channel(1.0, False, "q", at, 50 * np.cos(at), 50 * np.cos(at) + left)
            reported[size] += bool(diagnose([channel], 2 * np.pi, {"q": 1.0}))
    assert reported[0.0] <= 21
    assert reported[3.0] >= (990 if count > 20 else 300)


def test_correlated_residuals_give_a_warning(file):
    rows = [(phase, speed, q + 0.01 * np.cos(3 * phase)) for phase, speed, q in curve(0.01)]
    (text,) = solve.fit(model(), file(rows), list(TRUE)).warnings
    assert text.startswith("q: neighbouring residuals have a correlation of ")
    assert solve.fit(model(), file(curve(0.01)), list(TRUE)).warnings == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            lambda q: 1000 * q,
            "q: the measured values are 1e+03 times those computed at the start; check the unit",
        ),
        (lambda q: 0 * q + 5, "q has the same measured value everywhere"),
        (lambda q: -q, "so the model does not describe them; check unit, sign, speed and phase origin"),
    ],
)
def test_wrong_unit_or_sign_gives_a_warning(file, changed, words):
    rows = [(phase, speed, changed(q)) for phase, speed, q in curve(0.01, m=2.0, c=0.5, k=11.0)]
    assert any(words in text for text in solve.fit(model(), file(rows), ["c"]).warnings)


def test_duplicate_rows_are_reported(file):
    rows = curve(0.01)
    assert any("duplicate rows" in text for text in solve.fit(model(), file([*rows, *rows]), ["k"]).warnings)
