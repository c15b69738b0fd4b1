"""Colours of unstable regions between the points of a chart."""

import numpy as np
import pytest

from solve.system import PeriodicSystem
from solve.views.chart import Field, _plane, regions_figure
from solve.views.sweep import KIND_NAMES

KINDS = list(KIND_NAMES)


def field(kind, other, is_elsewhere):
    """Return stable points, a band of one kind between them and, if requested, a nearby region of another
    kind."""
    x, y = np.arange(7.0), np.arange(5.0)
    kinds, growth = np.full((5, 7), "", dtype="U8"), np.full((5, 7), -0.1)
    if is_elsewhere:
        kinds[3:, 3:], growth[3:, 3:] = other, 0.3
    curve = np.array([[1.2, 4.0], [1.3, 3.1], [1.6, 3.1], [1.7, 4.0]])
    return Field(x, y, growth, kinds, np.zeros((5, 7), dtype=bool), [(kind, curve)])


@pytest.mark.parametrize("is_elsewhere", [True, False])
@pytest.mark.parametrize(("kind", "other"), [KINDS[:2], KINDS[1::-1], KINDS[-1:] + KINDS[:1]])
def test_band_between_points_has_the_kind_of_its_boundary(kind, other, is_elsewhere):
    given = field(kind, other, is_elsewhere)
    plane = _plane(given, given.growth)
    assert np.count_nonzero((plane.values == 0) & (plane.kinds == kind)) == 4
    system = PeriodicSystem(
        lambda phase, speed: [np.ones((len(phase), 1, 1))] * 3 + [np.ones((len(phase), 1))], ["q"]
    )
    drawn = regions_figure(system, given, ("x", "y"))
    labels = {text.get_text() for text in drawn.legends[0].get_texts()}
    assert (f"unstable, {KIND_NAMES[other]}" in labels) == is_elsewhere
    assert f"unstable, {KIND_NAMES[kind]}" in labels
