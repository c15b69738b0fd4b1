"""Proposal of thesis 9.2: an elastic support of the follower's ground pivot reduces the stress at a limiting
critical speed. A stiff support is equivalent to the rigid support."""

import pytest

import solve
from derive import Section, Structure

PARAMETERS = solve.case_numbers("four_bar").parameters
UNITS = {"L": "m", "A": "m^2", "I": "m^4", "h": "m"}
LIMITING = 45.0
STRESSES = ("crank_root_stress_plus", "coupler_midpoint_stress_plus", "follower_midpoint_stress_plus")


def linkage() -> Structure:
    """Return the four-bar of the thesis with springs of stiffness k at the ground pivot C."""
    made = Structure("elastic_pivot", "Four-bar linkage on an elastic pivot")
    p = {
        f"{kind}{number}": made.parameter(f"{kind}{number}", unit, kind, "> 0")
        for kind, unit in UNITS.items()
        for number in ((1, 2, 3, 4) if kind == "L" else (1, 2, 3))
    }
    E, rho = made.parameter("E", "Pa", "modulus", "> 0"), made.parameter("rho", "kg/m^3", "density", "> 0")
    mA, mB = made.parameter("mA", "kg", "joint A", ">= 0"), made.parameter("mB", "kg", "joint B", ">= 0")
    zeta, k = made.parameter("zeta", "1", "damping ratio", ">= 0"), made.parameter("k", "N/m", "pivot", "> 0")
    t2, t3 = made.four_bar(
        "t2", "t3", crank=p["L1"], coupler=p["L2"], follower=p["L3"], ground=p["L4"], side=1
    )
    ends = {"crank": ("O", "A", made.phase), "coupler": ("A", "B", t2), "follower": ("C", "B", t3)}
    for number, (name, (start, end, angle)) in enumerate(ends.items(), start=1):
        section = Section(E, p[f"A{number}"], p[f"I{number}"], rho, p[f"h{number}"])
        made.link(name, start, end, p[f"L{number}"], angle, section)
    made.clamp("O")
    made.spring("C", x=k, y=k)
    made.mass("A", mA)
    made.mass("B", mB)
    made.damping_ratio = zeta
    return made


def largest(model) -> dict[str, float]:
    orbit = solve.periodic(model, LIMITING, rtol=1e-4)
    return {name: orbit.statistics(name).max_abs for name in STRESSES}


def test_damping_lowers_crank_stress_at_the_limiting_speed():
    rigid = largest(solve.load("four_bar"))
    stiff, soft = (largest(solve.load(linkage(), k=k, **PARAMETERS)) for k in (1e9, 1e4))
    assert stiff == pytest.approx(rigid, rel=1e-3)
    assert soft["crank_root_stress_plus"] < rigid["crank_root_stress_plus"] / 2
