"""Determinant of the dynamic stiffness of the frame: zeros, and the pole with one element per bar."""

import numpy as np
import pytest

import solve
from models.portal_frame.__main__ import run
from models.portal_frame.determinant import determinants, determinants_figure, logarithm


@pytest.fixture(scope="module")
def frame():
    return determinants(solve.load("portal_frame"), 1200.0)


@pytest.fixture(scope="module")
def sides():
    """ln|det D| at relative distances of 1e-3 and 1e-6 from every frequency, by number of elements."""
    model = solve.load("portal_frame")
    computed = determinants(model, 1200.0).found
    near = {
        count: [
            logarithm(
                model.varied(options={"element": "dynamic", "elements": count}), computed * (1 + distance)
            )
            for distance in (1e-3, 1e-6)
        ]
        for count in (1, 2)
    }
    return computed, near


def test_all_seven_frequencies_are_counted(frame):
    assert frame.found == pytest.approx(
        [56.603, 223.405, 364.376, 395.184, 798.420, 974.976, 1128.133], rel=2e-6
    )


def test_with_two_elements_every_frequency_is_a_zero(sides):
    """At a distance smaller by a factor of 1000, the determinant is smaller by the same factor."""
    _, near = sides
    np.testing.assert_allclose(near[2][0] - near[2][1], np.log(1e3), rtol=0.02)


def test_fourth_frequency_is_a_pole_with_one_element(sides):
    """The pole is of second order: three bars have this frequency, and two corners constrain them."""
    _, near = sides
    change = (near[1][0] - near[1][1]) / np.log(1e3)
    np.testing.assert_allclose(np.delete(change, 3), 1.0, rtol=0.02)
    assert change[3] == pytest.approx(-2.0, rel=0.02)


def test_figure_and_output_of_the_command(frame, tmp_path, capsys):
    axes = determinants_figure(frame).axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["1 element per bar", "2 elements per bar"]
    assert run(["--plot", str(tmp_path / "det.png"), "--most", "400"]) == 0
    assert capsys.readouterr().out == "natural frequencies (rad/s): 56.603, 223.405, 364.376, 395.184\n"
    assert (tmp_path / "det.png").stat().st_size > 10_000
    assert run(["--plot", str(tmp_path / "det.png"), "--most", "0"]) == 2
    assert capsys.readouterr().err.startswith("python -m models.portal_frame: --most is 0.0; allowed: 1")
