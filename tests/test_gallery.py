"""Every figure of the gallery is drawn by its script or command, and one of its numbers is compared with a
closed form, a printed value or another method."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import mathieu_a

import solve
from tests import pictures
from tests.digits import half_a_digit

PICTURES = {picture.file.stem: picture for picture in pictures.pictures() if picture.page.stem == "gallery"}
SCRIPTS = sorted((pictures.ROOT / "docs" / "gallery").glob("*.py"))
MOST_LINES = 45
SLOW = {
    *("absorber", "cam_nonlinear", "column", "coupler_campbell", "duffing", "four_bar_reduced"),
    *("four_bar_stress", "ground_resonance", "impeller"),
    *("multiplier_functions", "operations"),
}


def printed(text):
    return pytest.approx(float(text), rel=0, abs=half_a_digit(text))


def meissner(script):
    """Over one second in each state, the sum of the multipliers is twice Meissner's function."""
    x, y = 3.0, 5.0
    J = np.cos(x) * np.cos(y) - (x**2 + y**2) / (2 * x * y) * np.sin(x) * np.sin(y)
    return script["trace"], pytest.approx(2 * J, rel=1e-9)


def kapitza(script):
    """With half the phase as the independent variable, the upright pendulum is Mathieu's equation with a =
    -4g/(LΩ²) and q = 2A/L."""
    g, L, A = 9.81, 0.2, 0.02
    return script["edge"], pytest.approx(np.sqrt(4 * g / (L * -mathieu_a(0, 2 * A / L))), rel=1e-7)


def column(script):
    """The lower edge of the first region of the second mode is (1 - P0/Pk) ω²/Ω² = a1(q) with q = P1 ω²/(2 Pk
    Ω²)."""
    L, mu, EI, P0, P1 = 2.0, 3.0, 500.0, 100.0, 400.0
    euler = EI * (2 * np.pi / L) ** 2
    square = euler * (2 * np.pi / L) ** 2 / mu
    edge = brentq(
        lambda w: (1 - P0 / euler) * square / w**2 - mathieu_a(1, P1 / euler * square / (2 * w**2)), 110, 126
    )
    found = [at for at, _ in script["chart"].cut(y=P1).crossings]
    return min(found, key=lambda at: abs(at - edge)), pytest.approx(edge, rel=1e-7)


def multipliers(script):
    speed = script["speeds"][500]
    return np.prod(script["rho"][500]).real, pytest.approx(np.exp(-2 * 0.05 * np.pi / speed), rel=1e-7)


def ground_resonance(script):
    largest = np.argmax(script["exact"])
    return script["growth"][largest], pytest.approx(script["exact"][largest], rel=1e-6)


def duffing(script):
    """The smaller amplitude near 1.5 rad/s results from integration by DOP853 from rest over 130 periods."""
    speeds, amplitudes = script["branches"]["falling"]
    at = np.argmin(abs(speeds - 1.5))
    period = 2 * np.pi / speeds[at]

    def flow(t, state):
        q, v = state
        return v, 0.2 * np.cos(speeds[at] * t) - 0.06 * v - q - 0.2 * q**3

    phases = np.arange(256) / 256
    last = (130 + phases) * period
    q = solve_ivp(flow, (0, last[-1]), (0, 0), "DOP853", t_eval=last, rtol=1e-9, atol=1e-12).y[0]
    return amplitudes[at], pytest.approx(2 * abs(np.mean(q * np.exp(-2j * np.pi * phases))), rel=1e-5)


def coupler_table2(script):
    return script["largest"]["q1"][-1], printed("1.8704")


def shaft_fit(script):
    fitted = script["fit"].parameters["k1"]
    assert fitted.low < 90e3 < fitted.high
    return fitted.value, pytest.approx(90e3, rel=5e-3)


def cam_nonlinear(record):
    """The reference is a transient from the linear orbit, integrated by CVODES."""
    cam = solve.load("cam", F="40 kN")
    settled = solve.transient(cam, "200 rpm", turns=8, nonlinear=True, start="orbit")
    return record["coordinates"]["q1"]["max_abs"], pytest.approx(settled.peaks[-1, 0], rel=1e-4)


def coupler_campbell(record):
    """The lowest frequency is that of a pinned beam, except for the effects of weight and of the motion of
    the mechanism."""
    row = next(row for row in record["rows"] if row["mode"] == 1)
    beam = (np.pi / 0.8) ** 2 * np.sqrt(2.1e11 * 45e-9 / (7800 * 6e-4))
    return row["order"] * row["division_at_rest"], pytest.approx(beam, rel=1e-3)


def four_bar_stress(record):
    """At its root, the crank deflects as v = αx² + βx³, so that (σ+ - σ-)/2 = -E h α. The phase is that at
    which σ+ is largest and σ- nearly smallest."""
    model = solve.load("four_bar", options={"elements": 2})
    p, orbit = model.parameters, solve.periodic(model, "30 rad/s", rtol=1e-6)
    plus, minus = (record["outputs"][f"crank_root_stress_{side}"] for side in ("plus", "minus"))
    phase, x = np.array([plus["max_phase"]]), np.array([0.1, 0.2])
    v = [model.deflection("crank", part, phase, orbit.at(phase))[0] for part in x]
    alpha, _ = np.linalg.solve(np.stack([x**2, x**3], 1), v)
    found = (plus["max"] - minus["min"]) / 2
    return found, pytest.approx(-p["E"] * p["h1"] * alpha / p["L1"] ** 2, rel=1e-4)


def manipulator_map(record):
    still = solve.load("manipulator", k1=5e3)
    other = solve.periodic(still, "50 rpm", "rk4", rtol=1e-6)
    return record["values"][0][-1], pytest.approx(other.statistics("q2").max_abs, rel=1e-6)


def manipulator_validity(record):
    """The estimated 3 % from one Newton correction is compared with the difference from the nonlinear orbit.
    The correction itself has a relative error of a few per cent."""
    model, phase = solve.load("manipulator"), np.linspace(0, 2 * np.pi, 721)
    linear, whole = (each(model, "50 rpm").at(phase)[1] for each in (solve.periodic, solve.nonlinear))
    error = record["points"][3]["linearisation_error"]["q2"]
    return error, pytest.approx(abs(whole - linear).max() / abs(linear).max(), rel=0.05)


def operations(script):
    """The steps are marched from rest. The distance is measured for each coordinate; with another norm than
    that of the multiplier's decay, the count may differ by one period."""
    marched = solve.transient(solve.load("four_bar"), "62 rad/s", turns=40, rtol=1e-4)
    return script["cycles"](0.02), pytest.approx(marched.reached, abs=1)


def absorber(script):
    """Deviations, relative to the allowed ones, from Den Hartog's fixed points, from the optimum of O.
    Nishihara and T. Asami (J. Vib. Acoust. 124 (2002) 576-582), and from equal nonlinear peaks."""
    e, F, optimum, model = script["e"], script["F"], script["optimum"], script["start"]
    root = np.sqrt(4 + 3 * e)
    k2 = (
        8 * e * (16 + 23 * e + 9 * e**2 + 2 * (2 + e) * root) / (3 * (1 + e) ** 2 * (64 + 80 * e + 27 * e**2))
    )
    c = np.sqrt(k2 * e * (8 + 9 * e - 4 * root) / (1 + e)) / 2
    speed = np.linspace(0.8, 1.2, 400_001)
    coupling = k2 + 1j * speed * c
    least = (coupling - e * speed**2) / ((1 + coupling - speed**2) * (coupling - e * speed**2) - coupling**2)
    equal = model.varied({"n1": 0.0, "k2": e / (1 + e) ** 2})
    fixed = np.sqrt((1 + np.sqrt(e / (2 + e)) * np.array([-1, 1])) / (1 + e))
    heights = np.concatenate(
        [solve.sweep(equal.varied({"c": each}), fixed).figures("x", "max_abs") for each in (0.005, 0.03)]
    )
    peaks = script["heights"]["both stiffen"]
    low, high = (peaks[part].max() for part in np.split(np.arange(len(peaks)), [44]))
    deviations = {
        "fixed points": 1e8 * (heights / (F * np.sqrt(1 + 2 / e)) - 1),
        "parameters": 1e4 * np.array([optimum.free["k2"] / k2 - 1, optimum.free["c"] / c - 1]),
        "objective": [1e6 * (optimum.objective / (F * np.abs(least).max()) - 1)],
        "equal peaks": [1e2 * (high / low - 1)],
    }
    return np.concatenate([*deviations.values()]), pytest.approx(np.zeros(8), abs=1)


def impeller(script):
    """Hand-coded matrices give the spectral radius at the highest speed. The unstable band begins just above
    it."""
    values = script["optimum"].system.parameters
    mean, half = (values["I1"] + values["I2"]) / 2, (values["I1"] - values["I2"]) / 2

    def radius(speed):
        def rates(time, flat):
            twice = 2 * speed * time
            M = np.array(
                [
                    [mean + half * np.cos(twice), half * np.sin(twice)],
                    [half * np.sin(twice), mean - half * np.cos(twice)],
                ]
            )
            change = (
                2 * speed * half * np.array([[-np.sin(twice), np.cos(twice)], [np.cos(twice), np.sin(twice)]])
            )
            gyroscopic = values["Ip"] * speed * np.array([[0, 1], [-1, 0]])
            q, qd = flat.reshape(2, 2, 4)
            force = (change + gyroscopic + values["c"] * np.eye(2)) @ qd + np.diag(
                [values["kx"], values["ky"]]
            ) @ q
            return np.concatenate((qd, -np.linalg.solve(M, force))).ravel()

        end = solve_ivp(rates, (0, 2 * np.pi / speed), np.eye(4).ravel(), rtol=1e-10, atol=1e-12).y[:, -1]
        return np.abs(np.linalg.eigvals(end.reshape(4, 4))).max()

    top = 2600 * np.pi / 30
    assert len(solve.bands(script["optimum"].system, "2000:2600:3 rpm")) == 0
    assert solve.floquet(script["start"], top).verdict == "unstable"
    assert radius(1.005 * top) > 1
    (_, limited) = script["optimum"].constraints
    assert limited.value < 0.99
    return radius(top), pytest.approx(limited.value, rel=1e-8)


def follower_acceleration(script):
    """The acceleration follows from differences of the angle in the triangle ABC."""
    t1, step = np.radians(120), 1e-3
    angles = [script["linkage"].motion(t1 + shift).t[2] for shift in (-step, 0.0, step)]
    return script["linkage"].motion(t1, 30.0).alpha[2], pytest.approx(
        30.0**2 * np.diff(angles, 2)[0] / step**2, rel=1e-4
    )


HELD = {
    "absorber": absorber,
    "amplifier": lambda script: (script["gain"][0.9][18], pytest.approx(1 / (1 - 0.9), rel=1e-4)),
    "cam_nonlinear": cam_nonlinear,
    "column": column,
    "coupler_bent": lambda _: (
        1e3 * solve.periodic(solve.load("coupler"), "600 rpm").statistics("q1").max_abs,
        printed("0.2750"),
    ),
    "coupler_campbell": coupler_campbell,
    "coupler_table2": coupler_table2,
    "duffing": duffing,
    "elasticities": lambda script: (script["total"], pytest.approx(0, abs=1e-6)),
    "flapping": lambda script: (script["exponents"][0, 0].real, pytest.approx(-12 / 16, rel=1e-8)),
    "flat_shaft": lambda script: (script["band"].high, pytest.approx(120.0, rel=1e-7)),
    "four_bar_stress": four_bar_stress,
    "ground_resonance": ground_resonance,
    "follower_acceleration": follower_acceleration,
    # Ratios of true to estimated errors of the orbit with three modes per link.
    "four_bar_reduced": lambda script: (script["ratios"][3][:, 0], pytest.approx(np.ones(17), rel=0.1)),
    "impeller": impeller,
    "kapitza": kapitza,
    "manipulator": lambda record: (record["coordinates"]["q1"]["max_abs"], printed("0.03163246")),
    "manipulator_map": manipulator_map,
    "manipulator_validity": manipulator_validity,
    "mathieu": lambda script: (script["first_tongue"][1], pytest.approx(mathieu_a(1, 0.5), rel=1e-8)),
    "meissner": meissner,
    "multiplier_functions": lambda script: (
        script["J"](np.full(4, 3.7), 1.9),
        pytest.approx(np.cos(3.7 * 1.9), rel=1e-12),
    ),
    "multipliers": multipliers,
    "operations": operations,
    "orders": lambda script: (script["slopes"]["Radau, order 5"], pytest.approx(5, abs=0.15)),
    "portal_modes": lambda record: (
        record["frequencies"][3],
        pytest.approx(4.730040745**2 * 17.6632297, rel=1e-8),
    ),
    "run_up": lambda script: (script["error"], pytest.approx(0, abs=1e-7)),
    "shaft_fit": shaft_fit,
    "sidebands": lambda script: (script["mesh"][1], printed("1.227935e-2")),
}


def test_gallery_has_at_least_sixteen_verified_figures():
    assert set(HELD) == set(PICTURES)
    assert len(PICTURES) >= 16


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_gallery_script_is_short_and_shown_with_its_figure(script):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    assert PICTURES[script.stem].command == text
    assert f"[{script.name}](gallery/{script.name})" in PICTURES[script.stem].page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in PICTURES]
)
def test_figure_is_drawn_and_its_number_verified(name, tmp_path, capsys):
    picture = PICTURES[name]._replace(file=tmp_path / f"{name}.png")
    if "savefig(" in picture.command:
        drawn = pictures.run_script(picture)
    else:
        # The command of the bent coupler prints no figures.
        pictures.run_command(picture, *([] if name == "coupler_bent" else ["--json"]))
        drawn = json.loads(capsys.readouterr().out or "{}")
    found, expected = HELD[name](drawn)
    assert found == expected
    assert picture.file.stat().st_size > 0
