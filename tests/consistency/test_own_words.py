"""The page's mechanisms with vectors, linkages, loops and fields, run with the commands of the page and
compared with closed forms."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from derive.command import run as derive
from solve.commands.app import run as solve

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own_mechanism.md").read_text(encoding="utf-8")


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command of the page for a mechanism and returns its JSON output."""

    def running(name):
        match = re.search(rf"```python\n# {name}.py\n(.*?)```", PAGE, re.DOTALL)
        assert match
        monkeypatch.chdir(tmp_path)
        Path(f"{name}.py").write_text(match.group(1), encoding="utf-8")
        for line in re.findall(rf"python -m ((?:derive|solve \w+) {name}.py.*)\n", PAGE):
            program, *arguments = shlex.split(line)
            assert not (derive(arguments) if program == "derive" else solve([*arguments, "--json"]))
        return json.loads(capsys.readouterr().out)

    return running


def harmonic(entry, order):
    """Return the complex amplitude of A cos(order φ + phase)."""
    return entry["harmonics"][order] * np.exp(1j * entry["phases"][order])


def test_mechanism_with_vectors_and_matrices_matches_closed_forms(run):
    """From sin φ, (K + iΩc − Ω²m) q = Ω² m a (−i); for the mean, K q = −m g e3."""
    record = run("chain")
    m, k, c, g, a, speed = 2.0, 50.0, 0.4, 9.81, 1e-3, 3.0
    K = k * np.array([[2, -1, 0], [-1, 2, -1], [0, -1, 1.0]])
    dynamic = np.linalg.solve(
        K + (1j * speed * c - speed**2 * m) * np.eye(3), np.full(3, -1j * speed**2 * m * a)
    )
    static = np.linalg.solve(K, [0, 0, -m * g])
    for i, name in enumerate(("q1", "q2", "q3")):
        entry = record["coordinates"][name]
        assert harmonic(entry, 1) == pytest.approx(dynamic[i], rel=1e-7)
        assert entry["mean"] == pytest.approx(static[i], rel=1e-9)
    acceleration = -(speed**2) * (dynamic[2] - 1j * a)
    assert harmonic(record["outputs"]["acceleration"], 1) == pytest.approx(acceleration, rel=1e-7)


def test_mechanism_with_damping_ratios_matches_closed_forms(run):
    """The modes are uncoupled. The frequencies of two equal masses are √(k/m) times golden ratios."""
    record = run("tower")
    m, k, u, speed, zeta = 800.0, 9e5, 0.5, 20.0, np.array([0.01, 0.03])
    golden = (1 + np.sqrt(5)) / 2
    omega = np.sqrt(k / m) * np.array([1 / golden, golden])
    shapes = np.array([[1, golden], [-golden, 1]]) / np.sqrt(m * (1 + golden**2))
    modal = shapes[:, 1] * u * speed**2 / (omega**2 - speed**2 + 2j * zeta * omega * speed)
    for name, expected in zip(("q1", "q2"), shapes.T @ modal, strict=True):
        assert harmonic(record["coordinates"][name], 1) == pytest.approx(expected, rel=1e-7)
    growth = sorted(exponent[0] for exponent in record["exponents"])
    assert growth == pytest.approx(sorted([*-zeta * omega] * 2), rel=1e-7)


def test_mechanism_with_a_four_bar_matches_the_closed_form(run):
    """For each harmonic, J q̈ + c q̇ + k (1 + gain Ω) q = −J φ̈4, where φ4 follows from the law of cosines in
    the triangle of crank pin, joint and pivot."""
    record = run("rocker")
    l1, l2, l3, l4, J, k, c, gain, speed = 0.4, 0.08, 0.35, 0.2, 0.02, 300.0, 0.05, 0.01, 20.0
    count = 512
    phase = 2 * np.pi * np.arange(count) / count
    to_pin = l2 * np.exp(1j * phase) - l1
    follower = np.angle(to_pin) - np.arccos((l4**2 + abs(to_pin) ** 2 - l3**2) / (2 * l4 * abs(to_pin)))
    amplitudes = 2 * np.fft.fft(np.unwrap(follower)) / count
    for order in range(1, 8):
        pulse = 1j * order * speed
        expected = -J * pulse**2 * amplitudes[order] / (J * pulse**2 + c * pulse + k * (1 + gain * speed))
        computed = harmonic(record["coordinates"]["q"], order)
        assert computed == pytest.approx(expected, rel=1e-6)
        assert harmonic(record["outputs"]["swing"], order) == pytest.approx(
            pulse**2 * amplitudes[order], rel=1e-8
        )


def test_slider_crank_loop_matches_the_closed_form(run):
    """For each harmonic, m q̈ + c q̇ + k q = −m s̈, where s follows from the right-angled triangle."""
    record = run("press")
    r, L, e, m, k, c, speed, count = 0.1, 0.3, 0.02, 2.0, 8e4, 40.0, 20.0, 256
    phase = 2 * np.pi * np.arange(count) / count
    slide = 2 * np.fft.fft(r * np.cos(phase) + np.sqrt(L**2 - (e - r * np.sin(phase)) ** 2)) / count
    for order in range(1, 6):
        pulse = 1j * order * speed
        expected = -m * pulse**2 * slide[order] / (m * pulse**2 + c * pulse + k)
        assert harmonic(record["coordinates"]["q"], order) == pytest.approx(expected, rel=1e-6, abs=1e-12)


def test_beam_with_pulsating_load_matches_mathieus_equation(run):
    """Each mode obeys ẅ + ω²(1 − P/P_k) w = 0 (Euler's loads P_k) and the whole is Mathieu's equation, whose
    growth at the middle of the first band is ω1²ε/(4ω), ε = P1/P_1, to second order."""
    record = run("column")
    L, mu, EI, P0, P1, speed = 2.0, 3.0, 500.0, 100.0, 40.0, 30.5
    euler = np.pi**2 * EI / L**2
    lowest = (np.pi / L) ** 2 * np.sqrt(EI / mu)
    assert record["period"] == pytest.approx(np.pi / speed)
    assert record["verdict"] == "unstable"
    assert lowest * np.sqrt(1 - P0 / euler) == pytest.approx(speed, rel=2e-3)
    growth = max(exponent[0] for exponent in record["exponents"])
    assert growth == pytest.approx(lowest**2 * (P1 / euler) / (4 * speed), rel=0.01)
