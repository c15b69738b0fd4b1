"""One result of every kind, for tests of their common functions."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

import solve
from models.four_bar.design import designed
from models.four_bar.design_map import design_map
from models.four_bar.studies.corrected import corrections
from models.four_bar.studies.curve import curve_of_point
from models.four_bar.studies.design import carry_out
from models.four_bar.studies.linkage import rigid_motion
from models.four_bar.studies.modes import element_kinds, mode_contributions


@cache
def cam():
    return solve.load("cam")


@cache
def four_bar():
    return solve.load("four_bar")


@cache
def measured_torque():
    """Return a file with the orbit of the cam, for use as measured data."""
    file = Path(tempfile.mkdtemp()) / "measured.csv"
    solve.periodic(cam(), "400 rpm", rtol=1e-6).save(file)
    return file


def run_up():
    start, stress = np.geomspace(8.0, 30.0, 20), dict.fromkeys(("crank", "coupler", "follower"), 100e6)
    return carry_out(designed(design_map(four_bar(), stress, start, (0.53, 0.63), 7)), 29.0, 2.0)


EXAMPLES = {
    "solve.periodic": (lambda: solve.periodic(cam(), "300 rpm"), '--speed "5 Hz"'),
    "solve.nonlinear": (lambda: solve.nonlinear(cam(), "100 rpm", rtol=1e-6), '--speed "1.5 Hz" --rtol 1e-6'),
    "solve.floquet": (lambda: solve.floquet(cam(), "300 rpm"), '--speed "5 Hz"'),
    "solve.sweep": (lambda: solve.sweep(cam(), [30.0, 40.0]), '--speeds "30:40:2 rad/s"'),
    "solve.chart": (
        lambda: solve.chart("mathieu", "delta=0:5:9", "epsilon=0:5:9", 1.0),
        "--x delta=0:5:9 --y epsilon=0:5:9",
    ),
    "solve.bands": (
        lambda: solve.bands(solve.load("mathieu", delta=1.0, epsilon=0.3), [0.8, 1.2]),
        '--speeds "0.8:1.2:2 rad/s" --set delta=1 --set epsilon=0.3',
    ),
    "solve.critical_speeds": (
        lambda: solve.critical_speeds(cam(), [40.0, 45.0, 50.0], rtol=1e-5),
        '--speeds "6.4:8:3 Hz" --rtol 1e-5',
    ),
    "solve.follow_modes": (
        lambda: solve.follow_modes(cam(), "600:620:2 rpm"),
        '--speeds "10:10.2:2 Hz"',
    ),
    "solve.compare": (
        lambda: solve.compare(cam(), "300 rpm", methods=["gauss"]),
        '--speed "5 Hz" --method gauss',
    ),
    "solve.frequencies": (lambda: solve.frequencies(cam(), np.arange(4) * np.pi / 2), "4"),
    "solve.frequencies_over": (
        lambda: solve.frequencies_over(cam(), "k3", [1e8, 2e8], np.zeros(1)),
        'k3=1e8:2e8:2 --position "0 deg"',
    ),
    "solve.transient": (
        lambda: solve.transient(cam(), "300 rpm", 2, rtol=1e-3),
        '--speed "5 Hz" --turns 2 --rtol 1e-3',
    ),
    "solve.branch": (
        lambda: solve.branch(cam(), "100:110 rpm", points=3, rtol=1e-2),
        '--speeds "1.5:2 Hz" --points 3 --rtol 1e-2',
    ),
    "solve.scatter": (lambda: solve.scatter(cam(), "100 rpm", 3), '--scatter 3 --speed "100 rpm"'),
    "solve.special_curves": (
        lambda: solve.special_curves(
            solve.load("mathieu"), "doubling", ["delta=0.6:1.4", "epsilon=0.4:0.3"], 1.0, points=8
        ),
        "--follow doubling --over delta=0.6:1.4 --over epsilon=0.4:0.3 --speed 1rad/s --points 8",
    ),
    "solve.validity": (lambda: solve.validity(cam(), [10.0, 20.0]), '--speeds "10:20:2 rad/s"'),
    "solve.sensitivities": (
        lambda: solve.sensitivities(cam(), "300 rpm", ["q1.max_abs", "rho1"], ["k1", "speed"]),
        '--speed "5 Hz" --of q1.max_abs --of rho1 --by k1 --by speed',
    ),
    "solve.sensitivities_over": (
        lambda: solve.sensitivities_over(cam(), [30.0, 40.0], ["q1.max_abs", "rho1"], ["k1", "speed"]),
        '--speeds "30:40:2 rad/s" --of q1.max_abs --of rho1 --by k1 --by speed',
    ),
    "solve.speed_sensitivities": (
        lambda: solve.speed_sensitivities(
            solve.bands(solve.load("mathieu", delta=1.0, epsilon=0.3), [0.8, 1.2]), ["delta"]
        ),
        '--speeds "0.8:1.2:2 rad/s" --set delta=1 --set epsilon=0.3 --by delta',
    ),
    "solve.optimise": (
        lambda: solve.optimise(cam(), "q3.max_abs", {"k3": (2e8, 3e8)}, ["100 rpm", "150 rpm"], rtol=1e-5),
        '--minimise q3.max_abs --free k3 --bounds k3=2e8:3e8 --speeds "100 150 rpm" --rtol 1e-5',
    ),
    "solve.tolerances": (
        lambda: solve.tolerances(
            cam(), "500 rpm", {"k3": "±1 %"}, ["q3.max_abs < 4 mm"], samples=64, index_samples=8, rtol=1e-5
        ),
        '--speed "500 rpm" --vary k3=±1% --subject "q3.max_abs < 4 mm" --samples 64 --index-samples 8 '
        "--rtol 1e-5",
    ),
    "solve.fit": (
        lambda: solve.fit(cam(), measured_torque(), "k1", speed="400 rpm", rtol=1e-6),
        f'--data {measured_torque()} --free k1 --speed "6.5 Hz" --rtol 1e-6',
    ),
    "solve.control": (
        lambda: solve.control(cam(), "300 rpm", {"q3": 1e6, "u": 1}, rtol=1e-3, vibration=True),
        '--speed "5 Hz" --lqr "q3=1e6, u=1" --rtol 1e-3 --vibration',
    ),
    "solve.lqr": (
        lambda: solve.lqr(cam(), "300 rpm", {"q3": 1e6}, {"u": 1}, rtol=1e-3, feedforward=True),
        '--speed "5 Hz" --lqr "q3=1e6, u=1" --rtol 1e-3 --feedforward',
    ),
    "solve.kalman": (
        lambda: solve.kalman(cam(), "300 rpm", {"u": 1}, {"q1": 1e-9}, rtol=1e-3),
        '--speed "5 Hz" --kalman "u=1, q1=1e-9" --rtol 1e-3',
    ),
    "solve.lqg": (
        lambda: solve.lqg(cam(), "300 rpm", {"q3": 1e6}, {"u": 1}, {"u": 1}, {"q1": 1e-9}, rtol=1e-3),
        '--speed "5 Hz" --lqr "q3=1e6, u=1" --kalman "u=1, q1=1e-9" --rtol 1e-3',
    ),
    "solve.sweeps": (
        lambda: solve.sweeps(
            solve.variants(four_bar(), "L4", [0.547, 0.6]), [25.0, 30.0], ["crank_root_stress"], "L4 (m)"
        ),
        '--speeds "25:30:2 rad/s" --over L4=0.547,0.6 --of crank_root_stress',
    ),
    "rigid_motion": (
        lambda: rigid_motion("table41", four_bar().parameters, speed=30.0, position=1.0),
        '--speed "5 Hz" --position "1 rad"',
    ),
    "mode_contributions": (
        lambda: mode_contributions(four_bar(), 35.0, "follower_midpoint_deflection", 4, False, 1e-6),
        '--speed "35 rad/s"',
    ),
    "curve_of_point": (
        lambda: curve_of_point(four_bar(), 30.0, 0.5, 0.01),
        '--speed "30 rad/s" --across 0.01',
    ),
    "element_kinds": (
        lambda: element_kinds(four_bar(), ["cubic:1", "dynamic:1"], 2, 4),
        "--kinds cubic:1,dynamic:1 --count 2 --turn 4",
    ),
    "corrections": (
        lambda: corrections(four_bar(), 30.0, "follower_midpoint_stress", ["1"]),
        '--speed "30 rad/s" --elements 1',
    ),
    "carry_out": (
        run_up,
        '--allowable "100 MPa" --target "29 rad/s" --speeds "8:30:20 rad/s" --L4 "0.53:0.63:7 m" '
        '--time "2 s"',
    ),
}
"""Mapping from names in the first column of the table to a function that returns an example of the result,
and the flags with which a command returns the same result."""


@cache
def example(name):
    return EXAMPLES[name][0]()


def picture(result):
    """Return the figure of a result, which is drawn once and used for all cells of a row."""
    if id(result) not in PICTURES:
        PICTURES[id(result)] = result.plot()
    return PICTURES[id(result)]


def saved(result, ending):
    """Return a saved file of a result, which is written once and used for all cells of a row."""
    key = id(result), ending
    if key not in FILES:
        FILES[key] = Path(FOLDER.name) / f"{len(FILES)}{ending}"
        result.save(FILES[key])
    return FILES[key]


PICTURES, FILES = {}, {}
FOLDER = tempfile.TemporaryDirectory()
