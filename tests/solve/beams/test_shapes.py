"""Mode shapes: largest displacement, continuity, masses, and known shapes."""

import numpy as np
import pytest

import solve
from solve.beams.assembly import Positions
from solve.beams.frequencies import exact_frequencies, shapes
from tests.solve.beams.frames import beam, beams


def exact_shapes(frame, count, phase=0.0):
    frequencies = exact_frequencies(Positions(frame, np.array([phase])), count)[0]
    return shapes(frame, phase, frequencies)


@pytest.mark.parametrize("kind", ["dynamic", "internal"])
def test_pinned_beam_has_sinusoidal_mode_shapes(kind):
    frame = beam("pinned", "pinned", kind, 1 if kind == "dynamic" else 6, angle=0.4, EA=1e6)
    if kind == "dynamic":
        computed = exact_shapes(frame, 3)
    else:
        computed = shapes(frame, 0.0, (np.arange(1, 4) * np.pi) ** 2)
    for k, shape in enumerate(computed, start=1):
        x = np.linalg.norm(shape.places[0], axis=1)
        sine = np.sin(k * np.pi * x)
        v = shape.transverse[0] * np.sign(shape.transverse[0] @ sine)
        np.testing.assert_allclose(v, sine / np.abs(sine).max(), atol=2e-4)
        assert shape.modal_mass == pytest.approx(0.5, rel=2e-3)


def test_displacements_have_transverse_and_axial_components():
    frame = beam("clamped", "free", "dynamic", angle=0.7, EA=10.0)
    for shape in exact_shapes(frame, 5):
        across = np.array([-np.sin(0.7), np.cos(0.7)])
        np.testing.assert_allclose(shape.displacements[0] @ across, shape.transverse[0], atol=1e-9)
        assert np.linalg.norm(shape.displacements[0], axis=1).max() == pytest.approx(1)
    assert np.abs(exact_shapes(frame, 2)[1].transverse[0]).max() < 1e-6, "the second mode only stretches"


def test_links_remain_connected_in_every_mode():
    model = solve.load("four_bar", options={"element": "dynamic"})
    for shape in solve.frequencies(model, "40 deg", 6).shapes():
        crank, coupler, follower = shape.displacements
        np.testing.assert_allclose(crank[0], 0, atol=1e-9)
        np.testing.assert_allclose(crank[-1], coupler[0], atol=1e-9)
        np.testing.assert_allclose(coupler[-1], follower[-1], atol=1e-9)
        np.testing.assert_allclose(follower[0], 0, atol=1e-9)


def test_exact_shapes_and_modal_masses_match_a_fine_mesh():
    exact, fine = (
        solve.frequencies(solve.load("four_bar", options=options), 2.0, 4).shapes()
        for options in ({"element": "dynamic"}, {"element": "internal", "elements": 6})
    )
    for one, other in zip(exact, fine, strict=True):
        assert one.modal_mass == pytest.approx(other.modal_mass, rel=1e-4)
        for link, (a, b) in enumerate(zip(one.transverse, other.transverse, strict=True)):
            peaks = np.abs(a).max(), np.abs(b).max()
            assert peaks[0] == pytest.approx(peaks[1], abs=2e-3), f"link {link}"


def test_modes_without_joint_motion_are_drawn():
    """In the fourth mode of the portal frame, the joints do not move: three beams clamped at both ends."""
    model = solve.load("portal_frame", options={"element": "dynamic"})
    fourth = solve.frequencies(model, count=4).shapes()[3]
    for displacement, transverse in zip(fourth.displacements, fourth.transverse, strict=True):
        np.testing.assert_allclose(displacement[[0, -1]], 0, atol=1e-8)
        assert np.abs(transverse).max() == pytest.approx(1, abs=1e-3)
        np.testing.assert_allclose(transverse, transverse[::-1], atol=1e-6)


def test_modes_of_double_frequencies_are_different():
    links = [("one", "A", "B", "", "b"), ("two", "A", "C", "", "c")]
    frame = beams(links, ["A"], 1.0, [0.0, 1.0], "dynamic")
    first, second = exact_shapes(frame, 2)
    amplitudes = np.array([[t[-1] for t in shape.transverse] for shape in (first, second)])
    assert abs(np.linalg.det(amplitudes)) > 0.1
