"""Interface of periodic systems of every kind: labels, variation, copies, and evaluation at many points."""

import copy
import pickle

import numpy as np
import pytest

import solve
from solve.batch.family import SPEED, SystemFamily
from solve.equations import entries_of, entries_over, structure_of
from solve.errors import MatricesError, UnknownNameError, ValueOutOfBoundsError


def spring(phase, speed):
    """Return matrices of an oscillator with the natural frequency 2 rad/s. Above 10 rad/s, there are none."""
    if speed > 10:
        raise MatricesError("too fast")
    one = np.ones((len(phase), 1, 1))
    return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]


@pytest.fixture
def own():
    return solve.PeriodicSystem(spring, ["q"])


def test_user_system_has_no_case_parameters_or_links(own):
    assert (own.labels.case, own.labels.case_speed, own.labels.title) == (None, None, "")
    assert (dict(own.labels.parameters), dict(own.labels.options), own.labels.links) == ({}, {}, ())
    assert own.labels.moves
    assert own.varied() is own
    with pytest.raises(UnknownNameError, match="parameter or option of system 'k'"):
        own.varied({"k": 1.0})
    with pytest.raises(ValueOutOfBoundsError, match="has no links to draw"):
        structure_of(own)
    assert own.capabilities.structure is None


def test_frequencies_and_entries_of_a_user_system(own):
    np.testing.assert_allclose(solve.frequencies(own, [0.0, 1.0], 1).values, 2.0, rtol=1e-14)
    phase = np.array([0.0, 0.5])
    computed = entries_over(own, phase, np.array([3.0, 20.0]))
    np.testing.assert_array_equal(computed[0], entries_of(own, phase, 3.0))
    assert np.isnan(computed[1]).all()


def test_only_the_speed_of_a_user_system_varies(own):
    family = SystemFamily(own, [SPEED])
    assert family.system(np.array([3.0])) == (own, 3.0)
    with pytest.raises(UnknownNameError, match="quantity of system 'k'"):
        SystemFamily(own, [SPEED, "k"])


def test_structure_lists_links_and_their_supports():
    frame, linkage = solve.load("portal_frame"), solve.load("four_bar")
    assert (frame.labels.moves, linkage.labels.moves) == (False, True)
    assert linkage.labels.links[0] == ("crank", ("clamped", "joined"))
    assert [link.name for link in linkage.labels.links] == list(linkage.pinned_frequencies())
    assert sum(link.ends.count("clamped") for link in frame.labels.links) == 2


@pytest.mark.parametrize("name", ["cam", "four_bar"])
def test_models_are_copied_and_pickled_with_their_values(name):
    model = solve.load(name)
    phase = np.linspace(0.0, 1.0, 5)
    varied = model.varied({next(iter(model.parameters)): 0.9 * next(iter(model.parameters.values()))})
    for other in (copy.copy(varied), pickle.loads(pickle.dumps(varied))):
        assert type(other) is type(model)
        assert (other.labels.case, other.labels.case_speed) == (model.labels.case, model.labels.case_speed)
        assert (other.parameters, other.labels.options) == (varied.parameters, varied.labels.options)
        for part, expected in zip(other.at(phase, 3.0), varied.at(phase, 3.0), strict=True):
            np.testing.assert_array_equal(part, expected)


@pytest.mark.parametrize("name", ["cam", "four_bar"])
def test_batch_of_points_equals_single_points(name):
    model, phase = solve.load(name), np.linspace(0.0, 6.0, 7)
    parameter, value = next((name, value) for name, value in model.parameters.items() if value != 0)
    family = SystemFamily(model, [SPEED, parameter])
    points = np.array([[speed, factor * value] for factor in (1.0, 1.01) for speed in (2.0, 5.0, 7.0, 9.0)])
    expected = []
    for point in points:
        system, speed = family.system(point)
        expected.append(entries_of(system, phase, speed))
    n, scale = model.n, np.abs(expected).max(axis=(0, 1))
    rounding = np.repeat(
        [part.max() for part in np.split(scale, [n**2, 2 * n**2, 3 * n**2])], [*[n**2] * 3, n]
    )
    allowed = 1e-12 * scale + 8 * np.finfo(float).eps * rounding
    assert (np.abs(family.entries(phase, points) - expected) <= allowed).all()
