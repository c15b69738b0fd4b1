"""Ground resonance with a failed damper, beside the printed 46 % of Gandhi and Whitt (2022)."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "machines.md").read_text(encoding="utf-8")
SECTION = PAGE[PAGE.index("## Ground resonance with a failed damper") :].partition("\n## ")[0]
EXAMPLE = re.findall(r"```python\n(.*?)```", SECTION, flags=re.DOTALL)[0]
LAG = 4067.5


@pytest.fixture(scope="module")
def names():
    made = {}
    exec(EXAMPLE.partition("for speed in")[0], made)
    return made


def multiblade(phase):
    """x, y and four lag angles by x, y and collective, cosine, sine and differential lag (m, 6, 6)."""
    T = np.zeros((len(phase), 6, 6))
    T[:, 0, 0] = T[:, 1, 1] = 1.0
    for blade in range(2, 6):
        angle = phase + blade * np.pi / 2
        T[:, blade, 2], T[:, blade, 5] = 1.0, (-1.0) ** blade
        T[:, blade, 3], T[:, blade, 4] = np.cos(angle), np.sin(angle)
    return T


def constant_growth(system, speed):
    """Largest growth rate of the averages of the coefficients in multi-blade coordinates."""
    phase = np.arange(64) * 2 * np.pi / 64
    M, C, K, _ = system.at(phase, speed)
    T, ahead, behind = (multiblade(phase + shift) for shift in (0.0, np.pi / 2, -np.pi / 2))
    # The cyclic columns are sines and cosines, the others constant.
    dT = speed * (ahead - behind) / 2
    ddT = -(speed**2) * (T - (ahead + behind) / 2)
    ddT[:, :, [0, 1, 2, 5]] = 0.0
    transposed = np.swapaxes(T, 1, 2)
    mass, damping, stiffness = (
        (transposed @ each).mean(axis=0) for each in (M @ T, 2 * M @ dT + C @ T, M @ ddT + C @ dT + K @ T)
    )
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((6, 6)), np.eye(6)], [-inverse @ stiffness, -inverse @ damping]])
    return np.linalg.eigvals(matrix).real.max()


@pytest.mark.parametrize("rpm", [200, 235, 255])
def test_averaged_coefficients_are_those_of_three_quarters_of_the_damping(names, rpm):
    speed = rpm * np.pi / 30
    failed = constant_growth(names["helicopter"]([0.0, LAG, LAG, LAG]), speed)
    assert names["growth"]([0.75 * LAG] * 4, speed) == pytest.approx(failed, abs=1e-7)
    whole = constant_growth(names["helicopter"]([LAG] * 4), speed)
    assert names["growth"]([LAG] * 4, speed) == pytest.approx(whole, abs=1e-7)


def test_averages_catch_46_percent_of_the_lost_damping(names):
    whole, failed, averaged = (
        names["growth"](dampers, "235 rpm") for dampers in ([LAG] * 4, [0, LAG, LAG, LAG], [0.75 * LAG] * 4)
    )
    assert round((averaged - whole) / (failed - whole), 2) == 0.46
    assert averaged < 0 < failed


def test_page_prints_what_the_example_prints(capsys):
    exec(EXAMPLE, {})
    printed = re.findall(r"-?\d+\.\d+", capsys.readouterr().out)
    table = [line for line in SECTION.splitlines() if line.startswith("| 2")]
    shown = [number.replace("−", "-") for line in table for number in re.findall(r"−?\d+\.\d+", line)]
    assert printed == shown


def test_loss_is_underestimated_at_every_speed_of_the_page(names):
    ratios = []
    for rpm in range(180, 341, 40):
        rates = [
            names["growth"](dampers, rpm * np.pi / 30)
            for dampers in ([LAG] * 4, [0, LAG, LAG, LAG], [0.75 * LAG] * 4)
        ]
        ratios.append((rates[2] - rates[0]) / (rates[1] - rates[0]))
    assert min(ratios) > 0.40
    assert max(ratios) < 0.52
