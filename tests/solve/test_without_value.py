"""Outputs that are not finite at some phases cause a warning in every result."""

import pytest

import solve
from derive import Mechanism, cos, rate, sin, sqrt

SAID = "out is not finite at some phases, so it has no statistics"


def oscillator(stated):
    made = Mechanism("oscillator", "one mass on a spring")
    q = made.coordinate("q", "m", "displacement")
    m, k, c, f = made.parameters(
        m=("kg", "mass"), k=("N/m", "spring"), c=("N s/m", "damper"), f=("m", "amplitude")
    )
    made.kinetic, made.potential, made.dissipation = m * rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(k * f * sin(made.phase), along=q)
    made.output("out", stated(made, q, f), "m", "an output")
    return solve.load(made, m=1.0, k=100.0, c=1.0, f=0.1)


@pytest.fixture(
    scope="module",
    params=[lambda made, q, f: sqrt(f**2 - q**2), lambda made, q, f: f / (1 + cos(made.phase))],
    ids=["nan", "inf"],
)
def model(request):
    return oscillator(request.param)


def test_orbit_warns_about_a_nonfinite_output(model):
    orbit = solve.periodic(model, 4.0)
    assert SAID in orbit.warnings
    assert "oscillator" in str(orbit)
    orbit.plot("out")
    orbit.plot("out", scale="dB")


def test_sweep_warns_about_a_nonfinite_output(model):
    sweep = solve.sweep(model, [4.0, 5.0])
    assert [text.partition(" (")[0] for text in sweep.warnings] == [SAID]


def test_transient_warns_about_a_nonfinite_output(model):
    assert SAID in solve.transient(model, 4.0, 2).warnings


def test_chart_warns_about_a_nonfinite_output(model):
    chart = solve.chart(model, {"k": [90.0, 100.0]}, {"c": [1.0, 2.0]}, 4.0, of="out.max")
    assert chart.warnings == [f"at some points {SAID}"]


@pytest.mark.parametrize("figure", ["max", "rms", "harmonic3"])
def test_nonfinite_output_has_no_derivatives(model, figure):
    sensitivities = solve.sensitivities(model, 4.0, [f"out.{figure}", "q.max"])
    reason = "out is not finite at some phases, so it has no derivatives"
    assert sensitivities.warnings == [reason]
    assert sensitivities[f"out.{figure}"]["k"] != sensitivities[f"out.{figure}"]["k"]
