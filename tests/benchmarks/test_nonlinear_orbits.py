"""CVODES reaches the nonlinear orbit to the accuracy of the timed runs."""

import solve
from tests.benchmarks.nonlinear_orbits import marched


def test_marching_reaches_the_orbit_only_with_a_fine_tolerance():
    cam = solve.load("cam", case="1")
    orbit = solve.nonlinear(cam, "300 rpm", rtol=1e-9)
    turns = marched(cam, orbit, 1e-9, 6)
    assert turns is not None
    assert turns > 1
    assert marched(cam, orbit, 1e-5, 6) is None
