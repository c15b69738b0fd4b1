"""The page of all commands lists every flag and every JSON key, and no others."""

import contextlib
import io
import json
import re
import shlex
import sys
from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest

import solve
from solve.results.controller import StabilityMargin
from solve.results.followed_modes import Ambiguity, Meeting
from tests.pages import ROOT
from tests.solve.free_machines import DRAG, train
from tests.solve.newton.mechanisms import autoparametric, duffing, model_of
from tests.solve.newton.test_branching_points import SWING, driven
from tests.solve.newton.test_special_points import COUPLED, DRIVEN, DUFFING
from tests.solve.studies.test_critical_speeds import _growing
from tests.solve.studies.test_failed_points import LOW, holed
from tests.solve.studies.test_resonances import two_modes
from tests.solve.studies.test_sweep import resonant

sys.path.insert(0, str(ROOT / "docs" / "extensions"))
page = import_module("commands_page")

COMMANDS = """
solve periodic cam --speed "300 rpm" --quasi-static --rtol 1e-4 --data measured.csv
solve periodic cam --speed "100 rpm" --nonlinear --rtol 1e-4
solve periodic four_bar --option elements=1 --reduce 1 --speed "30 rad/s" --rtol 1e-3
solve floquet mathieu
solve sweep cam --speeds "30:40:2 rad/s" --over k1=9e4:1e5:2
solve sweep four_bar --option elements=1 --reduce 1 --speeds "30 rad/s" --rtol 1e-3
solve chart mathieu --x delta=0.5:1.5:3 --y epsilon=0.1:0.5:3 --cut epsilon=0.3 --of spectral_radius
solve bands mathieu --speeds "0.8:1.2:2 rad/s" --set delta=1 --set epsilon=0.3
solve bands mathieu --speeds "0.8:1.2:2 rad/s" --set delta=1 --set epsilon=0.3 --by delta
solve critical cam --speeds "40:50:3 rad/s" --rtol 1e-5
solve transient cam --speed "300 rpm" --turns 2 --rtol 1e-3
solve transient cam --speeds "600:610 rpm" --turns 1 --rtol 1e-3
solve branch cam --speeds "90:120 rpm" --points 3 --rtol 1e-2
solve branch gear_backlash --speeds "27000:29000 rad/s" --unforced --set e=0 --set E=0 --set c=0 --points 2
solve modes mathieu --speeds "0.9:1.1:3 rad/s" --set zeta=0.01 --rtol 1e-4
solve optimise mathieu --speed "1 rad/s" --minimise spectral_radius --free zeta --bounds zeta=0:0.1
solve tolerances mathieu --speed "1 rad/s" --vary delta=±1% --subject "spectral_radius < 2" --samples 64
solve control manipulator --lqr "q2=1e8, u=1e-2" --feedforward --vibration --samples 9 --norms q2 --rtol 1e-3
solve validity cam --speeds "10:20:2 rad/s"
solve sensitivity cam --speed "300 rpm" --of q1.max_abs --by k1
solve sensitivity cam --speeds "30:40:2 rad/s" --of q1.max_abs --by k1
solve fit cam --data measured.csv --free k1 --speed "300 rpm" --rtol 1e-4
solve frequencies four_bar --turn 2 --over L4=0.547:0.6:2 --modes
models.four_bar linkage --speed "5 Hz" --position "1 rad"
models.four_bar elements --kinds cubic:1 --count 1 --turn 2
models.four_bar modes --speed "35 rad/s" --rtol 1e-3 --uncoupled
models.four_bar curve --speed "30 rad/s" --rtol 1e-3
""".strip().splitlines()

SLOW_COMMANDS = """
solve compare cam --speed "300 rpm" --method gauss
solve floquet mathieu --prove
solve optimise manipulator --speed "50 rpm" --minimise q1.max_abs --free b1 --bounds b1=0:1mm --prove
solve branch cam --speed "100 rpm" --scatter 2
solve branch slider_crank --speeds "1018.5:1088 rpm" --points 6
solve periodic manipulator --speed "50 rpm" --prove
solve chart mathieu --x delta=0.95:1.05:3 --y epsilon=0.1:0.2:3 --set zeta=0.01 --prove
models.four_bar study --speeds "20:32:13 rad/s" --over L4=0.547,0.6 --of crank_root_stress
models.four_bar corrected --elements 1 --rtol 1e-3
models.four_bar design --allowable "100 MPa" --speeds "8:30:20 rad/s" --L4 "0.53:0.63:7 m" --time "2 s"
""".strip().splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a measured vibration of the cam."""
    path = tmp_path_factory.mktemp("keys")
    solve.periodic(solve.load("cam"), "300 rpm", rtol=1e-4).save(path / "measured.csv")
    return path


@cache
def paths_of(command, folder):
    """Return the name of the command, and the keys of its output with a value."""
    program, *arguments = shlex.split(command)
    module = "solve.commands.app" if program == "solve" else f"{program}.__main__"
    output = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(output):
        assert import_module(module).run([*arguments, "--json"]) == 0
    name = f"{program} {arguments[0]}" + (" --scatter" if "--scatter" in arguments else "")
    return name, dict(paths(json.loads(output.getvalue())))


def paths(value, place=()):
    """Return the keys of the innermost objects, as tuples, with their values."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from paths(inner, (*place, key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for inner in value:
            yield from paths(inner, (*place[:-1], f"{place[-1]}[]"))
    else:
        yield place, value


def documented(command):
    """Return the patterns of the page for a command."""
    names = {command, "*"}
    return [
        pattern
        for group in page.keys().values()
        if names & set(group["_commands"]) and f"-{command}" not in group["_commands"]
        for pattern in page.patterns(group)
    ]


def matches(pattern, path, value):
    """Return whether a pattern describes a key. A value that is null or empty may represent an inner
    object."""
    names = pattern.split(".")
    if value in (None, [], {}):
        names = names[: len(path)]
        path = (*path[:-1], path[-1] + "[]" * (names[-1].endswith("[]") and not path[-1].endswith("[]")))
    return len(names) == len(path) and all(
        re.fullmatch(re.escape(name).replace("NAME", ".+"), key)
        for name, key in zip(names, path, strict=True)
    )


def undocumented(command, folder):
    """Return the keys of the output of a command that the page does not contain."""
    name, keys = paths_of(command, folder)
    patterns = documented(name)
    return [
        path for path, value in keys.items() if not any(matches(pattern, path, value) for pattern in patterns)
    ]


def test_page_is_up_to_date():
    text = page.PAGE.read_text(encoding="utf-8")
    assert page.renewed(text) == text, f"docs/commands.md is out of date; renew it with: {page.COMMAND}"


def test_page_lists_every_flag():
    text = page.PAGE.read_text(encoding="utf-8")
    for name, flags in page.flags().items():
        assert flags, name
        assert all(flag.row in text for flag in flags)


@pytest.mark.parametrize("command", COMMANDS)
def test_printed_keys_are_documented(command, folder):
    assert not undocumented(command, folder)


@pytest.mark.slow
@pytest.mark.parametrize("command", SLOW_COMMANDS)
def test_printed_keys_of_longer_commands_are_documented(command, folder):
    pytest.importorskip("flint")
    assert not undocumented(command, folder)


@cache
def records():
    """Return records with rigid-body modes, combination resonances, finite margins and points without a
    result. No included model has these within its bounds or in a short time."""
    free = solve.periodic(train(C=DRAG, mean=1.0), 10.0, rtol=1e-4)
    critical = solve.critical_speeds(
        two_modes((1.0, 9.0), (lambda _: 0.2, lambda _: 0.3), 1.8), np.linspace(9.0, 11.0, 41), orders=5
    )
    (row,) = [row for row in critical.rows if row.combination]
    unclear = replace(row, combination=None, candidates=[row.combination])
    growing = solve.PeriodicSystem(_growing, ["q"])
    gaps = {"delta": [0.2, LOW + 0.1]}, {"epsilon": [0.5, 2.5]}
    mass = model_of(duffing(), zeta=0.1, k=1.0, alpha=0.2, f=0.3)
    validity = solve.validity(mass, [0.1, 0.2])
    modes = solve.follow_modes(mass, [0.1, 0.2], rtol=1e-4)
    meeting, doubt = Meeting(("1", "2"), 0.15, "veering", 0.01), Ambiguity(("1", "2"), 0.1, 0.2, "close")
    coupled = model_of(autoparametric(), **COUPLED, F=0.04)
    press, margin = solve.load("manipulator"), StabilityMargin(0.5, {"k1": -0.5}, ("stable", "unstable"))
    regulator = solve.lqr(press, "50 rpm", {"q2": 1e8}, {"u": 1e-2}, rtol=1e-4)
    results = {
        "solve periodic": [free],
        "solve modes": [replace(modes, meetings=[meeting], ambiguous=[doubt])],
        "solve branch": [
            solve.branch(model_of(duffing(), **DUFFING), "1:2.2 rad/s", rtol=1e-6),
            solve.branch(coupled, DRIVEN, over="F=0.04:0.12", switch=True, points=40),
            solve.branch(driven(1.05), SWING, over="F=1.05:0.9", rtol=1e-6),
        ],
        "solve sweep": [solve.sweep(resonant(), [1.5, 2.0])],
        "solve chart": [solve.chart(holed, *gaps, 1.0)],
        "solve critical": [
            critical,
            replace(critical, rows=[unclear]),
            solve.critical_speeds(growing, np.linspace(1.0, 4.0, 31), orders=3),
        ],
        "solve control": [replace(regulator, margin=margin)],
        "solve validity": [replace(validity, failures={0: "no nonlinear orbit"})],
    }
    return [(name, dict(paths(result.record()))) for name in results for result in results[name]]


@pytest.mark.slow
def test_documented_keys_are_printed(folder):
    pytest.importorskip("flint")
    printed = [paths_of(command, folder) for command in COMMANDS + SLOW_COMMANDS] + records()
    missing = []
    for title, group in page.keys().items():
        outputs = [keys for name, keys in printed if {name, "*"} & set(group["_commands"])]
        present = [(path, value) for keys in outputs for path, value in keys.items()]
        for pattern in page.patterns(group):
            length = len(pattern.split("."))
            if not any(len(path) == length and matches(pattern, path, value) for path, value in present):
                missing.append(f"{title}: {pattern}")
    assert not missing


def test_repeatable_flags_refuse_equal_values():
    flags = [
        (command, parameter.opts[0])
        for _, command in page.programs()
        for parameter in command.params
        if parameter.param_type_name == "option" and parameter.multiple
    ]
    assert len(flags) > 50
    for command, flag in flags:
        with pytest.raises(Exception, match=f"{flag} 1 is given 2 times; give it once"):
            command.make_context("", [flag, "1", flag, "1"])
