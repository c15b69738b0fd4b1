"""Gear pair on the page on user mechanisms, whose mesh stiffness jumps twice per tooth, compared with exact
products of matrix exponentials."""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import solve
from derive.__main__ import main
from solve.commands.app import run

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "own_mechanism.md").read_text(encoding="utf-8")
NUMBERS = {"m": 1.0, "c": 0.02, "k1": 3.0, "k2": 5.0, "z": 1, "F": 1.0}


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    """Return the path of the derived mechanism."""
    match = re.search(r"```python\n# mesh.py\n(.*?)```", PAGE, re.DOTALL)
    assert match
    path = tmp_path_factory.mktemp("mine") / "mesh.py"
    path.write_text(match.group(1), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["derive", str(path)])
        with pytest.raises(SystemExit) as left:
            main()
    assert not left.value.code
    return path


def turn(speed, eps, z=1):
    """Of (q, q̇, 1) over a turn."""

    def generator(stiffness):
        return np.array([[0, 1, 0], [-stiffness, -NUMBERS["c"], NUMBERS["F"]], [0, 0, 0]])

    tooth = 2 * np.pi / speed / z
    once = expm(generator(NUMBERS["k1"]) * (2 - eps) * tooth) @ expm(
        generator(NUMBERS["k2"]) * (eps - 1) * tooth
    )
    return np.linalg.matrix_power(once, z)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
@pytest.mark.parametrize(("z", "eps"), [(1, 1.3), (7, 1.65)])
def test_orbit_and_multipliers_match_matrix_exponentials(mesh, z, eps, engine):
    model = solve.load(str(mesh), **{**NUMBERS, "z": z}, eps=eps)
    orbit = solve.periodic(model, 0.9, rtol=1e-11, engine=engine)
    exact = turn(0.9, eps, z)
    multipliers = np.sort_complex(np.linalg.eigvals(exact[:2, :2]))
    np.testing.assert_allclose(np.sort_complex(orbit.multipliers), multipliers, rtol=0, atol=1e-10)
    start = np.linalg.solve(np.eye(2) - exact[:2, :2], exact[:2, 2])
    np.testing.assert_allclose([orbit.q[0, 0], orbit.qd[0, 0]], start, rtol=0, atol=1e-9)
    assert len(model.breaks) == 2 * z


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_band_edges_agree_to_eight_digits(mesh, engine):
    """The edges of bands, a sweep and a chart are compared. At an edge of the band of kind −1, a multiplier
    is −1: 1 + tr Φ + det Φ = 0."""

    def edge(speed, eps):
        Phi = turn(speed, eps)[:2, :2]
        return 1 + np.trace(Phi) + np.linalg.det(Phi)

    edges = [brentq(edge, *around, args=(1.3,), xtol=1e-14) for around in [(3.4, 3.6), (3.9, 4.2)]]
    model = solve.load(str(mesh), **NUMBERS, eps=1.3)
    (band,) = solve.bands(model, np.linspace(3, 5, 40), engine=engine).record()["bands"]
    assert band["kind"] == "-1"
    np.testing.assert_allclose([band["from"], band["to"]], edges, rtol=1e-8)

    sides = np.ravel([[e - 1e-7, e + 1e-7] for e in edges])
    assert [point.stable for point in solve.sweep(model, sides, engine=engine).points] == [
        True,
        False,
        False,
        True,
    ]

    duties = np.array([1.2, 1.3, 1.6])
    chart = solve.chart(model, x={"eps": duties}, y={"speed": np.array([3.3, 3.8])}, engine=engine)
    assert chart.boundaries
    for kind, points in chart.boundaries:
        assert kind == "-1"
        for eps, speed in points:
            assert speed == pytest.approx(brentq(edge, speed - 1e-4, speed + 1e-4, args=(eps,)), rel=1e-8)
    for column, eps in enumerate(duties):
        for row, speed in enumerate([3.3, 3.8]):
            radius = np.abs(np.linalg.eigvals(turn(speed, eps)[:2, :2])).max()
            assert chart.spectral_radius[row, column] == pytest.approx(radius, abs=1e-8)


def test_command_of_the_page_runs(mesh, monkeypatch, capsys):
    (line,) = re.findall(r"python -m solve (floquet mesh.py .*)\n", PAGE)
    monkeypatch.chdir(mesh.parent)
    assert run(shlex.split(line)) == 0
    radius = np.abs(np.linalg.eigvals(turn(3.8, 1.3)[:2, :2])).max()
    (printed,) = re.findall(r"finds that the motion is unstable, with a spectral radius of ([\d.]+)\.", PAGE)
    assert f"unstable: spectral radius {printed} " in capsys.readouterr().out
    assert float(printed) == pytest.approx(radius, abs=1e-9)
