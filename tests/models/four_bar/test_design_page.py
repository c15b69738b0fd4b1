"""Page on the design method: its commands run as printed and yield its table."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import solve
from models.four_bar.__main__ import run
from models.four_bar.stress_map import StressMap

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "four_bar_design.md").read_text(encoding="utf-8")
COMMANDS = [line for line in PAGE.splitlines() if line.startswith("python -m models.four_bar ")]
ROWS = [
    [cell.strip() for cell in line.split("|")[1:-1]]
    for line in PAGE.splitlines()
    if re.match(r"\| \d+ \|", line)
]


def numbers(text):
    return [float(each) for each in re.findall(r"\d+\.\d+|\d+", text)]


PEAKS = {}


@pytest.fixture
def stresses_once(monkeypatch):
    """Compute the stresses once per speed and L4, because the commands differ in the allowable stresses
    only."""
    solved = StressMap.peaks

    def kept(stress_map, speeds, L4):
        key = *map(len, stress_map.positions), *(each.tobytes() for each in (stress_map.nodes, speeds, L4))
        if key not in PEAKS:
            PEAKS[key] = solved(stress_map, speeds, L4)
        return PEAKS[key]

    monkeypatch.setattr(StressMap, "peaks", kept)


@pytest.mark.slow
@pytest.mark.usefixtures("stresses_once")
@pytest.mark.parametrize("line", COMMANDS)
def test_page_matches_the_output_of_its_commands(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', line)][3:]
    assert run([*arguments, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    stress = record["allowable"]["crank"] / 1e6
    (row,) = (row for row in ROWS if float(row[0]) == stress)
    _, quiet, limiting, target, L4, least, simulated = row
    edges = [edge for band in record["quiet"] for edge in (band["start"], band["end"])][1:]
    assert numbers(quiet) == pytest.approx(edges, rel=1e-3)
    assert numbers(limiting) == pytest.approx([peak["speed"] for peak in record["limiting"]], rel=3e-3)
    assert numbers(target) == pytest.approx([record["target"]], rel=3e-3)
    assert ("returns" in target) == record["returns"]
    end = record["own_L4"] if record["returns"] else record["plan"]["L4"][-1]
    assert numbers(L4) == pytest.approx([end], abs=2e-3)
    assert numbers(least) == pytest.approx([record["smallest_allowable"]["crank"] / 1e6], rel=5e-3)
    first = record["trials"][0]
    assert first["duration"] == 60
    assert numbers(simulated) == pytest.approx([first["greatest_ratio"]], rel=5e-3)
    assert first["greatest_ratio"] < 1
    assert list(tmp_path.iterdir())
    # The steady state at the end of the plan, solved by itself: the crank's root is its worst place.
    at, L4 = record["target"], record["plan"]["L4"][-1]
    model = solve.load("four_bar", options=record["options"], L4=L4)
    alone = solve.periodic(model, at, rtol=1e-6)
    root = max(alone.statistics(f"crank_root_stress_{side}").max_abs for side in ("plus", "minus"))
    row = record["stress"]["crank"][int(np.argmin(np.abs(np.array(record["speeds"]) - at)))]
    assert np.interp(L4, record["L4"], row) == pytest.approx(root, rel=5e-3)


@pytest.mark.slow
def test_page_states_the_effect_of_more_elements():
    plans = r"\((\d+\.\d) rad/s, L4 = (0\.\d+) m\)(?:\s+they give)?\s+(\d+\.\d) MPa instead of (\d+\.\d)"
    message = re.findall(plans, PAGE)
    assert len(message) == 2
    for speed, L4, *stresses in (map(float, each) for each in message):
        for elements, stress in zip((3, 7), stresses, strict=True):
            model = solve.load("four_bar", options={"elements": elements})
            computed = StressMap(model, L4, L4, 1).peaks(np.array([speed]), np.array([L4])).stress
            assert stress == pytest.approx(computed.max() / 1e6, rel=2e-3)


def test_page_contains_commands_and_figures():
    assert len(COMMANDS) == len(ROWS) == 2
    for picture in re.findall(r"\]\((\S+\.png)\)", PAGE):
        assert (Path(__file__).resolve().parents[3] / "docs" / picture).stat().st_size > 20_000
