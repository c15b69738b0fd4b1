"""Reduced structures: all modes reproduce the full system, and the error with few modes is estimated."""

import json
import pickle

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

import solve
from solve.beams.assembly import Positions
from solve.beams.motion import Motion
from solve.beams.reduced import ReducedMotion
from solve.beams.reduction import basis
from solve.commands.app import run
from solve.errors import SolveError
from solve.period.logarithms import log_distances
from tests.solve.beams.frames import beams

PHASE = np.linspace(0, 2 * np.pi, 240, endpoint=False)


def four_bar(elements, reduce=None, **options):
    return solve.load("four_bar", options={"elements": elements, **options}, reduce=reduce)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"terms": "full"},
        {"stiffening": "on", "terms": "full"},
        {"damping": "rayleigh"},
        {"element": "cubic,curvature,internal"},
    ],
)
def test_basis_of_all_modes_reproduces_the_full_system(options):
    full = four_bar(1, **options)
    with pytest.raises(SolveError, match="allowed: 1 to") as refusal:
        four_bar(1, 99, **options)
    most = int(str(refusal.value).split("1 to ")[1].split()[0])
    reduced = four_bar(1, most, **options)
    assert reduced.n == full.n
    one, other = (solve.periodic(each, 30.0, "radau", steps=384, rtol=1e-9) for each in (full, reduced))
    q = reduced.expanded(PHASE, 30.0, other.at(PHASE)).q
    np.testing.assert_allclose(q, one.at(PHASE), rtol=0, atol=1e-9 * np.abs(q).max())
    np.testing.assert_allclose(other.multipliers[:6], one.multipliers[:6], rtol=0, atol=1e-9)
    assert (other.reduction_error.orbit, other.reduction_error.multipliers) < (1e-12, 1e-12)
    assert other.verdict == one.verdict
    for name in ("O_moment", "B_force_x", "coupler_midpoint_stress_plus"):
        largest = one.statistics(name).max_abs
        assert other.statistics(name).max_abs == pytest.approx(largest, rel=1e-8)


def test_welded_frame_with_all_modes_has_unchanged_frequencies():
    """Two links share a rotation. There is a mass at the free end of the second link."""
    links = [("a", "O", "A", "", "corner"), ("b", "A", "B", "corner", "b_B")]
    frame = beams(links, ["O"], [1.0, 0.7], [0.3, 1.4], counts=[3, 2], masses={"B": 0.5})
    positions = Positions(frame, np.zeros(1))
    motion = Motion(frame, lambda phase: (np.zeros((len(phase), 2)),) * 2, 2 * np.pi, "full", "off", "modal")
    M, K = (part[0] for part in positions.matrices())
    for modes, rtol in ((6, 1e-9), (3, 1e-3)):
        reduced = ReducedMotion(motion, basis(frame, modes))
        assert [name for name, *_ in reduced.basis.declared][:4] == ["A_x", "A_y", "corner_turn", "B_x"]
        M_r, K_r = (part[0] for part in reduced.matrices(positions))
        few = np.sqrt(eigh(K_r, M_r, eigvals_only=True)[:4])
        whole = np.sqrt(eigh(K, M, eigvals_only=True)[:4])
        np.testing.assert_allclose(few, whole, rtol=rtol)
        T = reduced.basis.at(positions)[0]
        np.testing.assert_allclose(T.T @ M @ T, M_r, atol=1e-12)


def true_errors(full, reduced, speed, rtol=1e-5):
    """Return the errors of coordinates, multipliers and some outputs relative to the full system."""
    truth, own = (solve.periodic(each, speed, rtol=rtol) for each in (full, reduced))
    q, ours = truth.at(PHASE), reduced.expanded(PHASE, speed, own.at(PHASE)).q
    rho, other = (
        truth.certified.solutions.multipliers.values[0],
        own.certified.solutions.multipliers.values[0],
    )
    distance = np.abs(other[:, None] - rho)
    moved = distance[linear_sum_assignment(distance)].max() / abs(rho[0])
    outputs = {}
    for name in full.outputs:
        values, exact = (each.signal(name)(PHASE) for each in (own, truth))
        outputs[name] = np.abs(values - exact).max() / np.abs(exact).max()
    return own, (np.abs(ours - q).max(axis=1) / np.abs(q).max(axis=1)).max(), moved, outputs


@pytest.mark.parametrize(
    ("speed", "options"),
    [
        (12.0, {}),
        (33.0, {"terms": "full"}),
        # At a quarter of the lowest frequency.
        (41.2, {"stiffening": "on"}),
        (83.0, {}),
    ],
)
def test_error_estimate_is_within_a_factor_of_two(speed, options):
    own, orbit, multipliers, outputs = true_errors(four_bar(3, **options), four_bar(3, 2, **options), speed)
    computed = own.reduction_error
    assert 1e-3 < orbit < 0.1
    assert orbit < 2 * computed.orbit < 6 * orbit
    assert multipliers < 2 * computed.multipliers < 6 * multipliers
    for name, error in outputs.items():
        assert error < 2 * computed.outputs[name] < 6 * error, name


@pytest.mark.slow
@pytest.mark.parametrize("elements", [3, 5])
@pytest.mark.parametrize("modes", [1, 2, 3])
def test_error_estimate_holds_over_a_range_of_speeds(elements, modes):
    full, reduced = four_bar(elements), four_bar(elements, modes)
    for speed in (10, 17, 25, 33.3, 41.2, 55.6, 70, 78, 90):
        own, orbit, multipliers, _ = true_errors(full, reduced, float(speed), 1e-7)
        computed = own.reduction_error
        assert orbit < 1.5 * computed.orbit < 3 * orbit, speed
        assert multipliers < 1.5 * computed.multipliers < 8 * multipliers, speed


@pytest.mark.parametrize(("modes", "speed"), [(2, 33.0), (3, 47.0)])
def test_errors_of_single_multipliers_include_the_reduction(modes, speed):
    """Small multipliers belong to fast modes, which a reduction changes most."""
    truth, own = (solve.floquet(each, speed, rtol=1e-6) for each in (four_bar(3), four_bar(3, modes)))
    estimates = own.spectrum.errors
    is_known = ~np.isnan(estimates)
    distances = log_distances(own.spectrum.logarithms, truth.spectrum.logarithms)
    errors = distances[linear_sum_assignment(distances)]
    assert own.unresolved > 0
    assert is_known.sum() >= 8
    assert (errors[is_known] < estimates[is_known]).all()
    assert (estimates[is_known] < 20 * errors[is_known]).all()


def test_frequency_errors_are_relative_to_the_full_system():
    positions = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    full, reduced = four_bar(4), four_bar(4, 2)
    own, exact = (each.frequencies(positions, reduced.n) for each in (reduced, full))
    compared = exact < reduced.discarded / 2
    assert compared.sum(axis=1).min() >= 3
    error = np.abs(own / exact - 1)[compared].max()
    assert reduced.frequency_error == pytest.approx(error, rel=0.02)
    assert f"{reduced.frequency_error:.1e}" in reduced.warnings(30.0)[0]


def test_verdict_includes_the_reduction_error():
    """Without damping, multipliers lie on the unit circle. A small perturbation may move them off the
    circle."""
    speed, undamped = 60.0, {"terms": "full"}
    full, reduced = (
        solve.load("four_bar", options={"elements": 1, **undamped}, reduce=modes, zeta=0)
        for modes in (None, 1)
    )
    assert solve.floquet(full, speed, rtol=1e-7).verdict == "stable"
    stability = solve.floquet(reduced, speed, rtol=1e-7)
    assert stability.reduction_error.multipliers > 1e-3
    assert stability.verdict == "undetermined"
    assert np.isnan(stability.reduction_error.orbit)


def test_physical_coordinates_come_before_modal_coordinates():
    model = four_bar(3, 2)
    assert model.coordinates[:4] == ("A_x", "A_y", "B_x", "B_y")
    assert model.coordinates[4:6] == ("crank_mode_1", "crank_mode_2")
    assert (model.labels.units["coupler_mode_1"], model.labels.units["A_x"]) == ("m", "m")
    orbit = solve.periodic(model, 30.0, rtol=1e-6)
    q, freedoms = orbit.at(PHASE), model.beams.freedoms.names
    expanded = model.expanded(PHASE, 30.0, q).q
    np.testing.assert_allclose(expanded[freedoms.index("B_y")], q[3], rtol=1e-14)
    tip = orbit.signal("crank_tip_deflection")(PHASE)
    angle = model.beams.angle(PHASE)[:, 0]
    np.testing.assert_allclose(tip, q[1] * np.cos(angle) - q[0] * np.sin(angle), atol=1e-12)
    np.testing.assert_allclose(model.deflection("crank", 1.0, PHASE, q), tip, atol=1e-12)


def test_mode_of_unit_amplitude_deflects_its_link_by_one():
    model = four_bar(4, 3)
    q = np.zeros((model.n, 1))
    q[model.coordinates.index("coupler_mode_2")] = 1.0
    along = [model.deflection("coupler", part, np.array([0.7]), q)[0] for part in np.linspace(0, 1, 201)]
    assert max(np.abs(along)) == pytest.approx(1.0, abs=1e-3)
    assert along[0] == pytest.approx(0.0, abs=1e-12)
    # Second pinned-pinned mode, nearly sin(2πx/L).
    np.testing.assert_allclose(along, np.sin(2 * np.pi * np.linspace(0, 1, 201)), atol=0.02)


def test_saved_results_contain_the_reduction_error(tmp_path):
    model = pickle.loads(pickle.dumps(four_bar(2, 2)))
    assert model.varied({"zeta": 0.05}).n == model.n == 10
    orbit = solve.periodic(model, 30.0, rtol=1e-6)
    error = orbit.record()["reduction_error"]
    assert (error["modes"], error["coordinates"], error["full"]) == (2, 10, 18)
    assert error["outputs"].keys() == set(model.outputs)
    orbit.save(tmp_path / "orbit.nc")
    assert solve.open(tmp_path / "orbit.nc").reduction_error == orbit.reduction_error
    assert "reduction_error" not in solve.periodic(four_bar(1), 30.0, rtol=1e-6).record()
    sweep = solve.sweep(model, [20.0, 30.0], rtol=1e-6)
    np.testing.assert_allclose(sweep.reductions[1], [error["orbit"], error["multipliers"]], rtol=1e-4)
    point = sweep.record()["points"][1]["reduction_error"]
    assert point["orbit"] == sweep.reductions[1, 0]
    assert any("relative errors of up to" in text for text in sweep.warnings)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["cam", "--reduce", "3"], "'reduce' requires a beam structure, but cam is not one"),
        (["four_bar", "--reduce", "3"], "reduce is 3; allowed: 1 to 2 modes per link"),
        (["four_bar", "--reduce", "0"], "allowed: a number of modes per link, 1 or more"),
        (["four_bar", "--reduce", "1", "--option", "element=dynamic"], "choose another element"),
        (["four_bar", "--reduce", "1", "--option", "reduce=1"], "give one of them"),
        (["portal_frame", "--reduce", "1"], "inextensible"),
    ],
)
def test_invalid_reductions_are_refused_in_one_line(arguments, words, capsys):
    assert run(["floquet", *arguments]) == 2
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    assert words in line


def test_loaded_model_cannot_be_reduced():
    with pytest.raises(SolveError, match="load it again with reduce"):
        four_bar(2).varied(options={"reduce": 1})


def test_command_states_the_reduction_error(capsys):
    given = ["four_bar", "--option", "elements=2", "--reduce", "2", "--speed", "30 rad/s", "--rtol", "1e-6"]
    assert run(["periodic", *given, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    error = record["reduction_error"]
    assert 1e-4 < error["orbit"] < 0.1
    assert record["options"]["reduce"] == 2
    assert run(["floquet", *given]) == 0
    out = capsys.readouterr()
    assert f"reduced  10 of 18 coordinates: multipliers {error['multipliers']:.1e}" in out.out
    assert "reduction ±" in out.out
    assert "natural frequencies below" in out.err


@pytest.mark.filterwarnings("error")
def test_reduction_errors_of_vanishing_multipliers_cause_no_overflow():
    """At a low speed, the multipliers of damped modes are below 1e-308 of the largest."""
    stability = solve.floquet(solve.load("four_bar", reduce=1), "0.4 rad/s", rtol=1e-3)
    errors = stability.multiplier_errors
    assert np.isnan(errors).sum() > len(errors) / 2
