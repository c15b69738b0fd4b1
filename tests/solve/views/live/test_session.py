"""Replies of a window to messages of its page."""

import json
import math
import pickle
import struct

import numpy as np
import pytest

import solve
from solve.equations import sketched
from solve.views.live.survey import Survey
from solve.views.live.texts import Origin
from tests.solve.views.live.conftest import Window


def test_curves_and_statistics_are_those_of_the_orbit(window):
    cam = window("cam", "300 rpm")
    found = cam.solution(speed="310 rpm", values={"k1": "90 kN m/rad"}, shown=["q1", "contact_force"])
    orbit = solve.periodic(solve.load("cam", k1=9e4), "310 rpm")
    assert (found["verdict"], found["warnings"]) == (orbit.verdict, orbit.warnings)
    assert found["radius"] == orbit.spectral_radius
    factors = {"mrad": 1e3, "kN": 1e-3}
    for curve in found["curves"]:
        phase = np.radians(np.linspace(0.0, found["span"], len(curve["values"])))
        expected = factors[curve["unit"]] * orbit.signal(curve["name"])(phase)
        assert curve["values"] == pytest.approx(expected.tolist(), rel=1e-4, abs=1e-4 * abs(expected).max())
        amplitudes = factors[curve["unit"]] * orbit.harmonics(curve["name"])[0]
        assert curve["spectrum"] == pytest.approx(amplitudes[: len(curve["spectrum"])].tolist(), rel=1e-4)
    json.dumps(found, allow_nan=False)


def test_oscillator_has_its_closed_form_response(spring):
    model = solve.load(spring)
    found = Window(model).solution(speed="4 rad/s", values={"F": "20"}, shown=["q"])
    largest = 20 / math.hypot(50 - 2 * 16, 1 * 4)
    (curve,) = found["curves"]
    assert max(curve["values"]) == pytest.approx(largest / (1e-3 if curve["unit"] == "mm" else 1), rel=1e-4)


def test_motion_follows_with_the_points_of_the_sketch(window):
    cam = window("cam", "300 rpm")
    cam.solution(shown=["q1"], scale=7)
    at = next(k for k, message in enumerate(cam.sent) if message["is"] == "motion")
    message, points = cam.sent[at], cam.points[at]
    assert message["scale"] == 7
    orbit = solve.periodic(solve.load("cam"), "300 rpm")
    names = [line["name"] for line in message["lines"]]
    assert names == list(sketched(orbit.system, np.zeros(1), orbit.speed, np.zeros((3, 1))))
    values = np.array(struct.unpack(f"<{len(points) // 4}f", points))
    start = 0
    phase = np.arange(message["frames"]) * (2 * np.pi / message["frames"])
    moved = sketched(orbit.system, phase, orbit.speed, 7 * orbit.at(phase), 0.25)
    for line in message["lines"]:
        size = 2 * line["points"] * message["frames"]
        pairs = values[start + size : start + 2 * size].reshape(message["frames"], line["points"], 2)
        places = pairs[..., 0] + 1j * pairs[..., 1]
        assert np.abs(places - moved[line["name"]].T).max() < 1e-6
        start += 2 * size
    assert start == len(values)


def test_free_vibration_is_shown_without_a_load(window):
    found = window("mathieu").solution(values={"delta": "2.25", "epsilon": "0", "zeta": "0"}, shown=["q"])
    assert found["free"]
    phase = np.radians(np.linspace(0.0, found["span"], len(found["curves"][0]["values"])))
    assert found["curves"][0]["values"] == pytest.approx(np.cos(1.5 * phase).tolist(), abs=1e-4)


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        ({"values": {"k1": "-1"}}, "k1 (torsional stiffness of the shaft) is -1 N m/rad; allowed: > 0"),
        ({"values": {"k1": "3 m"}}, "unit 'm' does not convert to 'N m/rad'"),
        ({"values": {"k9": "1"}}, "unknown parameter of cam 'k9'"),
        ({"speed": "-3 rpm"}, "speed is -3 rpm"),
        ({"shown": ["q9"]}, "unknown coordinate or output of cam 'q9'"),
        ({"rtol": "x"}, "rtol is 'x'"),
        ({"rtol": "2"}, "rtol is 2.0"),
    ],
)
def test_error_is_one_sentence_and_the_window_continues(window, message, sentence):
    cam = window("cam", "300 rpm")
    found = cam.solution(**{"shown": ["q1"], **message})
    assert found["is"] == "fault"
    assert sentence in found["message"]
    assert cam.solution(shown=["q1"], values={}, speed="300 rpm")["is"] == "solution"


def test_impossible_linkage_is_reported_as_a_model_error(window):
    found = window("coupler").solution(values={"l2": "2 m"}, shown=["q1"])
    assert found["is"] == "fault"
    assert "the crank cannot turn fully" in found["message"]


def test_newer_request_replaces_an_older_one(window):
    cam = window("cam", "300 rpm")
    cam.session.replace(5)
    assert [each["is"] for each in cam.ask("solve", number=4, shown=["q1"])] == ["replaced"]
    assert cam.ask("solve", number=5, shown=["q1"])[0]["is"] == "solution"


def test_command_includes_nonlinear_orbit_and_tolerance(window):
    found = window("cam", "100 rpm").solution(shown=["q1"], nonlinear=True, rtol="1e-5")
    assert found["command"].endswith('--speed "100.0 rpm" --nonlinear --rtol 1e-05'.replace("100.0", "100"))
    assert 'solve.nonlinear(model, "100 rpm", rtol=1e-05)' in found["python"]
    orbit = solve.nonlinear(solve.load("cam"), "100 rpm", rtol=1e-5)
    factor = {"mrad": 1e3}[found["curves"][0]["unit"]]
    assert max(found["curves"][0]["values"]) == pytest.approx(factor * orbit.statistics("q1").max, rel=1e-3)


def test_validated_value_has_the_unit_of_its_slider(window):
    cam = window("cam", "300 rpm")
    assert cam.ask("check", name="k1", text="90 kN m/rad") == [
        {"is": "checked", "name": "k1", "value": 9e4, "text": "90 kN m/rad"}
    ]
    (refused,) = cam.ask("check", name="k1", text="soft")
    assert refused["is"] == "refused"
    assert "k1 is 'soft'" in refused["message"]


def test_sweep_equals_single_orbits(window):
    cam = window("cam", "300 rpm")
    request = {"x": {"name": "k1", "low": 7e4, "high": 9e4, "count": 3}, "of": "q3.max_abs"}
    found = cam.session.survey({**request, "speed": "310 rpm", "values": {"c1": "20"}}).run()
    assert found["x"]["values"] == [7e4, 8e4, 9e4]
    for k1, value in zip(found["x"]["values"], found["values"], strict=True):
        orbit = solve.periodic(solve.load("cam", k1=k1, c1=20), "310 rpm")
        assert value == pytest.approx(1e6 * orbit.statistics("q3").max_abs, rel=1e-3)
    assert found["label"] == "max|q3| (µm)"


def test_limits_of_a_sweep_have_units(window):
    cam = window("cam", "300 rpm")
    limits = {"name": "speed", "low": "5 Hz", "high": "320", "count": "3", "logarithmic": True}
    survey = cam.session.survey({"x": limits, "of": "spectral_radius"})
    assert survey.x.values == pytest.approx([300, (300 * 320) ** 0.5, 320])
    limits = {"name": "k1", "low": "80 kN m/rad", "high": "9e4", "count": 2}
    assert cam.session.survey({"x": limits, "of": "spectral_radius"}).x.values.tolist() == [8e4, 9e4]


def test_chart_has_verdicts_and_boundaries(window):
    mathieu = window("mathieu")
    axes = {
        "x": {"name": "delta", "low": 0.5, "high": 1.5, "count": 5},
        "y": {"name": "epsilon", "low": 0.2, "high": 1.0, "count": 3},
    }
    found = mathieu.session.survey({**axes, "of": "spectral_radius", "values": {"zeta": "0"}}).run()
    assert len(found["values"]) == len(found["verdicts"]) == 15
    # δ = 1 is the centre of the first tongue, δ = 1.5 at ε = 0.2 is outside.
    assert found["verdicts"][2] == "unstable"
    assert found["verdicts"][4] != "unstable"
    assert found["boundaries"]


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        ({"x": {"name": "k9", "low": 1, "high": 2, "count": 3}}, "unknown parameter of cam 'k9'"),
        (
            {"x": {"name": "k1", "low": 2, "high": 1, "count": 3}},
            "k1 ranges from 2 to 1; give two different values, the smaller first",
        ),
        (
            {"x": {"name": "k1", "low": 1, "high": 2, "count": 1}},
            "points of k1 is 1; allowed: whole numbers 2 … 2000",
        ),
        (
            {"x": {"name": "k1", "low": "soft", "high": 2, "count": 3}},
            "k1 is 'soft'; give a number, in N m/rad unless a unit follows",
        ),
        (
            {"x": {"name": "speed", "low": 0, "high": 2, "count": 3}},
            "speed is 0 rpm; allowed: finite and > 0",
        ),
        ({"x": {"name": "k1", "low": 1, "high": 2, "count": "2.5"}}, "is 2.5; allowed: whole numbers 2"),
        ({"x": {"name": "k1", "low": 1, "high": 2, "count": 3}, "of": "q9.max"}, "unknown quantity of cam"),
    ],
)
def test_impossible_sweep_is_refused_before_it_begins(window, request_, sentence):
    with pytest.raises(solve.SolveError) as refusal:
        window("cam", "300 rpm").session.survey({"of": "q1.max_abs", **request_})
    assert sentence in str(refusal.value)


def test_sweep_request_can_be_sent_to_another_process(window):
    request = {"x": {"name": "speed", "low": 300, "high": 310, "count": 2}, "of": "spectral_radius"}
    survey = window("cam", "300 rpm").session.survey(request)
    again = pickle.loads(pickle.dumps(survey))
    assert isinstance(again, Survey)
    assert again.run()["values"] == survey.run()["values"]


def test_save_request_receives_a_reply(window, folder):
    cam = window("cam", "300 rpm")
    (saved,) = cam.ask("save", case="mine", file="cam_cases.toml", values={"k1": "9e4"}, speed="310 rpm")
    assert saved["is"] == "saved"
    assert solve.case_numbers("cam", "mine", "cam_cases.toml").parameters["k1"] == 9e4
    (refused,) = cam.ask("save", case="mine", file="cam_cases.toml")
    assert refused["is"] == "not saved"


def test_model_in_memory_has_no_command(window):
    model = solve.load("mathieu")
    found = Window(model, None, Origin()).solution(shown=["q"])
    assert found["command"] == ""
    assert "solve.periodic(model" in found["python"]
