"""Methods given by name and settings, and messages about unknown names and settings."""

import numpy as np
import pytest

from solve import Newmark, Radau, floquet
from solve.errors import UnknownNameError, ValueOutOfBoundsError
from solve.methods.choice import METHODS, chosen
from solve.methods.gauss import Gauss
from tests.solve.systems import cam, constant


@pytest.mark.parametrize("name", METHODS)
def test_every_name_selects_its_method(name):
    method = chosen(name)
    if name == "auto":
        assert method is METHODS[name]
        return
    assert type(method) is METHODS[name]
    assert method.name == name


def test_settings_are_passed_to_the_method_unless_absent():
    assert chosen("newmark", gamma=0.6, beta=None, order=None) == Newmark(gamma=0.6)
    assert (chosen("radau", order=5), chosen("gauss", order=8)) == (Radau(5), Gauss(8))


def test_method_object_is_used_unchanged():
    rule = Radau(7)
    assert chosen(rule) is rule


@pytest.mark.parametrize(("given", "near"), [("raddau", "radau"), ("rk5", "rk4"), ("Newmark", "newmark")])
def test_unknown_method_name_is_refused_with_a_suggestion(given, near):
    with pytest.raises(UnknownNameError, match=rf"unknown method '{given}'; did you mean '{near}'"):
        chosen(given)


def test_message_names_the_method_of_a_wrong_setting():
    with pytest.raises(ValueOutOfBoundsError, match="method radau has no gamma; gamma belongs to newmark"):
        chosen("radau", gamma=0.5)


@pytest.mark.parametrize("given", [3, None, Radau, object()])
def test_invalid_methods_are_refused(given):
    with pytest.raises(
        ValueOutOfBoundsError, match=r"method is .*; give a name or an object such as Radau\(\)"
    ):
        chosen(given)


@pytest.mark.parametrize(
    ("frequency", "named"), [(1.0, "gauss"), (80.0, "gauss"), (82.0, "radau"), (1e4, "radau")]
)
def test_auto_selects_gauss_for_resolvable_modes_and_radau_beyond(frequency, named):
    """The limit is ω T = 512: ω = 81.5 at speed 1. Decay rates count like frequencies."""
    for damping, stiffness in ((0.02, frequency**2), (frequency, 1.0)):
        given = constant([[1.0]], [[damping]], [[stiffness]], lambda phase: np.ones((len(phase), 1)))
        assert floquet(given, 1.0, rtol=1e-4).method == named


def test_auto_reports_the_selected_method():
    assert floquet(cam(), "600 rpm").method == "radau"
