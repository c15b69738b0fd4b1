"""Steady state of the flexible four-bar linkage (Chapter 6 of the thesis): reference values and invariants.

The reference values were computed by an independent program with the definitions in Table 4.1 and section 6.2
of the thesis.
"""

from functools import cache

import numpy as np
import pytest

import solve
from solve.equations import output_values
from solve.errors import NoMotionError, UnknownNameError, ValueOutOfBoundsError
from solve.results.periodic_motion import QuasiStatic

PHASE = np.linspace(0, 2 * np.pi, 3601)


@cache
def model_with(**options):
    return solve.load("four_bar", options=options)


@cache
def orbit(speed, **options):
    return solve.periodic(model_with(**options), speed, rtol=1e-7)


def values(computed, name):
    """Output over a revolution, at every tenth of a degree."""
    return output_values(computed.system, PHASE, computed.speed, *computed.state(PHASE))[name]


@pytest.mark.parametrize(
    ("speed", "deflection", "degrees", "radius"),
    [(30.0, 0.0109651, 33.155, 0.446954), (62.0, 0.1193546, 75.781, 0.674320)],
)
def test_deflection_and_spectral_radius_with_one_element_per_link(speed, deflection, degrees, radius):
    computed = orbit(speed)
    range_ = computed.statistics("follower_midpoint_deflection")
    assert range_.max_abs == pytest.approx(deflection, rel=1e-5)
    assert computed.spectral_radius == pytest.approx(radius, rel=1e-5)
    near = np.radians(degrees + np.array([-0.2, 0.0, 0.2]))
    state = computed.state(near)
    w = np.abs(output_values(computed.system, near, speed, *state)["follower_midpoint_deflection"])
    parabola = np.polynomial.polynomial.polyfit(np.degrees(near) - degrees, w, 2)
    assert degrees - parabola[1] / (2 * parabola[2]) == pytest.approx(degrees, abs=1e-3)


@pytest.mark.parametrize(
    ("elements", "stress"),
    [(1, 99.6), (2, 146.8), (3, 118.0), pytest.param(4, 129.0, marks=pytest.mark.slow)],
)
def test_follower_midpoint_stress_for_several_numbers_of_elements(elements, stress):
    computed = orbit(30.0, elements=elements)
    assert computed.statistics("follower_midpoint_stress_plus").max_abs / 1e6 == pytest.approx(
        stress, abs=0.05
    )


@pytest.mark.slow
def test_follower_midpoint_stress_converges():
    """Elements with quintic shape functions agree with many cubic ones, whose error is proportional to h²."""
    stress = {
        (element, elements): orbit(30.0, element=element, elements=elements)
        .statistics("follower_midpoint_stress_plus")
        .max_abs
        / 1e6
        for element, elements in (("internal", 2), ("cubic", "1,2,7"), ("cubic", "1,2,8"))
    }
    assert stress["internal", 2] == pytest.approx(123.0, abs=0.5)
    odd, even = stress["cubic", "1,2,7"], stress["cubic", "1,2,8"]
    assert odd < stress["internal", 2] < even


@pytest.mark.slow
@pytest.mark.parametrize(("option", "change"), [({"terms": "full"}, 0.04), ({"stiffening": "on"}, 24.0)])
def test_effect_of_terms_that_the_instantaneous_structure_omits(option, change):
    """Largest change at the follower's midpoint over a revolution, in percent of the largest deflection."""
    before, after = (
        values(orbit(30.0, elements=3, **options), "follower_midpoint_deflection") for options in ({}, option)
    )
    computed = 100 * np.abs(after - before).max() / np.abs(before).max()
    assert computed == pytest.approx(change, rel=0.05)


@pytest.mark.slow
def test_full_terms_conserve_energy_without_damping():
    """The instantaneous structure omits M′q̇, so that its |ρ| does not determine stability."""
    radius = {
        terms: solve.floquet(solve.load("four_bar", options={"terms": terms}, zeta=0.0), 30.0, rtol=1e-7)
        for terms in ("full", "instantaneous")
    }
    assert radius["full"].spectral_radius == pytest.approx(1.0, abs=1e-5)
    assert radius["instantaneous"].spectral_radius > 1.01
    assert not any("terms=full" in warning for warning in radius["full"].warnings)
    assert any("M'q'" in warning and "terms=full" in warning for warning in radius["instantaneous"].warnings)


def test_rayleigh_damping_gives_the_lowest_mode_the_ratio_on_average():
    model = solve.load("four_bar", options={"damping": "rayleigh"})
    M, C, K, _ = model.at(np.linspace(0, 2 * np.pi, 36, endpoint=False), 30.0)
    squares, vectors = np.linalg.eig(np.linalg.solve(M, K))
    order = np.argsort(squares.real, axis=1)[:, :2]
    omega = np.sqrt(np.take_along_axis(squares.real, order, axis=1))
    shapes = np.take_along_axis(vectors.real, order[:, None, :], axis=2)
    ratio = [np.einsum("mik,mij,mjk->mk", shapes, A, shapes) for A in (C, M)]
    assert (ratio[0] / ratio[1] / (2 * omega)).mean(axis=0) == pytest.approx([0.02, 0.02], rel=0.01)


@pytest.mark.parametrize("element", ["cubic", "internal", "curvature"])
def test_load_matches_the_rigid_body_inertia(element):
    """Virtual work of the load for a rigid rotation of the follower about C, by Newton's law for a bar."""
    options = {"element": element, "elements": "1,1,2"}
    model = solve.load("four_bar", options=options, mA=0.0, mB=0.0)
    phase, speed, p = np.array([0.4, 2.0, 5.0]), 30.0, model.parameters
    _, _, _, d = model.at(phase, speed)
    angle = model.beams.angle(phase)[:, 2]
    h = 1e-4
    alpha = (
        speed**2
        * (model.beams.angle(phase + h) - 2 * model.beams.angle(phase) + model.beams.angle(phase - h))[:, 2]
        / h**2
    )
    turn = np.zeros((3, model.n))
    for name, column in zip(model.coordinates, turn.T, strict=True):
        place = {"B": 1.0, "follower_1": 0.25 if element == "internal" else 0.5}
        place |= {"follower_2": 0.5, "follower_3": 0.75}
        owner, _, what = name.rpartition("_")
        if owner in place and what in "xy":
            arm = place[owner] * p["L3"]
            column[:] = arm * (-np.sin(angle) if what == "x" else np.cos(angle))
        elif name.startswith("follower") and what == "turn":
            column[:] = 1.0
    # The coupler loads B too: what half the follower's section takes away is the follower's alone.
    light = solve.load("four_bar", options=options, mA=0.0, mB=0.0, A3=p["A3"] / 2)
    work = np.einsum("mi,mi->m", d - light.at(phase, speed)[3], turn)
    mass = p["rho"] * p["A3"] / 2 * p["L3"]
    assert work == pytest.approx(-mass * p["L3"] ** 2 / 3 * alpha, rel=1e-5)


def test_stress_and_deflection_at_any_point_agree_with_the_outputs():
    computed = orbit(30.0)
    model, phase = computed.system, np.array([0.3, 1.0, 4.0])
    outputs = output_values(model, phase, 30.0, *computed.state(phase))
    q = computed.at(phase)
    assert model.stress("follower", 0.5, "plus", phase, q) == pytest.approx(
        outputs["follower_midpoint_stress_plus"]
    )
    assert model.deflection("crank", 1.0, phase, q) == pytest.approx(outputs["crank_tip_deflection"])
    assert model.deflection("crank", 0.0, phase, q) == pytest.approx([0.0] * 3, abs=1e-15)
    with pytest.raises(UnknownNameError, match="follower"):
        model.stress("folower", 0.5, "plus", phase, q)
    with pytest.raises(UnknownNameError, match="surface"):
        model.stress("follower", 0.5, "top", phase, q)
    with pytest.raises(ValueOutOfBoundsError, match="0 to 1"):
        model.deflection("follower", 1.5, phase, q)


def test_exact_elements_have_no_equations_of_motion():
    with pytest.raises(NoMotionError, match="choose another element"):
        solve.periodic(solve.load("four_bar", options={"element": "dynamic"}), 30.0)


def test_uncoupled_modes_are_accurate_for_the_follower_only():
    """Section 6.3 of the thesis: largest error over a revolution at 35 rad/s, in percent of the largest
    deflection."""
    model = model_with(elements=3)
    truth = solve.periodic(model, 35.0, rtol=1e-7)
    uncoupled = solve.periodic(model, 35.0, method="modal", steps=720)
    error = {}
    for link in ("follower", "coupler"):
        exact, computed = (values(each, f"{link}_midpoint_deflection") for each in (truth, uncoupled))
        error[link] = 100 * np.abs(computed - exact).max() / np.abs(exact).max()
    assert error["follower"] == pytest.approx(4, abs=0.5)
    assert error["coupler"] == pytest.approx(98, abs=0.5)


def test_euler_buckling_warning_states_link_load_and_angle():
    """The coupler transmits the force that accelerates the follower. Its own inertia is small compared with
    mB."""
    heavy = {"options": {"stiffening": "on"}, "mB": 20.0}
    light = model_with(stiffening="on")
    assert light.warnings(30.0) == []
    model = solve.load("four_bar", **heavy)
    p = model.parameters
    euler = np.pi**2 * p["E"] * p["I2"] / p["L2"] ** 2
    phase = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    forces = output_values(model, phase, 1.0, *QuasiStatic(model, 1.0).state(phase))
    angle = model.at_positions(phase).angle[:, 1]
    along = forces["A_force_x"] * np.cos(angle) + forces["A_force_y"] * np.sin(angle)
    limit = np.sqrt(euler / along.max())
    (message,) = [warning for warning in model.warnings(1.02 * limit) if "coupler" in warning]
    assert f"Euler load of {euler:.4g} N" in message
    degrees = float(message.split(" deg")[0].split()[-1])
    assert degrees == pytest.approx(np.degrees(phase[along.argmax()]), abs=3)
    assert not any("coupler" in warning for warning in model.warnings(0.98 * limit))


def test_sweeps_contain_the_warnings_of_their_speeds():
    model = model_with(stiffening="on")
    sweep = solve.sweep(model, [30.0, 90.0], rtol=1e-4, quantities=["A_x"])
    for speed, point in zip((30.0, 90.0), sweep.points, strict=True):
        assert list(point.warnings) == model.warnings(speed)
    assert len(sweep.points[1].warnings) == 1


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"zeta": -0.01}, "zeta .* -0.01.*>= 0"),
        ({"L4": 0.8}, "the crank cannot turn fully"),
        ({"L1": -1.0}, "> 0"),
    ],
)
def test_impossible_linkages_are_refused(parameters, message):
    with pytest.raises(ValueOutOfBoundsError, match=message):
        solve.load("four_bar", **parameters)


def test_damping_ratios_in_percent_raise_a_warning():
    assert any("write 2 % as 0.02" in warning for warning in solve.load("four_bar", zeta=2.0).warnings(30.0))
    with pytest.raises(ValueOutOfBoundsError, match="speed"):
        solve.periodic(solve.load("four_bar"), 0.0)


@pytest.mark.parametrize(
    ("steps", "radius"),
    [
        (90, 98.8),
        pytest.param(180, 124, marks=pytest.mark.slow),
        pytest.param(360, 0.794, marks=pytest.mark.slow),
        (720, 0.4849),
    ],
)
def test_false_multipliers_of_newmark_are_flagged(steps, radius):
    """With fewer than about 720 steps, the average-acceleration method yields wrong multipliers for
    unresolved stiff modes. The values are those of an independent implementation. The correct value is
    0.48504."""
    model = model_with(elements=3)
    stability = solve.floquet(model, 30.0, method="newmark", steps=steps)
    assert stability.spectral_radius == pytest.approx(radius, rel=5e-4 if radius < 1 else 5e-3)
    assert (
        stability.error_estimate.multipliers
        > abs(stability.spectral_radius - 0.48504) / stability.spectral_radius
    )
    assert any("multipliers may be wrong" in warning for warning in stability.warnings)
