"""Stresses of rigid links compared with the quasi-static elastic linkage, and at free ends."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import solve
from models.four_bar.forces import LINKS, bodies, greatest_stress, internal_forces, joint_forces
from models.four_bar.linkage import Linkage
from models.four_bar.studies.linkage import preliminary_stresses
from tests.models.four_bar.cranks import cranks

PARAMETERS = solve.case_numbers("four_bar").parameters
LINKAGE = Linkage(*(PARAMETERS[name] for name in ("L1", "L2", "L3", "L4")))
TURN = np.arange(90) * (2 * math.pi / 90)
SPEED = 10.0


def quasi_static_stress(elements: int, link: str) -> np.ndarray:
    """Largest stress on both surfaces at the middle of a link, from K q = d at each position."""
    model = solve.load("four_bar", options={"elements": elements})
    _, _, K, d = model.at(TURN, SPEED)
    q = np.linalg.solve(K, d[..., None])[..., 0].T
    surfaces = [model.stress(link, 0.5, surface, TURN, q) for surface in ("plus", "minus")]
    return np.abs(surfaces).max(axis=0)


def rigid_stress(link: int) -> np.ndarray:
    motion = LINKAGE.motion(TURN, SPEED)
    middle = np.array([LINKAGE.lengths[link - 1] / 2])
    return greatest_stress(motion, joint_forces(motion, bodies(PARAMETERS)), PARAMETERS, link, middle)[0]


@pytest.mark.parametrize("link", [2, 3])
def test_quasi_static_elastic_stresses_equal_the_rigid_ones(link):
    """The curvature of cubic elements under a distributed load converges with order 2."""
    expected = rigid_stress(link)
    errors = [
        np.abs(quasi_static_stress(elements, LINKS[link - 1]) - expected).max() / expected.max()
        for elements in (4, 8)
    ]
    assert errors[1] < 0.015
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)


def test_crank_stress_with_one_element():
    """The crank rotates at constant speed, so that no distributed load bends it."""
    expected = rigid_stress(1)
    assert np.abs(quasi_static_stress(1, "crank") - expected).max() < 1e-3 * expected.max()


@given(cranks(), st.floats(0, 6.3), st.floats(1, 50))
def test_bending_moments_vanish_at_pins(linkage, t1, speed):
    links = bodies({**PARAMETERS, "L1": linkage.L1, "L2": linkage.L2, "L3": linkage.L3})
    motion = linkage.motion(t1, speed)
    forces = joint_forces(motion, links)
    for link in (1, 2, 3):
        density = PARAMETERS["rho"] * PARAMETERS[f"A{link}"]
        length = linkage.lengths[link - 1]
        through, moment = internal_forces(motion, forces, link, density, np.array([0.0, length]))
        size = np.abs(moment).max() + length * np.abs(through).max()
        assert abs(moment[1]) < 1e-9 * size
        if link == 2:
            assert abs(moment[0]) == 0.0
            np.testing.assert_allclose(
                through[1] * motion.direction(2), -forces.F23, atol=1e-9 * np.abs(through).max()
            )


def test_largest_stress_over_revolution_and_length():
    computed = preliminary_stresses(bodies(PARAMETERS), LINKAGE, PARAMETERS, SPEED)
    phase, places = np.linspace(0, 2 * math.pi, 721), np.linspace(0, 1, 201)
    motion = LINKAGE.motion(phase, SPEED)
    forces = joint_forces(motion, bodies(PARAMETERS))
    for link, name in enumerate(LINKS, start=1):
        at = places * LINKAGE.lengths[link - 1]
        stress = greatest_stress(motion, forces, PARAMETERS, link, at)
        assert computed[name]["peak"] == pytest.approx(stress.max(), rel=1e-3)
        place, when = np.unravel_index(stress.argmax(), stress.shape)
        assert computed[name]["fraction"] == pytest.approx(places[place], abs=0.02)
        assert computed[name]["position"] == pytest.approx(phase[when], abs=0.02)
