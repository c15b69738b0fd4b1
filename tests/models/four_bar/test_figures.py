"""Data of the figures of the rigid linkage."""

import math

import numpy as np
import pytest
from matplotlib.patches import Polygon
from matplotlib.path import Path

from models.four_bar.barker import base_plane, classify
from models.four_bar.forces import bodies, joint_forces
from models.four_bar.linkage import Linkage, LinkageError
from models.four_bar.views.base_planes import base_planes_figure
from models.four_bar.views.figures import linkage_figure
from solve import case_numbers
from tests.models.four_bar.cranks import THESIS

LINKS = bodies(case_numbers("four_bar").parameters)
POINT = 0.1 + 0.15j


def lines_with(axes, count: int) -> list[np.ndarray]:
    """Lines with the given number of points, as complex numbers."""
    lines = (np.asarray(line.get_xydata()) for line in axes.lines)
    return [line[:, 0] + 1j * line[:, 1] for line in lines if len(line) == count]


def test_coupler_curve_and_twelve_positions_are_drawn():
    linkage = Linkage(*THESIS)
    figure = linkage_figure(linkage, LINKS, None, [POINT], math.radians(70))
    picture = figure.axes[0]
    turn = linkage.motion(np.linspace(0, 2 * math.pi, 721))
    circle, arc, path = lines_with(picture, 721)
    np.testing.assert_allclose(np.abs(circle), 0.170)
    np.testing.assert_allclose(np.abs(arc - 0.547), 0.525)
    np.testing.assert_allclose(path, turn.position(2, POINT))
    positions = lines_with(picture, 4)
    assert len(positions) == 12
    for k, (first, A, B, last) in enumerate(positions):
        assert (first, last) == (0, 0.547)
        assert math.degrees(np.angle(A)) % 360 == pytest.approx(30 * k, abs=1e-9)
        assert abs(B - A) == pytest.approx(0.328)
    assert picture.get_aspect() == 1.0


def test_plotted_curves_match_the_linkage():
    linkage = Linkage(*THESIS)
    figure = linkage_figure(linkage, LINKS, 30.0, [POINT])
    panels = {axes.get_title(loc="left"): axes for axes in figure.axes}
    motion = linkage.motion(np.linspace(0, 2 * math.pi, 721), 30.0)
    forces = joint_forces(motion, LINKS)
    (torque,) = lines_with(panels["drive torque"], 721)
    np.testing.assert_allclose(torque.imag, forces.torque)
    sizes = [line.imag for line in lines_with(panels["joint forces"], 721)]
    expected = [np.abs(force) for force in (forces.F01, forces.F12, forces.F23, forces.F03)]
    np.testing.assert_allclose(sizes, expected)
    omega2, alpha2, omega3, alpha3 = lines_with(panels["coupler (2) and follower (3)"], 721)
    np.testing.assert_allclose(omega2.imag, motion.omega[1] / 30.0)
    np.testing.assert_allclose(alpha2.imag, motion.alpha[1] / 30.0**2, atol=1e-12)
    np.testing.assert_allclose(omega3.imag, motion.omega[2] / 30.0, atol=1e-12)
    np.testing.assert_allclose(alpha3.imag, motion.alpha[2] / 30.0**2, atol=1e-12)


def test_crank_with_limited_range_is_not_drawn():
    with pytest.raises(LinkageError, match="cannot turn fully"):
        linkage_figure(Linkage(0.4, 0.328, 0.525, 0.547), LINKS, None, [POINT])


@pytest.mark.parametrize("lengths", [THESIS, (0.5, 0.6, 0.55, 0.2), (1.0, 0.9, 0.3, 0.25)])
def test_regions_of_base_planes_have_the_labelled_class(lengths):
    """Linkages at random positions on each plane belong to the class of the region that contains them."""
    figure = base_planes_figure(Linkage(*lengths))
    planes = (1.05, math.sqrt(3), 3.2, base_plane(Linkage(*lengths)))
    corners = np.exp(1j * np.radians([90, 210, 330]))
    random = np.random.default_rng(7)
    for axes, distance in zip(figure.axes, planes, strict=True):
        names = {text.get_text(): text.get_position() for text in axes.texts if "λ" not in text.get_text()}
        outlines = [Path(patch.get_xy()) for patch in axes.patches if isinstance(patch, Polygon)]
        seen = set()
        for share in random.dirichlet([1, 1, 1], 400):
            lambdas = share * math.sqrt(3) * distance
            place = share @ corners
            around = [path for path in outlines if path.contains_point((place.real, place.imag))]
            sides = [1.0, *lambdas]
            if 2 * max(sides) >= sum(sides):
                assert not around
                continue
            symbol = classify(Linkage(*sides)).symbol
            assert around, "every linkage that closes lies in a region"
            inside = [name for name, spot in names.items() if any(p.contains_point(spot) for p in around)]
            assert inside in ([symbol], [])
            seen.add(symbol)
        assert len(seen) >= 6


def test_typical_planes_are_labelled_with_their_classes():
    figure = base_planes_figure(Linkage(*THESIS))
    named = [
        {text.get_text() for text in axes.texts if "λ" not in text.get_text()} for axes in figure.axes[:3]
    ]
    without_crank = {"GCCC", "GRCR", "GRRC", "RRR1", "RRR3", "RRR4"}
    assert named == [without_crank | {"RRR2"}, without_crank, without_crank | {"GCRR"}]


def test_linkage_is_drawn_as_a_dot_in_its_plane():
    linkage = Linkage(*THESIS)
    axes = base_planes_figure(linkage).axes[3]
    assert axes.get_title(loc="left") == "λ = 4.755: this linkage, GCRR"
    (x,), (y,) = axes.lines[0].get_data()
    lengths = np.array(THESIS)
    place = lengths[1:] / lengths[1:].sum() @ np.exp(1j * np.radians([90, 210, 330]))
    assert complex(x, y) == pytest.approx(place)
