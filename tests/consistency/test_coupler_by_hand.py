"""Hand-derived matrices of the flexible coupler, compared with those from the automatically differentiated
Lagrangian."""

import coupler_lagrangian
import numpy as np
import pytest

from models.coupler import published
from models.coupler.published import AS_PRINTED, BRANCHES, CORRECTED, TABLE_2, Misprint

MODES = 4
TOLERANCE = 1e-10
PHASES = 2 * np.pi * np.arange(32) / 32
DRAGGED = TABLE_2 | {"cx": 300.0, "cy": 200.0}
LINKAGES = {
    "paper": TABLE_2,
    "dragged": DRAGGED,
    "everything": DRAGGED | {"l4": 0.7, "E": 2.1e7, "alpha": 0.02, "alpha4": 0.4, "theta": 0.3, "Me": 70.0},
    "double crank": DRAGGED | {"l1": 0.2, "l2": 0.7, "l4": 0.6, "E": 2.1e9, "Me": -20.0},
}


def by_hand(linkage, speed, branch, misprints=CORRECTED):
    return published.matrices(PHASES, speed, linkage, MODES, branch, misprints)


def by_energies(linkage, speed, branch):
    return coupler_lagrangian.linearised(PHASES, speed, linkage, MODES, BRANCHES[branch])


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("branch", BRANCHES)
@pytest.mark.parametrize("rpm", [600, 1500, 4000])
def test_hand_equations_equal_the_linearised_lagrangian(name, branch, rpm):
    linkage, speed = LINKAGES[name], rpm * np.pi / 30
    reference = by_energies(linkage, speed, branch)
    errors = reference.errors(*by_hand(linkage, speed, branch))
    assert all(error < TOLERANCE for error in errors.values()), errors


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("branch", BRANCHES)
def test_axial_force_equals_the_reaction_at_the_crank_pin(name, branch):
    linkage, speed = LINKAGES[name], 50 * np.pi
    by_load = linkage["E"] * linkage["I"] * published.load_functions(PHASES, speed, linkage, branch).f4
    reaction = by_energies(linkage, speed, branch).axial_force
    np.testing.assert_allclose(by_load, reaction, atol=1e-11 * abs(reaction).max(), rtol=0)


DIAGONAL = np.eye(MODES, dtype=bool)
ODD = np.add.outer(np.arange(MODES), np.arange(MODES)) % 2 == 1
EVEN = ~DIAGONAL & ~ODD

# Size: largest deviation from the Lagrangian, over the variation of C, of the paper's linkage at 1500 rpm.
STIFFNESS_MISPRINTS = [
    (Misprint.AXIAL_DRAG_SIGN, DIAGONAL | ODD, 3.41e-7),
    (Misprint.END_FORCE, DIAGONAL, 2.83e-3),
    (Misprint.MODE_COUPLING, ODD | EVEN, 3.65e-2),
    (Misprint.LOST_CENTRIFUGAL, DIAGONAL, 1.08e-4),
    (Misprint.CENTRIFUGAL_SIGN, DIAGONAL, 5.94e-3),
    (Misprint.EVEN_SUM_ODD, ODD | EVEN, 1.32e-3),
]


@pytest.mark.parametrize(("misprint", "entries", "size"), STIFFNESS_MISPRINTS)
def test_each_misprint_of_the_stiffness_is_detected(misprint, entries, size):
    speed = 50 * np.pi
    M, B, C, h = by_hand(TABLE_2, speed, "open", frozenset({misprint}))
    reference = by_energies(TABLE_2, speed, "open")
    deviation = abs(C - reference.C).max(axis=0) / coupler_lagrangian.variation(reference.C)
    assert np.all(deviation[entries] > 10 * TOLERANCE), "an entry that the misprint should spoil agrees"
    assert np.all(deviation[~entries] < TOLERANCE), "an entry that the misprint should leave alone deviates"
    assert deviation.max() == pytest.approx(size, rel=0.01)
    for hand, energies in ((M, reference.M), (B, reference.B), (h, reference.h)):
        np.testing.assert_allclose(hand, energies, rtol=0, atol=TOLERANCE * abs(energies).max())


def test_misprint_of_the_damping_is_detected():
    speed = 50 * np.pi
    _, B, C, _ = by_hand(TABLE_2, speed, "open", frozenset({Misprint.MATERIAL_DAMPING}))
    reference = by_energies(TABLE_2, speed, "open")
    # α is 1e-4 s, and ρ/E 3.7e-8 in its place next to nothing: B loses all but the drag.
    assert abs(B - reference.B).max() / abs(reference.B).max() == pytest.approx(1, rel=1e-3)
    assert abs(C - reference.C).max() < TOLERANCE * coupler_lagrangian.variation(reference.C)


def test_every_misprint_of_the_stiffness_has_the_expected_size():
    sized = {misprint for misprint, _, _ in STIFFNESS_MISPRINTS} | {Misprint.MATERIAL_DAMPING}
    assert sized == set(Misprint)
    assert set(Misprint) - AS_PRINTED == {Misprint.CENTRIFUGAL_SIGN, Misprint.EVEN_SUM_ODD}


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("branch", BRANCHES)
def test_hand_written_loop_closes_on_its_branch(name, branch):
    linkage, speed = LINKAGES[name], 3.0
    motion = published.link_angles(PHASES, speed, linkage, branch)
    crank_pin = linkage["l2"] * np.exp(1j * PHASES)
    pivot = linkage["l1"] * np.exp(1j * linkage["theta"])
    joint_by_coupler = crank_pin + linkage["l3"] * np.exp(1j * motion.phi3)
    joint_by_follower = pivot + linkage["l4"] * np.exp(1j * motion.phi4)
    assert abs(joint_by_coupler - joint_by_follower).max() < 1e-14
    assert np.all(BRANCHES[branch] * np.sin(motion.phi4 - motion.phi3) > 0)
    if name != "double crank":
        height_over_ground_line = np.sin(motion.phi4 - linkage["theta"])
        assert np.all(BRANCHES[branch] * height_over_ground_line > 0)


@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("branch", BRANCHES)
def test_drive_torque_matches_the_power_of_the_rigid_linkage(name, branch):
    """Energies and losses of the straight coupler follow from the hand-derived angles, differentiated by
    FFT."""
    p, speed, count = LINKAGES[name], 50 * np.pi, 256
    phase = 2 * np.pi * np.arange(count) / count
    motion = published.link_angles(phase, speed, p, branch)
    mu, length = p["rho"] * p["A"], p["l3"]
    direction, pin = np.exp(1j * motion.phi3), p["l2"] * np.exp(1j * phase)
    pin_velocity = 1j * speed * pin / direction
    centre_velocity = pin_velocity + 1j * motion.phi3d * length / 2
    inertia = mu * length**3 / 12 + p["rho"] * p["I"] * length
    kinetic = (
        mu * length * abs(centre_velocity) ** 2 + inertia * motion.phi3d**2 + p["JC"] * motion.phi4d**2
    ) / 2
    height = (pin + length / 2 * direction).imag
    potential = mu * length * p["g"] * height + p["m4"] * p["g"] * p["s4"] * np.sin(motion.phi4 + p["alpha4"])
    across = length * centre_velocity.imag**2 + length**3 / 12 * motion.phi3d**2
    loss = p["cx"] * length * pin_velocity.real**2 + p["cy"] * across + p["Me"] * motion.phi4d
    harmonic = 1j * np.fft.fftfreq(count, 1 / count)
    rate = speed * np.fft.ifft(harmonic * np.fft.fft(kinetic + potential)).real
    torque = (rate + loss) / speed
    reference = coupler_lagrangian.linearised(phase, speed, p, 1, BRANCHES[branch]).drive_torque
    np.testing.assert_allclose(reference, torque, rtol=0, atol=1e-10 * abs(torque).max())


def test_additional_modes_do_not_change_the_equations_of_lower_modes():
    many = published.matrices(PHASES, 50 * np.pi, TABLE_2, 20)
    few = published.matrices(PHASES, 50 * np.pi, TABLE_2, MODES)
    for large, small in zip(many[:3], few[:3], strict=True):
        np.testing.assert_array_equal(large[:, :MODES, :MODES], small)
    np.testing.assert_array_equal(many[3][:, :MODES], few[3])


def test_linkage_that_cannot_turn_is_refused():
    message = r"l2 = 0\.9 m cannot turn fully .* choose lengths"
    with pytest.raises(published.LinkageCannotTurnError, match=message):
        published.link_angles(PHASES, 1.0, TABLE_2 | {"l2": 0.9})
