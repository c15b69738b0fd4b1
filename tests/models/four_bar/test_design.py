"""The design method: results, command, and errors."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

import solve
from models.four_bar.design import damping_effects, designed, plan_to_last
from models.four_bar.design_map import DesignError, allowed_lengths, checked_allowable, design_map
from models.four_bar.linkage import Linkage
from models.four_bar.studies.design import carry_out
from solve.errors import MissingValueError, UnknownNameError, ValueOutOfBoundsError
from solve.terminal import progress

LINKS = ("crank", "coupler", "follower")
SMALL = ("--speeds", "24:28:8 rad/s", "--L4", "0.53:0.63:5 m", "--time", "1 s")
KEYS = {
    "model", "case", "parameters", "options", "allowable", "speeds", "L4", "own_L4", "stress", "error",
    "interpolation_error",
    "limiting", "critical", "quiet", "quiet_of", "beyond", "least_ratio", "damping", "target", "returns",
    "least", "smallest_allowable", "verdict", "text", "plan", "trials", "safe_acceleration", "warnings",
}  # fmt: skip


def design_for(stress=100e6, speeds=(20.0, 33.0), lengths=(0.53, 0.63), **parameters):
    model = solve.load("four_bar", **parameters)
    start = np.geomspace(*speeds, 10)
    return designed(design_map(model, dict.fromkeys(LINKS, stress), start, lengths, 9))


def planned(design, target):
    """Plan to a target, without return of the pivot."""
    return plan_to_last(design.map.until(target), design.rate, False)


@pytest.fixture(scope="module")
def design():
    return design_for()


def test_length_limits_follow_from_the_transmission_angle():
    low, high = allowed_lengths(Linkage(0.170, 0.328, 0.525, 0.547))
    assert math.degrees(Linkage(0.170, 0.328, 0.525, low).transmission_extremes().min) == pytest.approx(40)
    assert math.degrees(Linkage(0.170, 0.328, 0.525, high).transmission_extremes().max) == pytest.approx(140)
    with pytest.raises(DesignError, match="no pivot position is possible"):
        design_for(lengths=(0.547, 0.547))
    with pytest.raises(DesignError, match="no L4 keeps"):
        allowed_lengths(Linkage(0.3, 0.328, 0.525, 0.547))


def test_peaks_and_quiet_bands_match_single_solutions(design):
    """At the mechanism's own L4, the result is compared with single solutions at the divisions 7 and 6 of the
    mean frequency and next to them."""
    assert [peak.speed for peak in design.peaks][-2:] == pytest.approx([26.1, 30.4], abs=0.15)
    model = design.map.model
    edge = design.quiet[0].end
    names = [
        f"{place}_stress_{side}"
        for place in ("crank_root", "follower_midpoint")
        for side in ("plus", "minus")
    ]
    for speed, above in ((0.99 * edge, False), (1.01 * edge, True)):
        orbit = solve.periodic(model, speed, rtol=1e-6)
        assert (max(orbit.statistics(name).max_abs for name in names) > 100e6) == above
    assert design.quiet[0].start == 0.0
    assert len(design.limiting) == 2


def test_effect_of_damping_agrees_with_finite_differences(design):
    (computed,) = damping_effects(design.map, np.array([26.1]))
    orbits = [
        solve.periodic(design.map.model.varied({"zeta": zeta}), 26.1, rtol=1e-6) for zeta in (0.0195, 0.0205)
    ]
    for link, name in (("crank", "crank_root"), ("follower", "follower_midpoint")):
        before, after = (
            max(orbit.statistics(f"{name}_stress_{side}").max_abs for side in ("plus", "minus"))
            for orbit in orbits
        )
        slope = math.log(after / before) / math.log(205 / 195)
        assert computed.sensitivity[link] == pytest.approx(slope, abs=0.06)


def test_moving_the_pivot_never_increases_the_required_stress(design):
    needed = design.needed
    assert (needed.moving <= needed.returning).all()
    assert (needed.returning <= needed.fixed).all()
    assert (needed.moving[-10:] < 0.8 * needed.fixed[-10:]).all()


def test_simulated_plan_remains_below_allowable_stress(design):
    outcome = carry_out(design, 29.0, duration=8.0)
    assert outcome.plan is not None
    assert not outcome.returns
    assert outcome.trials[0].worst < 1
    assert outcome.trials[0].worst == pytest.approx(outcome.steady.max(), rel=0.03)
    assert outcome.safe_acceleration is not None
    assert outcome.least[0] < 1 < outcome.least[1]


@pytest.mark.slow
def test_smallest_allowable_stress_separates_plan_from_no_plan(design):
    outcome = carry_out(design, 33.0)
    assert outcome.plan is None
    assert outcome.trials == []
    assert outcome.least[0] > 1
    assert "no plan exists" in outcome.text
    assert f"{100 * outcome.least[0]:.4g} MPa" in outcome.text
    highest = float(re.findall(r"up to ([\d.]+) rpm the allowable", outcome.text)[0]) * math.pi / 30
    assert planned(design, highest - 0.01) is not None
    assert planned(design, highest + 0.5) is None
    # Just above this allowable stress a plan exists, just below none.
    for factor, exists in ((1.005, True), (0.995, False)):
        scaled = design_for(100e6 * outcome.least[0] * factor)
        assert (planned(scaled, 33.0) is not None) == exists


def test_infeasibility_within_the_map_error_is_not_claimed(design):
    """At the largest L4, a ratio 1 % above 1 cannot be distinguished from 1 by a map with an error of 2 %."""
    outcome = carry_out(design, 33.0)
    assert design.map.error_until(33.0) == max(design.map.interpolation_error, design.map.error.max())
    near = dataclasses.replace(outcome, least=(1 + 0.5 * design.map.error_until(33.0), outcome.least[1]))
    assert "no plan was found" in near.text
    assert "no plan exists" not in near.text


def test_progress_is_reported_during_the_map():
    reported = []

    def listen(tracker):
        task = tracker.tasks[0]
        if task.what == "speeds of the stress map" and task.done:
            reported.append((task.done, task.total))

    model = solve.load("four_bar")
    start = np.linspace(8.0, 8.05, 12)
    with progress.listen(listen):
        design_map(model, dict.fromkeys(LINKS, 1e8), start, (0.53, 0.63), 9)
    assert list(dict.fromkeys(reported))[:2] == [(8, 12), (12, 12)]


@pytest.mark.slow
def test_worst_link_determines_the_effect_of_damping(design):
    """The worst link is determined by the ratio to the allowable stress, not by the stress: here it is a weak
    coupler."""
    model = design.map.model
    weak = design_map(
        model, {"crank": 1e9, "coupler": 5e7, "follower": 1e9}, np.geomspace(8, 26, 20), (0.53, 0.63), 9
    )
    assert {weak.worst_link(float(speed)) for speed in weak.speeds} == {"coupler"}
    assert design.map.worst_link(float(design.map.speeds[-1])) == "crank"


@pytest.mark.slow
def test_default_target_is_above_a_limiting_speed_if_reachable():
    """With 118 MPa, the quiet speed above 26.1 rad/s is reachable with the pivot back in its initial
    position."""
    outcome = carry_out(design_for(118e6, speeds=(8.0, 28.0)), duration=4.0)
    assert outcome.returns
    assert 26.3 < outcome.target < 28.0
    assert outcome.design.needed.fixed[-1] > 1
    assert outcome.trials[0].worst < 1
    assert outcome.trials[0].simulated.L4[-1] == pytest.approx(0.547)


@pytest.mark.slow
def test_coarse_initial_speeds_lead_to_the_same_map(design):
    """Intervals are bisected until narrow peaks between the initial speeds are resolved."""
    model = solve.load("four_bar")
    start = np.geomspace(8.0, 33.0, 7)
    coarse = designed(design_map(model, dict.fromkeys(LINKS, 100e6), start, (0.53, 0.63), 9))
    assert coarse.map.interpolation_error < 0.01
    assert [peak.speed for peak in coarse.limiting] == pytest.approx(
        [peak.speed for peak in design.limiting], rel=2e-3
    )
    between = np.exp(
        np.interp(np.log(design.map.speeds), np.log(coarse.map.speeds), np.log(coarse.map.own_ratio))
    )
    assert between == pytest.approx(design.map.own_ratio, rel=0.03)


def test_json_has_the_promised_keys(answer):
    out, _ = answer("design", "--allowable", "crank=100 MPa,coupler=90MPa,follower=100 MPa", "--json", *SMALL)
    record = json.loads(out)
    assert set(record) >= KEYS
    assert record["allowable"] == {"crank": 100e6, "coupler": 90e6, "follower": 100e6}
    assert np.shape(record["stress"]["crank"]) == (len(record["speeds"]), len(record["L4"]))
    assert record["verdict"] == "plan"
    assert record["plan"]["speed"][-1] == record["target"]
    assert record["trials"][0]["greatest_ratio"] < 1


def test_design_is_saved_in_every_file_format(design, tmp_path):
    xarray = pytest.importorskip("xarray")
    outcome = carry_out(design, 29.0, duration=2.0)
    for ending in ("npz", "csv", "mat", "nc"):
        outcome.save(tmp_path / f"design.{ending}")
    with xarray.open_dataset(tmp_path / "design.nc", engine="h5netcdf") as kept:
        np.testing.assert_array_equal(kept["least_ratio_moving"], design.needed.moving)
        record = json.loads(kept.attrs["metadata"])
    assert (record["returns"], record["target"]) == (False, 29.0)
    np.testing.assert_allclose(record["stress"]["crank"], design.map.stress[:, :, 0])


@pytest.mark.slow
def test_buckling_compression_raises_a_warning():
    """A slender coupler has the Euler load π²EI/L²."""
    model = solve.load("four_bar", options={"stiffening": "on"}, I2=3e-12)
    start = np.geomspace(20.0, 28.0, 12)
    outcome = carry_out(
        designed(design_map(model, dict.fromkeys(LINKS, 5e9), start, (0.54, 0.56), 5)), 28.0, duration=0.5
    )
    euler = math.pi**2 * 210e9 * 3e-12 / 0.328**2
    assert any("link coupler" in text and f"Euler load of {euler:.4g} N" in text for text in outcome.warnings)


@pytest.mark.slow
def test_report_fits_a_terminal_and_files_are_written(answer, tmp_path):
    picture, data = tmp_path / "design.png", tmp_path / "design.npz"
    files = ("--plot", str(picture), "--save", str(data))
    out, _ = answer("design", "--allowable", "100 MPa", *SMALL, *files)
    assert max(map(len, out.splitlines())) <= 80
    assert "a plan exists" in out
    assert picture.stat().st_size > 20_000
    with np.load(data) as saved:
        assert saved["stress"].shape == (len(saved["speed"]), len(saved["L4"]), 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "no allowable stress given"),
        (("--allowable", "100"), "has no unit"),
        (("--allowable", "-5 MPa"), "is -5 MPa; allowed: finite, > 0"),
        (("--allowable", "100 kg"), "does not convert to 'Pa'"),
        (("--allowable", "crank=100 MPa"), "no allowable stress for coupler, follower"),
        (("--allowable", "crnk=100 MPa"), "did you mean 'crank'"),
        (("--allowable", "crank=1 MPa,crank=2 MPa"), "crank twice"),
        (("--allowable", "100 MPa", "--L4", "0.5:0.9:10 m"), "cannot turn fully"),
        (("--allowable", "100 MPa", "--L4", "0.58:0.6 m"), "own L4, 0.547 m, is not between"),
        (("--allowable", "100 MPa", "--L4", "0.58 m"), "write"),
        (("--allowable", "100 MPa", "--L4", "0.547:0.547:9 m"), "A below B"),
        (("--allowable", "100 MPa", "--L4", "0.53:0.63:1000000 m"), "N from 2 to 200"),
        (("--allowable", "100 MPa", "--target", "30"), "has no unit"),
        (("--allowable", "100 MPa", "--target", "90 rad/s", *SMALL), "widen --speeds"),
        (("--allowable", "100 MPa", "--speeds", "6:7:2 rad/s"), "5 different speeds"),
        (("--allowable", "100 MPa", "--set", "zeta=0"), "zeta is 0"),
        (("--allowable", "100 MPa", "--time", "0 s"), "--time is 0 s"),
        (("--allowable", "100 MPa", "--target", "900 rpm"), "the target, 900 rpm, is not between"),
        (("--allowable", "100 MPa", "--target", "900 rpm", *SMALL), "94.25 rad/s, is not between 24 and 28"),
        (("--allowable", "0.01 MPa", "--speeds", "8:9:5 rad/s", *SMALL[2:]), "times the allowable one"),
        (("--allowable", "0.01 MPa", "--speeds", "80:90:5 rpm", *SMALL[2:]), "at 80 rpm, the lowest"),
        (("--allowable", "100 MPa", "--option", "element=dynamic"), "without equations of motion"),
    ],
)
def test_error_messages_have_one_line(arguments, message, refusal):
    assert message in refusal("design", *arguments)


def test_allowable_stresses_are_checked():
    with pytest.raises(UnknownNameError):
        checked_allowable(list(LINKS), {"rod": 1e8})
    with pytest.raises(ValueOutOfBoundsError):
        checked_allowable(list(LINKS), dict.fromkeys(LINKS, math.nan))
    with pytest.raises(MissingValueError):
        checked_allowable(list(LINKS), {"crank": 1e8})
