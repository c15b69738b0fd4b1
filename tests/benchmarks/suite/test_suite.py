"""Data of the open benchmark agree with closed forms, with SciPy, and with this package within its
estimates."""

import json

import mpmath
import numpy as np
import pytest

import solve
from tests.benchmarks.suite.__main__ import errors, main
from tests.benchmarks.suite.contenders import CONTENDERS
from tests.benchmarks.suite.systems import FILE, load

SYSTEMS = {system.name: system for system in load()}
RECORDS = {record["name"]: record for record in json.loads(FILE.read_text(encoding="utf-8"))["systems"]}
CONSTANT_MASS = [name for name, record in RECORDS.items() if len(record["M"]) == 1]
SLOWLY_VARYING = [
    name for name in SYSTEMS if name.split("_")[-1] not in ("mode", "soft", "bump", "harmonics", "8", "12")
]
"""Systems that explicit integration solves within a second."""


def printed(name):
    return [mpmath.mpc(*pair) for pair in RECORDS[name]["multipliers"]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["mathieu"], "no system or installed program is named 'mathieu'; known: auto, gauss"),
        (["auto", "--target", "nan"], "--target is nan; give a positive number"),
        (["auto", "--limit", "0"], "--limit is 0; give a positive number"),
    ],
)
def test_runner_refuses_unknown_names_and_settings(given, message, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["suite", *given])
    with pytest.raises(SystemExit, match="2"):
        main()
    assert message in capsys.readouterr().err


def test_runner_omits_ratios_of_unsolved_systems(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["suite", "auto", "fourier", "strong_decay"])
    main()
    *_, solved, ratio = capsys.readouterr().out.splitlines()
    assert (solved.split()[-2:], ratio.split()[-2:]) == (["1", "0"], ["1", "–"])


def test_thirty_systems_have_distinct_names():
    assert len(SYSTEMS) == len(RECORDS) == 30


@pytest.mark.parametrize("name", CONSTANT_MASS)
def test_product_of_the_multipliers_follows_liouville_to_thirty_digits(name):
    record = RECORDS[name]
    with mpmath.workdps(60):
        trace = mpmath.fsum(
            (mpmath.inverse(mpmath.matrix(record["M"][0][1])) * mpmath.matrix(record["C"][0][1]))[k, k]
            for k in range(SYSTEMS[name].n)
        )
        exact = mpmath.exp(-2 * mpmath.pi * trace / mpmath.mpf(record["speed"]))
        product = mpmath.fprod(printed(name))
        assert abs(product - exact) <= 1e-29 * exact * len(record["multipliers"])


def test_rotating_shaft_has_the_multipliers_of_its_constant_equations():
    """In axes that rotate: q̈ + (c/m + 2ΩJ) q̇ + (diag(k)/m - Ω² + cΩJ/m) q = 0, over one revolution."""
    record = RECORDS["rotating_shaft"]
    (_, mean, _), (_, A, _) = record["K"]
    with mpmath.workdps(60):
        speed, mass = mpmath.mpf(record["speed"]), mpmath.mpf(record["M"][0][1][0][0])
        drag, stiffness = record["C"][0][1][0][0] / mass, [mean[0][0] + A[0][0], mean[0][0] - A[0][0]]
        state = mpmath.zeros(4)
        state[0, 2] = state[1, 3] = 1
        for k in range(2):
            state[2 + k, k] = speed**2 - mpmath.mpf(stiffness[k]) / mass
            state[2 + k, 2 + k] = -drag
        state[2, 3], state[3, 2] = 2 * speed, -2 * speed
        state[2, 1], state[3, 0] = drag * speed, -drag * speed
        left = mpmath.eig(mpmath.expm(state * 2 * mpmath.pi / speed), left=False, right=False)
        for multiplier in printed("rotating_shaft"):
            nearest = min(left, key=lambda value: abs(value - multiplier))
            left.remove(nearest)
            assert abs(nearest - multiplier) <= mpmath.mpf("1e-29")


@pytest.mark.parametrize("name", SLOWLY_VARYING)
def test_scipy_reproduces_the_stored_results(name):
    system = SYSTEMS[name]
    error, of_state = errors(system, *CONTENDERS["SciPy DOP853"](system)(1e-11))
    # (I - Φ)⁻¹ multiplies errors of the period map.
    condition = 1 / np.abs(1 - system.multipliers).min()
    assert error <= 1e-8
    assert of_state <= 1e-8 * max(condition, 1.0)


@pytest.mark.parametrize("name", SYSTEMS)
def test_estimates_and_verdicts_hold_on_every_system(name):
    system = SYSTEMS[name]
    names = [f"q{k + 1}" for k in range(system.n)]
    orbit = solve.periodic(solve.PeriodicSystem(system.matrices, names), system.speed)
    state = np.concatenate((orbit.q[:, 0], orbit.qd[:, 0]))
    error, _ = errors(system, orbit.multipliers, state)
    assert error <= 10 * orbit.error_estimate.multipliers
    difference = np.abs(orbit.q[:, 0] - system.state[: system.n])
    assert (difference <= 10 * orbit.error_estimate.orbit * np.abs(orbit.q).max(axis=1)).all()
    radius = np.abs(system.multipliers).max()
    assert orbit.verdict == ("unstable" if radius > 1 else "asymptotically stable")
