"""Tolerances of models with closed forms: probabilities, Sobol indices, worst points, invalid requests."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

import solve
from derive import Mechanism, cos, rate
from solve.commands.app import run
from solve.errors import (
    MissingValueError,
    NoResultError,
    SolveError,
    UnitError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.studies import tolerances
from solve.studies.machines import Event
from solve.studies.tolerances import _machines

MASS, DAMPING, STIFFNESS, SPEED = 2.0, 0.3, 9.0, 1.5


def oscillator():
    """Return m q̈ + c q̇ + k q = p cos φ. The damping may be negative."""
    made = Mechanism("oscillator", "Oscillator")
    (q,) = made.coordinates(q=("m", "displacement"))
    m, c, k = made.parameters(m=("kg", "mass", "> 0"), c=("N s/m", "damping"), k=("N/m", "spring", "> 0"))
    (p,) = made.parameters(p=("N", "load"))
    made.kinetic, made.potential, made.dissipation = m * rate(q) ** 2 / 2, k * q**2 / 2, c * rate(q) ** 2 / 2
    made.force(p * cos(made.phase), along=q)
    return made


@pytest.fixture(scope="module")
def model():
    return solve.load(oscillator(), m=MASS, c=DAMPING, k=STIFFNESS, p=1.0)


def amplitude(k, p=1.0):
    return p / np.abs(k - MASS * SPEED**2 + 1j * DAMPING * SPEED)


@pytest.mark.parametrize("truth", [1e-5, 1e-3, 0.2])
def test_probability_of_a_large_amplitude_matches_the_closed_form(model, truth):
    # The amplitude exceeds the limit where k is below a quantile of its normal distribution.
    limit = amplitude(norm(STIFFNESS, 0.4).ppf(truth))
    found = solve.tolerances(
        model, SPEED, {"k": "normal(9, 0.4)"}, [f"q.max_abs < {limit:.17g}"], samples=4096, index_samples=0
    )
    probability = found.probability[f"q.max_abs < {limit:.17g}"]
    # Above resonance, k below the mirror image gives small amplitudes again.
    mirror = 2 * MASS * SPEED**2 - norm(STIFFNESS, 0.4).ppf(truth)
    exact = truth - norm(STIFFNESS, 0.4).cdf(mirror)
    assert found.solves < 5000
    assert probability.low < exact < probability.high
    assert probability.high - probability.low < 0.35 * exact
    assert probability.undetermined == probability.failed == 0


def test_instability_is_as_probable_as_negative_damping(model):
    found = solve.tolerances(model, SPEED, {"c": "normal(0.1, 0.025)"}, samples=2048, index_samples=0)
    unstable = found.probability["unstable"]
    assert unstable.low < norm.sf(4.0) < unstable.high < 1.3 * norm.sf(4.0)


def test_values_below_a_lower_limit_violate_it(model):
    limit = f"q.max_abs > {amplitude(9.5):.17g}"
    found = solve.tolerances(model, SPEED, {"k": "uniform(8, 10)"}, [limit], samples=1024, index_samples=0)
    probability = found.probability[limit]
    assert probability.low < 0.25 < probability.high
    assert found.worst["q.max_abs"].parameters == {"k": pytest.approx(10.0)}


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize(("low", "high", "worst"), [(9.8, 7.0, 10.0), (11.0, 8.5, 8.0), (9.5, 9.4, 8.0)])
def test_worst_point_is_farthest_beyond_one_of_two_limits(model, low, high, worst, reverse):
    """The amplitude decreases with the stiffness k. It reaches the limits at the stiffnesses `low` and
    `high`; the worst point is at the stiffness `worst`."""
    limits = [f"q.max_abs > {amplitude(low):.17g}", f"q.max_abs < {amplitude(high):.17g}"]
    limits.append("spectral_radius > 0.1")
    found = solve.tolerances(
        model,
        SPEED,
        {"k": "uniform(8, 10)"},
        limits[::-1] if reverse else limits,
        samples=64,
        index_samples=0,
    )
    assert found.worst["q.max_abs"].parameters == {"k": pytest.approx(worst)}
    assert found.worst["q.max_abs"].value == pytest.approx(amplitude(worst), rel=1e-6)
    assert found.worst["spectral_radius"].value == pytest.approx(np.exp(-np.pi * DAMPING / MASS / SPEED))


def test_results_within_their_error_of_a_limit_are_counted_separately(model):
    exact = float(solve.periodic(model, SPEED, rtol=1e-12).statistics("q").max_abs)
    found = solve.tolerances(
        model,
        SPEED,
        {"k": "±1e-12 N/m"},
        [f"q.max_abs < {exact:.17g}"],
        samples=64,
        index_samples=0,
        rtol=1e-4,
    )
    (_, probability) = found.probability.values()
    assert (probability.events, probability.undetermined) == (0, 56)
    assert (probability.low, probability.high) == (0.0, 1.0)
    assert "56 samples are undetermined" in found.warnings[0]


def test_verdicts_of_several_speeds_are_combined():
    margins = np.array([[1.0, -1.0], [-1.0, 0.0], [-1.0, np.nan], [1.0, np.nan]])
    event = Event.from_points(margins, margins > 0, margins == 0, np.isnan(margins))
    assert event.occurs.tolist() == [True, False, False, True]
    assert event.undetermined.tolist() == [False, True, False, False]
    assert event.failed.tolist() == [False, False, True, False]


def test_sobol_indices_of_a_product_match_the_closed_form(model):
    found = solve.tolerances(
        model,
        SPEED,
        {"k": "uniform(7, 11)", "p": "uniform(0.5, 1.5)"},
        of=["q.max_abs"],
        samples=64,
        index_samples=2048,
    )
    moments = [
        [quad(lambda x, f=f, n=n: f(x) ** n, low, high)[0] / (high - low) for n in (1, 2)]
        for f, low, high in ((amplitude, 7, 11), (lambda p: p, 0.5, 1.5))
    ]
    (mean_k, square_k), (mean_p, square_p) = moments
    variance = square_k * square_p - (mean_k * mean_p) ** 2
    first = {
        "k": (square_k - mean_k**2) * mean_p**2 / variance,
        "p": (square_p - mean_p**2) * mean_k**2 / variance,
    }
    for name, other in (("k", "p"), ("p", "k")):
        index = found.sobol["q.max_abs"][name]
        assert index.first == pytest.approx(first[name], abs=1e-2)
        assert index.total == pytest.approx(1 - first[other], abs=1e-2)


def test_quantity_without_influence_has_no_sobol_indices():
    # Undamped, all multipliers lie on the unit circle.
    made = solve.load("mathieu", delta=1.0, epsilon=0.0, zeta=0.0)
    found = solve.tolerances(made, 1.0, {"delta": "±0.01"}, samples=64, index_samples=8)
    assert math.isnan(found.sobol["spectral_radius"]["delta"].first)
    assert found.record()["sobol"]["spectral_radius"]["delta"]["total"] is None
    found.plot()


def test_worst_point_lies_at_the_ends_or_at_resonance(model):
    found = solve.tolerances(
        model, SPEED, {"k": "uniform(3, 11)", "p": "±10 %"}, of=["q.max_abs"], samples=64, index_samples=0
    )
    worst = found.worst["q.max_abs"]
    assert worst.parameters == {"k": pytest.approx(MASS * SPEED**2, abs=1e-3), "p": pytest.approx(1.1)}
    assert worst.value == pytest.approx(amplitude(MASS * SPEED**2, 1.1), rel=1e-6)
    assert worst.nominal == pytest.approx(amplitude(STIFFNESS), rel=1e-6)


@pytest.mark.parametrize(("text", "sign"), [("q.min", 1.0), ("q.max", -1.0)])
def test_worst_point_is_sought_among_points_with_a_result(model, text, sign, monkeypatch):
    """Stiffnesses above 8.3, where the amplitude is smallest, have no result."""
    machines = _machines(model, SPEED, {"k": "uniform(8, 10)"}, ([], [text]), ("auto", 1e-8, "auto"))
    quantity = machines.quantities[-1].named
    solved = tolerances.leading

    def leading(design, x, *rest):
        if x[0] > 0.15:
            raise NoResultError("no result")
        return solved(design, x, *rest)

    monkeypatch.setattr(tolerances, "leading", leading)
    low, high = np.array([8.0]), np.array([10.0])
    value, parameters = tolerances._local_worst_point(
        machines, (quantity, sign), SPEED, np.array([8.1]), (low, high)
    )
    assert 8.25 < parameters[0] <= 8.3
    assert value == pytest.approx(-sign * amplitude(parameters[0]), rel=1e-6)
    value, parameters = tolerances._local_worst_point(
        machines, (quantity, sign), SPEED, np.array([9.5]), (low, high)
    )
    assert np.isnan(value)


def test_worst_point_without_derivatives_is_the_worst_sample(model, monkeypatch):
    def without_derivatives(*_):
        raise NoResultError("no derivatives")

    monkeypatch.setattr(tolerances, "leading", without_derivatives)
    found = solve.tolerances(
        model, SPEED, {"k": "uniform(8, 9.5)"}, ["q.max_abs < 1"], samples=64, index_samples=0
    )
    worst = found.worst["q.max_abs"]
    assert worst.value == pytest.approx(amplitude(worst.parameters["k"]), rel=1e-7)
    assert amplitude(8.1) < worst.value <= amplitude(8.0)


def test_worst_speed_is_found_among_several(model):
    found = solve.tolerances(
        model, [1.0, SPEED], {"k": "±10 %"}, of=["q.max_abs"], samples=64, index_samples=0
    )
    assert found.worst["q.max_abs"].speed == SPEED
    assert found.worst["q.max_abs"].value == pytest.approx(amplitude(8.1), rel=1e-6)
    assert found.values[:, 1] == pytest.approx(amplitude(found.points[:, 0]), rel=1e-6)


def test_gradient_of_a_margin_equals_differences(model):
    spreads = {"k": "normal(9, 0.4)", "p": "±10 %"}
    machines = _machines(model, SPEED, spreads, (["q.max_abs < 0.5"], []), ("auto", 1e-12, "auto"))
    gradient, z = machines.gradient(machines.limits[1], SPEED), np.array([0.7, -0.4])
    margin, slopes = gradient(z)
    k, p = machines.parameters(z[None])[0]
    assert margin == pytest.approx(amplitude(k, p) - 0.5, rel=1e-9)
    for place, step in enumerate(1e-4 * np.eye(2)):
        numeric = (gradient(z + step)[0] - gradient(z - step)[0]) / 2e-4
        assert slopes[place] == pytest.approx(numeric, rel=1e-6)


def test_failed_samples_are_counted_and_included_upwards(model):
    # A negative stiffness is no model.
    found = solve.tolerances(model, SPEED, {"k": "normal(9, 9)"}, samples=512, index_samples=0)
    unstable = found.probability["unstable"]
    assert unstable.failed / 448 == pytest.approx(norm.sf(1.0), abs=0.06)
    assert unstable.high > norm.sf(1.0) - 0.06
    assert "have no result" in found.warnings[0]


def test_samples_depend_on_the_seed_but_not_on_workers(model, tmp_path):
    request = {"vary": {"k": "±1 %"}, "samples": 64, "index_samples": 16}
    one, same = (solve.tolerances(model, SPEED, **request) for _ in range(2))
    other = solve.tolerances(model, SPEED, **request, seed=1)
    stored = solve.tolerances(model, SPEED, **request, store=tmp_path / "kept")
    assert one.record() == same.record() == stored.record() != other.record()


def test_saved_result_is_reopened_and_drawn(model, tmp_path):
    limits = ["q.max_abs < 0.3 m"]
    vary = {"k": "±1 %", "c": "±1 %"}
    found = solve.tolerances(model, SPEED, vary, limits, samples=64, index_samples=16)
    found.save(tmp_path / "batch.nc")
    assert solve.open(tmp_path / "batch.nc").record() == found.record()
    assert len(found.plot().axes) == 4
    # Files of earlier versions contain a single number for each limited quantity.
    earlier = replace(found, bounds={name: value for name, (value,) in found.bounds.items()})
    assert len(earlier.plot().axes) == 4
    assert list(found.to_pandas()) == ["k", "c", "spectral_radius", "q.max_abs", "weight"]
    assert "Probability of instability: 0" in repr(found)


def test_quantities_without_influence_are_not_drawn(model):
    """The damping, which does not vary, alone determines the spectral radius, up to round-off."""
    found = solve.tolerances(model, SPEED, {"k": "±1 %"}, ["q.rms < 1"], samples=64, index_samples=8)
    assert np.isnan(found.sobol["spectral_radius"]["k"].total)
    assert "spectral radius" not in [axes.get_xlabel() for axes in found.plot().axes]


@pytest.mark.parametrize("limits", [["q.rms > 0.15", "q.rms < 0.16"], ["q.min > -0.3", "q.min < -0.2"]])
def test_two_limits_of_one_quantity_are_stored_and_drawn(model, limits, tmp_path):
    solve.tolerances(model, SPEED, {"k": "±1 %"}, limits, samples=64, index_samples=0).save(
        tmp_path / "a.npz"
    )
    found = solve.open(tmp_path / "a.npz")
    name, values = limits[0].split()[0], [float(text.split()[-1]) for text in limits]
    assert list(found.bounds[name]) == values
    (axes,) = [each for each in found.plot().axes if name.replace("_", " ") in each.get_xlabel()]
    drawn = [line.get_xdata()[0] for line in axes.lines if line.get_label() != "nominal"]
    assert drawn[1] / drawn[0] == pytest.approx(values[1] / values[0])


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"vary": {}}, MissingValueError, "no parameter has a tolerance"),
        ({"vary": {"z": "±1 %"}}, UnknownNameError, "parameter of oscillator 'z'"),
        ({"vary": {"k": "1 %"}}, ValueOutOfBoundsError, "write '±2 %'"),
        ({"vary": {"k": "±1 kg"}}, UnitError, "kg"),
        ({"vary": {"k": "uniform(-1, 1)"}}, ValueOutOfBoundsError, "allowed: > 0"),
        ({"subject": ["q.max"]}, ValueOutOfBoundsError, "is not a bound"),
        ({"of": ["q"]}, ValueOutOfBoundsError, "contains no statistic"),
        ({"of": ["rho1"]}, ValueOutOfBoundsError, "is complex"),
        ({"samples": 10}, ValueOutOfBoundsError, "samples is 10"),
        ({"samples": 10**9}, ValueOutOfBoundsError, "up to"),
        ({"index_samples": -1}, ValueOutOfBoundsError, "index_samples is -1"),
        ({"method": "newmark"}, ValueOutOfBoundsError, "allowed for tolerances: radau, gauss, auto"),
        ({"rtol": 2.0}, SolveError, "rtol"),
    ],
)
def test_invalid_requests_are_refused(model, change, error, text):
    request = {"vary": {"k": "±1 %"}, "speeds": SPEED, "samples": 64, "index_samples": 0, **change}
    with pytest.raises(error, match=text) as caught:
        solve.tolerances(model, **request)
    assert "\n" not in str(caught.value)


def test_command_prints_the_documented_keys(capsys):
    line = ["tolerances", "mathieu", "--speed", "1rad/s", "--vary", "delta=±0.1", "--vary", "zeta=±10%"]
    flags = ["--set", "zeta=0.01", "--subject", "spectral_radius < 0.97", "--samples", "64"]
    assert run([*line, *flags, "--index-samples", "16", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert {"samples", "probability", "sobol", "worst", "warnings"} <= record.keys()
    assert record["probability"]["unstable"].keys() >= {"value", "low", "high"}
    assert record["sobol"]["spectral_radius"]["zeta"].keys() >= {"first", "total"}
    assert record["worst"]["spectral_radius"]["parameters"].keys() == {"delta", "zeta"}
    assert "spectral_radius < 0.97" in record["probability"]


def test_command_refuses_a_speed_with_a_range_of_speeds(capsys):
    line = ["tolerances", "mathieu", "--speed", "1rad/s", "--speeds", "1:2:2 rad/s", "--vary", "delta=±1%"]
    assert run(line) == 2
    assert "give one of them" in capsys.readouterr().err


@pytest.mark.slow
def test_instability_intervals_of_a_model_cover_92_to_98_percent(model):
    covered = 0
    for seed in range(300):
        found = solve.tolerances(
            model, SPEED, {"c": "normal(0.1, 0.04)"}, samples=256, index_samples=0, seed=seed, rtol=1e-4
        )
        unstable = found.probability["unstable"]
        covered += unstable.low <= norm.sf(2.5) <= unstable.high
    assert 0.92 <= covered / 300 <= 0.98
