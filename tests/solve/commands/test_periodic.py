"""Output of `solve periodic` and `solve floquet`."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

KEYS = {
    "model", "case", "parameters", "options", "speed", "period", "method", "steps", "coordinates", "outputs",
    "multipliers", "unresolved", "exponents", "spectral_radius", "verdict", "stable", "error_estimate",
    "residual", "warnings",
}  # fmt: skip
QUANTITY = {"unit", "max", "min", "max_abs", "mean", "harmonics", "phases"}


def record(ran):
    assert ran.status == 0, ran.err
    return json.loads(ran.out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_json_has_the_documented_keys(command):
    computed = record(command("periodic", "manipulator", "--json"))
    assert computed.keys() >= KEYS
    assert computed["error_estimate"].keys() == {"orbit", "multipliers"}
    assert list(computed["coordinates"]) == ["q1", "q2"]
    assert "load_torque" in computed["outputs"]
    for quantity in (*computed["coordinates"].values(), *computed["outputs"].values()):
        assert quantity.keys() >= QUANTITY
        assert len(quantity["harmonics"]) == len(quantity["phases"]) == 61


def test_json_contains_the_published_manipulator_results(command):
    computed = record(command("periodic", "manipulator", "--json", "--rtol", "1e-9"))
    assert computed["speed"] == pytest.approx(50 * math.pi / 30, rel=1e-14)
    assert computed["period"] == pytest.approx(1.2, rel=1e-14)
    assert computed["coordinates"]["q1"]["max_abs"] == pytest.approx(0.03163246, abs=0.5e-8)
    assert computed["coordinates"]["q2"]["max_abs"] == pytest.approx(1.313046e-3, abs=0.5e-9)
    assert computed["spectral_radius"] == pytest.approx(0.0019966777, rel=1e-6)
    moduli = [math.hypot(*pair) for pair in computed["multipliers"]]
    assert moduli == sorted(moduli, reverse=True)
    assert moduli[0] == pytest.approx(computed["spectral_radius"], rel=1e-12)
    assert computed["multipliers"][0][1] > 0 > computed["multipliers"][1][1]
    aligned = "multipliers", "multiplier_errors", "exponents", "modes"
    assert [len(computed[name]) for name in aligned] == [4] * 4
    assert computed["unresolved"] == computed["multiplier_errors"].count(None)
    exponent = complex(*computed["exponents"][0])
    assert np.exp(exponent * computed["period"]) == pytest.approx(
        complex(*computed["multipliers"][0]), rel=1e-12
    )
    assert computed["verdict"] == "asymptotically stable"
    assert computed["stable"] is True


def test_harmonics_with_phases_sum_to_the_extrema(command):
    computed = record(command("periodic", "manipulator", "--json", "--harmonics", "200"))
    for name, quantity in {**computed["coordinates"], **computed["outputs"]}.items():
        amplitudes, phases = np.array(quantity["harmonics"]), np.array(quantity["phases"])
        assert len(amplitudes) == 201
        phi = np.linspace(0.0, 2 * math.pi, 20_001)
        curve = (amplitudes * np.cos(np.outer(phi, np.arange(201)) + phases)).sum(axis=1)
        for figure, extreme in (("max", curve.max()), ("min", curve.min())):
            assert extreme == pytest.approx(quantity[figure], abs=2e-6 * quantity["max_abs"]), (name, figure)
            # Equal extremes a half turn apart are both right.
            there = np.interp(quantity[f"{figure}_phase"], phi, curve)
            assert there == pytest.approx(extreme, abs=2e-6 * quantity["max_abs"]), (name, figure)
        assert amplitudes[0] == pytest.approx(quantity["mean"], abs=1e-12 * quantity["max_abs"])


def test_quasi_static_solution_omits_inertia_of_the_deviations(command):
    """The equations are chapter (77), in which the second row is uncoupled: K11 q1 = d1, then k2 q2 = d2 -
    K21 q1, with F = 0."""
    computed = record(command("periodic", "manipulator", "--json", "--quasi-static"))
    a = {1: 0.22165, 3: 0.05560, 5: -0.01706}
    k1, k2, m2, omega = 7692.0, 1e6, 136.0, 50 * math.pi / 30
    phi = np.linspace(0.0, 2 * math.pi, 100_001)
    u1 = sum(ak * np.cos(k * phi) for k, ak in a.items())
    u2 = sum(-k * ak * np.sin(k * phi) for k, ak in a.items())
    u3 = sum(-(k**2) * ak * np.cos(k * phi) for k, ak in a.items())
    q1 = -m2 * omega**2 * u1 * u2 / (k1 + m2 * omega**2 * (u1 * u3 + u2**2))
    q2 = -m2 * omega**2 * (u2 + u3 * q1) / k2
    statics = computed["quasi_static"]["coordinates"]
    assert statics["q1"]["max"] == pytest.approx(q1.max(), rel=1e-7)
    assert statics["q2"]["min"] == pytest.approx(q2.min(), rel=1e-7)
    assert "quasi_static" not in record(command("periodic", "manipulator", "--json"))


def test_flags_are_passed_to_the_model(command):
    plain = record(command("periodic", "gear_pair", "--json"))
    assert plain["case"] == "1"
    assert plain["speed"] == pytest.approx(60 * math.pi, rel=1e-14)
    assert plain["options"] == {"load": "tracking"}
    other = record(
        command(
            "periodic", "gear_pair", "--json", "--case", "2", "--speed", "25 Hz", "--option", "load=constant",
            "--set", "zeta=0.03", "--set", "q0=2e-5", "--method", "radau", "--order", "5", "--rtol", "1e-6",
        )
    )  # fmt: skip
    assert other["case"] == "2"
    assert other["speed"] == pytest.approx(50 * math.pi, rel=1e-14)
    assert other["options"] == {"load": "constant"}
    assert other["parameters"]["zeta"] == 0.03
    assert other["parameters"]["q0"] == 2e-5
    assert other["parameters"]["e1"] != plain["parameters"]["e1"]
    assert other["method"] == "radau"
    assert other["error_estimate"]["orbit"] <= 1e-6


def test_user_case_file_is_read(command, tmp_path):
    known = record(command("periodic", "manipulator", "--json"))
    units = {"I0": "kg m^2", "I1": "kg m^2", "m2": "kg", "k1": "N m/rad", "k2": "N/m", "F": "N"}
    units |= {"c1": "N m s/rad", "c2": "N s/m"}
    lines = ["[case.mine]", 'speed = "40 rpm"', "[case.mine.parameters]"]
    for name, value in known["parameters"].items():
        lines.append(f'{name} = {{ value = {value!r}, unit = "{units.get(name, "m")}", source = "copied" }}')
    (tmp_path / "mine.toml").write_text("\n".join(lines))
    computed = record(command("periodic", "manipulator", "--cases", "mine.toml", "--json"))
    assert computed["case"] == "mine"
    assert computed["parameters"] == known["parameters"]
    assert computed["speed"] == pytest.approx(40 * math.pi / 30, rel=1e-14)


def test_floquet_prints_stability_without_the_orbit(command):
    orbit = record(command("periodic", "manipulator", "--json"))
    computed = record(command("floquet", "manipulator", "--json"))
    assert computed.keys() >= KEYS - {"coordinates", "outputs"}
    assert not computed.keys() & {"coordinates", "outputs"}
    assert computed["error_estimate"]["orbit"] is None
    assert computed["residual"] is None
    assert_allclose(
        computed["multipliers"], orbit["multipliers"], rtol=0, atol=1e-8 * computed["spectral_radius"]
    )
    assert computed["verdict"] == orbit["verdict"]


def test_warnings_are_in_the_result_and_on_standard_error(command):
    ran = command("periodic", "cam", "--speed", "300 rpm", "--json")
    computed = record(ran)
    trust = [text for text in computed["warnings"] if "max|q1|" in text]
    assert len(trust) == 1
    assert "0.05" in trust[0]
    assert f"warning: {trust[0]}" in ran.err
    assert not [text for text in computed["warnings"] if "not to rtol" in text]


def test_coarse_newmark_grid_gives_a_warning(command):
    computed = record(
        command("floquet", "cam", "--speed", "100 rpm", "--method", "newmark", "--steps", "1000", "--json")
    )
    assert computed["spectral_radius"] > 100 * 1.466125e-7, (
        "the case shows nothing: the radius is nearly right"
    )
    assert any("multipliers may be wrong" in text for text in computed["warnings"])


def test_newmark_with_gamma_below_one_half_gives_a_warning(command):
    ran = command("floquet", "manipulator", "--method", "newmark", "--gamma", "0.25", "--beta", "0.166",
                  "--steps", "20000", "--json")  # fmt: skip
    assert any("gamma = 0.25 < 1/2" in text for text in record(ran)["warnings"])


@pytest.mark.parametrize("model", ["cam", "manipulator", "gear_pair"])
def test_tables_fit_80_columns(command, model):
    ran = command("periodic", model, "--speed", "600 rpm", "--quasi-static")
    assert ran.status == 0
    lines = ran.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "…" not in ran.out, "a cell is cut"
    assert lines[-1].startswith("unstable" if model == "manipulator" else "asymptotically stable")


def test_tables_show_the_published_cam_results(command):
    rows = [line.split() for line in command("periodic", "cam", "--speed", "600 rpm").out.splitlines()]
    extrema = {row[0]: row[1:] for row in reversed(rows) if len(row) > 5 and row[1] in ("mrad", "mm")}
    assert extrema["q1"][:2] == ["mrad", "768.4522"]
    assert extrema["q1"][3] == "-866.6075"
    assert extrema["q3"][:2] == ["mm", "4.860678"]
    assert extrema["q3"][3] == "-4.859140"
    strongest = next(row for row in rows if row and row[0] == "q3" and row[1].endswith(":"))
    assert strongest[1] == "59:"


def test_given_options_and_parameters_are_shown(command):
    out = command("periodic", "gear_pair", "--option", "load=constant", "--set", "zeta=0.05").out
    assert "load=constant, zeta=0.05" in out
    assert "1800 rpm" in out
    assert "33.3333 ms" in out
