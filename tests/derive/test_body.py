"""Elastic bodies, declared by their interface and number of modes."""

import pytest

from derive import Mechanism, rate
from derive.errors import DeclarationError


def rig(**changes):
    made = Mechanism("rig", "Mass on an elastic body")
    y, turn = made.coordinates(y=("m", "mass"), turn=("rad", "its rotation"))
    options = {"name": "beam", "interface": {"y": (y, "m"), "turn": (turn, "rad")}, "modes": 2, **changes}
    body = made.reduced_body(**options)
    made.kinetic, made.potential, made.dissipation = body.kinetic, body.potential, body.dissipation
    return made, body


def test_energies_contain_the_reduced_matrices():
    made, body = rig()
    p = {str(parameter.symbol): parameter.symbol for parameter in made.declared_parameters}
    y, turn, one, two = (coordinate.symbol for coordinate in made.declared_coordinates)
    assert (str(one), str(two)) == ("beam1", "beam2")
    stiffness = p["beam_K1_1"] * y**2 + 2 * p["beam_K1_2"] * y * turn + p["beam_K2_2"] * turn**2
    stiffness += p["beam_K3_3"] * one**2 + p["beam_K4_4"] * two**2
    assert (2 * body.potential - stiffness).expand() == 0
    assert body.dissipation == 0
    assert "beam_M3_4" not in p
    assert body.kinetic.coeff(rate(y)).coeff(rate(two)) == p["beam_M1_4"]


def test_units_of_entries_follow_from_the_interface():
    made, _ = rig(damping=True)
    units = {str(parameter.symbol): parameter.unit for parameter in made.declared_parameters}
    assert [units[f"beam_M{k}"] for k in ("1_1", "1_2", "2_2", "3_3")] == ["kg", "kg m", "kg m^2", "kg m^2"]
    assert [units[f"beam_K{k}"] for k in ("1_1", "1_2", "2_2")] == ["N/m", "N/rad", "N m/rad"]
    assert units["beam_C3_4"] == "N m s/rad"


def test_generated_module_lists_entries_only_if_there_is_a_body():
    made, body = rig()
    namespace = {}
    exec(made.code(), namespace)
    assert namespace["BODIES"] == (("beam", ("m", "rad"), 2, body.entries),)
    plain = Mechanism("plain", "Mass on a spring")
    q = plain.coordinate("q", "m", "deflection")
    m, k = plain.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"))
    plain.kinetic, plain.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    assert "BODIES" not in plain.code()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"interface": {}}, 'interface is {}; give displacements in "m" or "rad"'),
        ({"interface": {"y": (1, "mm")}}, 'give displacements in "m" or "rad"'),
        ({"interface": {"y": 1}}, 'give displacements in "m" or "rad"'),
        ({"modes": -1}, "modes is -1"),
        ({"modes": 1.5}, "modes is 1.5"),
        ({"name": "1st"}, '"1st" cannot be a name'),
        ({"name": "phase"}, "reserved"),
    ],
)
def test_invalid_bodies_are_refused(changes, expected):
    with pytest.raises(DeclarationError) as refused:
        rig(**changes)
    assert expected in str(refused.value)
