"""Ground resonance with a failed damper, compared with the 46 % printed by Gandhi and Whitt (2022)."""

import re
from pathlib import Path

import numpy as np
import pytest

import solve

PAGE = (Path(__file__).parents[2] / "docs" / "machines.md").read_text(encoding="utf-8")
SECTION = PAGE[PAGE.index("## Ground resonance with a failed damper") :].partition("\n## ")[0]
EXAMPLE = re.findall(r"```python\n(.*?)```", SECTION, flags=re.DOTALL)[0]
LAG = 4067.5


@pytest.fixture(scope="module")
def names():
    made = {}
    exec(EXAMPLE.partition("for speed in")[0], made)
    return made


def multiblade(phase, blades):
    """Return x, y and the lag angles (m, n, n) in terms of x, y and the collective, cosine, sine and, for
    four blades, differential lag."""
    T = np.zeros((len(phase), blades + 2, blades + 2))
    T[:, 0, 0] = T[:, 1, 1] = 1.0
    for blade in range(2, blades + 2):
        angle = phase + blade * 2 * np.pi / blades
        T[:, blade, 2] = 1.0
        T[:, blade, 3], T[:, blade, 4] = np.cos(angle), np.sin(angle)
        T[:, blade, 5:] = (-1.0) ** blade
    return T


def constant_growth(system, speed):
    """Return the largest growth rate of the system with averaged coefficients in multi-blade coordinates."""
    phase, n = np.arange(64) * 2 * np.pi / 64, system.n
    M, C, K, _ = system.at(phase, speed)
    T, ahead, behind = (multiblade(phase + shift, n - 2) for shift in (0.0, np.pi / 2, -np.pi / 2))
    # The cyclic columns are sines and cosines, the others constant.
    dT = speed * (ahead - behind) / 2
    ddT = -(speed**2) * (T - (ahead + behind) / 2)
    ddT[:, :, [0, 1, 2, *range(5, n)]] = 0.0
    transposed = np.swapaxes(T, 1, 2)
    mass, damping, stiffness = (
        (transposed @ each).mean(axis=0) for each in (M @ T, 2 * M @ dT + C @ T, M @ ddT + C @ dT + K @ T)
    )
    inverse = np.linalg.inv(mass)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    return np.linalg.eigvals(matrix).real.max()


@pytest.mark.parametrize("rpm", [200, 235, 255])
def test_averaged_coefficients_have_three_quarters_of_the_damping(names, rpm):
    speed = rpm * np.pi / 30
    failed = constant_growth(names["helicopter"]([0.0, LAG, LAG, LAG]), speed)
    assert names["growth"]([0.75 * LAG] * 4, speed) == pytest.approx(failed, abs=1e-7)
    whole = constant_growth(names["helicopter"]([LAG] * 4), speed)
    assert names["growth"]([LAG] * 4, speed) == pytest.approx(whole, abs=1e-7)


def test_averages_predict_46_percent_of_the_lost_damping(names):
    whole, failed, averaged = (
        names["growth"](dampers, "235 rpm") for dampers in ([LAG] * 4, [0, LAG, LAG, LAG], [0.75 * LAG] * 4)
    )
    assert round((averaged - whole) / (failed - whole), 2) == 0.46
    assert averaged < 0 < failed


def test_hinge_springs_and_weaker_dampers_change_the_ratio_as_printed(names):
    """The hingeless rotor is represented with the hinges of the model on the page; the page prints the
    rates."""
    stiffness, speed = names["INERTIA"] * (2 * np.pi * 3.0) ** 2, 400 * np.pi / 30

    def growth(dampers):
        system = names["helicopter"](dampers)

        def matrices(phase, omega):
            M, C, K, d = map(np.copy, system.at(phase, omega))
            K[:, range(2, 6), range(2, 6)] += stiffness
            return M, C, K, d

        springs = solve.PeriodicSystem(matrices, system.coordinates)
        return np.real(solve.floquet(springs, speed).exponents).max()

    rows = re.findall(r"^\| (\d+) % \|(.*)\|$", SECTION, flags=re.MULTILINE)
    assert len(rows) == 4
    for percent, cells in rows:
        lag = LAG * int(percent) / 100
        whole, failed, averaged = (growth(d) for d in ([lag] * 4, [0, lag, lag, lag], [0.75 * lag] * 4))
        printed = [float(cell.replace("−", "-")) for cell in re.findall(r"−?\d+\.\d+", cells)]
        ratio = 100 * (averaged - whole) / (failed - whole)
        np.testing.assert_allclose([whole, failed, averaged], printed[:3], atol=6e-4)
        assert ratio == pytest.approx(printed[3], abs=0.06)


def test_rotor_of_three_blades_with_one_failed_damper_matches(names):
    """The averaged coefficients have two thirds of the damping. The page states the rates."""
    speed = 235 * np.pi / 30
    growth, helicopter = names["growth"], names["helicopter"]
    whole, failed, averaged = (
        growth(dampers, speed) for dampers in ([LAG] * 3, [0, LAG, LAG], [2 / 3 * LAG] * 3)
    )
    assert whole == pytest.approx(constant_growth(helicopter([LAG] * 3), speed), abs=1e-7)
    assert averaged == pytest.approx(constant_growth(helicopter([0, LAG, LAG]), speed), abs=1e-7)
    paragraph = SECTION[SECTION.index("### Three blades") :]
    shown = [float(rate.replace("−", "-")) for rate in re.findall(r"(−?\d\.\d{3}) 1/s", paragraph)]
    assert [round(rate, 3) for rate in (whole, failed, averaged)] == shown


def test_page_prints_what_the_example_prints(capsys):
    exec(EXAMPLE, {})
    printed = re.findall(r"-?\d+\.\d+", capsys.readouterr().out)
    table = [line for line in SECTION.splitlines() if re.match(r"\| \d+ rpm", line)]
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
