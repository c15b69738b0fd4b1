"""Derived coupler, compared with hand-derived equations and the automatically differentiated Lagrangian."""

import importlib
from functools import cache

import casadi as ca
import coupler_lagrangian
import numpy as np
import pytest
from chapter import sampled, scaled_difference
from hypothesis import given, settings
from hypothesis import strategies as st

import solve
from models.coupler import published
from models.coupler.published import AS_PRINTED, BRANCHES, CORRECTED, TABLE_2, Misprint

GENERATED = importlib.import_module("generated.coupler")
NAMES = [name for name, *_ in GENERATED.PARAMETERS]
MODES = 4
PHASES = 2 * np.pi * np.arange(32) / 32
SPEEDS = [rpm * np.pi / 30 for rpm in (600, 1500, 4000)]
DRAGGED = TABLE_2 | {"cx": 300.0, "cy": 200.0}
LINKAGES = {
    "paper": TABLE_2,
    "dragged": DRAGGED,
    "everything": DRAGGED | {"l4": 0.7, "E": 2.1e7, "alpha": 0.02, "alpha4": 0.4, "theta": 0.3, "Me": 70.0},
    "double crank": DRAGGED | {"l1": 0.2, "l2": 0.7, "l4": 0.6, "E": 2.1e9, "Me": -20.0},
}
linkages = pytest.mark.parametrize("linkage", LINKAGES.values(), ids=LINKAGES)
branches = pytest.mark.parametrize("branch", BRANCHES)
speeds = pytest.mark.parametrize("speed", SPEEDS)


@cache
def built(function: str, modes: int = MODES, branch: str = "open") -> ca.Function:
    return getattr(GENERATED, function)(modes=modes, branch=branch)


def vector(linkage):
    return [linkage[name] for name in NAMES]


def derived(linkage, speed, branch="open", modes=MODES, phases=PHASES):
    return sampled(built("linearised", modes, branch), phases, speed, vector(linkage))


def test_parameters_match_the_lagrangian_reference():
    assert " ".join(NAMES) == coupler_lagrangian.PARAMETERS


@linkages
@branches
@speeds
def test_derived_equals_the_linearised_lagrangian(linkage, branch, speed):
    reference = coupler_lagrangian.linearised(PHASES, speed, linkage, MODES, BRANCHES[branch])
    errors = reference.errors(*derived(linkage, speed, branch))
    assert all(error < 1e-10 for error in errors.values()), errors


@linkages
@branches
@speeds
def test_derived_equals_the_corrected_equations_by_hand(linkage, branch, speed):
    by_hand = published.matrices(PHASES, speed, linkage, MODES, branch)
    for label, first, second in zip("MBCh", derived(linkage, speed, branch), by_hand, strict=True):
        assert scaled_difference(first, second) < 1e-12, label


@st.composite
def random_linkages(draw):
    """Strategy for couplers with random values of all 18 parameters and a crank that can rotate with some
    margin."""
    short, longer = draw(st.floats(0.05, 1.0)), draw(st.floats(0.1, 1.0))
    l1, l2 = draw(st.permutations([short, short + longer]))
    together = l1 + l2 + 0.1 + draw(st.floats(0, 1.0))
    difference = (abs(l1 - l2) - 0.05) * draw(st.floats(-0.9, 0.9))
    positive, signed = st.floats(-2.0, 2.0).map(lambda exponent: 10.0**exponent), st.floats(-3.0, 3.0)
    lengths = {"l1": l1, "l2": l2, "l3": (together + difference) / 2, "l4": (together - difference) / 2}
    others = {name: draw(positive) for name in ("s4", "m4", "A", "I", "rho", "cx", "cy", "JC", "alpha", "g")}
    stiff = draw(positive) * 1e4
    return lengths | others | {"E": stiff} | {name: draw(signed) for name in ("alpha4", "theta", "Me")}


@branches
@settings(max_examples=60, deadline=None)
@given(linkage=random_linkages(), speed=st.floats(0.1, 100.0))
def test_derived_equals_the_equations_by_hand_for_any_parameters(branch, linkage, speed):
    by_hand = published.matrices(PHASES, speed, linkage, MODES, branch)
    for label, first, second in zip("MBCh", derived(linkage, speed, branch), by_hand, strict=True):
        scale = abs(second).max()
        assert abs(first - second).max() < 1e-12 * scale, label


DIAGONAL = np.eye(MODES, dtype=bool)
ODD = np.add.outer(np.arange(MODES), np.arange(MODES)) % 2 == 1
EVEN = ~DIAGONAL & ~ODD
SLIPS = {
    Misprint.AXIAL_DRAG_SIGN: DIAGONAL | ODD,
    Misprint.END_FORCE: DIAGONAL,
    Misprint.MODE_COUPLING: ODD | EVEN,
    Misprint.LOST_CENTRIFUGAL: DIAGONAL,
    Misprint.CENTRIFUGAL_SIGN: DIAGONAL,
    Misprint.EVEN_SUM_ODD: ODD | EVEN,
}


@pytest.mark.parametrize("slip", SLIPS)
def test_each_misprint_of_the_stiffness_differs_from_the_derivation(slip):
    _, _, C, _ = derived(TABLE_2, SPEEDS[1])
    printed = published.matrices(PHASES, SPEEDS[1], TABLE_2, MODES, "open", frozenset({slip}))[2]
    deviation = abs(C - printed).max(axis=0) / coupler_lagrangian.variation(C)
    assert deviation[SLIPS[slip]].min() > 1e-9, "an entry that the slip should spoil agrees"
    assert deviation[~SLIPS[slip]].max() < 1e-12, "an entry that the slip should leave alone deviates"


def test_printed_damping_differs_from_the_derivation():
    _, B, _, _ = derived(TABLE_2, SPEEDS[1])
    slip = frozenset({Misprint.MATERIAL_DAMPING})
    printed = published.matrices(PHASES, SPEEDS[1], TABLE_2, MODES, "open", slip)[1]
    assert abs(B - printed).max() > 0.99 * abs(B).max()


def test_every_misprint_of_the_stiffness_is_listed():
    assert {*SLIPS, Misprint.MATERIAL_DAMPING} == set(Misprint)
    assert AS_PRINTED < set(Misprint) != CORRECTED


def differentiated(motion: ca.Function, rows: int) -> ca.Function:
    """Return the first outputs of a motion and their derivatives with respect to q, q̇ and q̈ at zero."""
    inputs = [ca.SX.sym(motion.name_in(k), *motion.size_in(k)) for k in range(motion.n_in())]
    state = ca.vertcat(*inputs[2:5])
    outputs = ca.vertcat(*motion.call(inputs)[:rows])
    whole = ca.horzcat(outputs, ca.jacobian(outputs, state))
    straight = ca.substitute(whole, state, ca.DM.zeros(state.shape))
    return ca.Function("differentiated", [*inputs[:2], *inputs[5:]], [ca.vec(straight)])


@linkages
@branches
@speeds
def test_drive_torque_and_axial_force_match_to_first_order(linkage, branch, speed):
    """The torque includes first-order terms of the amplitudes. The axial force is that of the straight
    coupler."""
    p, side = vector(linkage), BRANCHES[branch]
    exact = exact_by_state()(PHASES[None], speed, p, side).full()
    computed = reactions_by_state(branch)(PHASES[None], speed, p).full()
    ends = [1, 1 + MODES, 1 + 2 * MODES]
    for torque, reference in zip(np.split(computed[::2], ends), np.split(exact[::2], ends), strict=True):
        assert abs(torque - reference).max() < 1e-10 * abs(reference).max()
    assert abs(computed[1] - exact[1]).max() < 1e-10 * abs(exact[1]).max()
    assert not computed[3::2].any()


@cache
def exact_by_state() -> ca.Function:
    return differentiated(coupler_lagrangian.motion(MODES), 2)


@cache
def reactions_by_state(branch: str) -> ca.Function:
    return differentiated(reactions(branch), 2)


@cache
def reactions(branch: str) -> ca.Function:
    """Return drive torque and axial force of the generated outputs, in the order of inputs of the
    reference."""
    outputs = built("outputs", MODES, branch)
    inputs = [ca.SX.sym(outputs.name_in(k), *outputs.size_in(k)) for k in range(outputs.n_in())]
    values = dict(zip(outputs.name_out(), outputs.call(inputs), strict=True))
    return ca.Function("reactions", inputs, [values["drive_torque"], values["axial_force"]])


@branches
def test_axial_force_equals_f4_of_the_paper(branch):
    zero = np.zeros(MODES)
    outputs = built("outputs", MODES, branch)
    force = outputs(PHASES[None], SPEEDS[1], zero, zero, zero, vector(DRAGGED))[2].full()[0]
    by_hand = DRAGGED["E"] * DRAGGED["I"] * published.load_functions(PHASES, SPEEDS[1], DRAGGED, branch).f4
    np.testing.assert_allclose(force, by_hand, rtol=0, atol=1e-12 * abs(by_hand).max())


@pytest.mark.parametrize(("rpm", "torque_error", "force_error"), [(600, 2e-5, 3e-4), (1500, 1e-3, 1.5e-3)])
def test_outputs_match_the_nonlinear_equations_on_the_orbit(rpm, torque_error, force_error):
    """The differences due to first-order terms and w = 0 are small for the motion of Table 2."""
    orbit = solve.periodic(solve.load("coupler"), f"{rpm} rpm", "radau")
    state = (orbit.q, orbit.qd, orbit.qdd)
    exact = coupler_lagrangian.motion(3)(orbit.phase[None], orbit.speed, *state, vector(TABLE_2), 1.0)
    for name, bound, reference in (
        ("drive_torque", torque_error, exact[0]),
        ("axial_force", force_error, exact[1]),
    ):
        error = abs(orbit.outputs[name] - reference.full()[0]).max() / abs(reference.full()).max()
        assert error < bound, name


def test_outputs_at_midspan_match_hand_calculations():
    """Deflection, moment and stress of a 20 × 30 mm section, and the two ratios, follow from sines and f0 …
    f4."""
    q, qd, qdd = np.random.default_rng(5).normal(size=(3, MODES)) * 1e-3
    p, speed = TABLE_2, SPEEDS[1]
    values = built("outputs")(PHASES[None], speed, q, qd, qdd, vector(p))
    computed = {name: value.full()[0] for (name, *_), value in zip(GENERATED.OUTPUTS, values, strict=True)}
    k, EI, half = np.arange(1, MODES + 1) * np.pi, p["E"] * p["I"], p["l3"] / 2
    deflection = np.sin(k / 2) @ q
    moment = -EI * np.sin(k / 2) @ (q * (k / p["l3"]) ** 2)
    loads = published.load_functions(PHASES, speed, p)
    force = EI * (loads.f4 + loads.f3 * half - loads.f2 * half**2 / 2)
    height = 0.03
    expected = {
        "midpoint_deflection": deflection,
        "bending_moment": moment,
        "stress": force / p["A"] - moment * height / 2 / p["I"],
        "deflection_ratio": abs(deflection) / p["l3"],
        "euler_ratio": abs(loads.f4) * (p["l3"] / np.pi) ** 2,
    }
    for name, value in expected.items():
        np.testing.assert_allclose(
            computed[name], np.broadcast_to(value, PHASES.shape), rtol=1e-11, err_msg=name
        )


def test_additional_modes_do_not_change_the_equations_of_lower_modes():
    many, few = derived(TABLE_2, SPEEDS[1], modes=20), derived(TABLE_2, SPEEDS[1])
    for large, small in zip(many[:3], few[:3], strict=True):
        np.testing.assert_array_equal(large[:, :MODES, :MODES], small)
    np.testing.assert_array_equal(many[3][:, :MODES], few[3])
    for first, second in zip(many, published.matrices(PHASES, SPEEDS[1], TABLE_2, 20), strict=True):
        assert scaled_difference(first, second) < 1e-12


@branches
def test_residual_agrees_with_the_lagrangian_to_first_order(branch):
    """In one direction of motion, the difference decreases at least with the square of the amplitude."""
    q, qd, qdd = np.random.default_rng(6).normal(size=(3, MODES)) * np.array([[1e-3], [1e-1], [10.0]])
    p, speed, phase = vector(DRAGGED), SPEEDS[1], 0.7
    residual, exact = built("residual", MODES, branch), coupler_lagrangian.motion(MODES)

    def difference(size):
        moved = [size * part for part in (q, qd, qdd)]
        nonlinear = exact(phase, speed, *moved, p, BRANCHES[branch])[2]
        return abs(residual(phase, speed, *moved, p).full() - nonlinear.full()).max()

    assert 0 < difference(0.1) < 1.2e-2 * difference(1.0)
