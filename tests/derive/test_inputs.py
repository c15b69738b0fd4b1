"""Inputs of mechanisms: the matrix B of the generated module, and invalid statements."""

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate
from derive.errors import DeclarationError, UnitError, UnknownSymbolError
from solve.equations import input_matrix
from solve.errors import ValueOutOfBoundsError


def beam_on_a_wheel(**inputs):
    """Mass at the radius r + q on a rotating wheel, with a load."""
    wheel = Mechanism("wheel", "Mass on a wheel")
    (q,) = wheel.coordinates(q=("m", "deflection"))
    m, k, r = wheel.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), r=("m", "radius", "> 0"))
    wheel.kinetic = m * rate(q) ** 2 / 2
    wheel.potential = k * q**2 / 2
    wheel.force(-k * r * cos(wheel.phase), along=q)
    x = (r + q) * cos(wheel.phase)
    for name, (unit, along) in inputs.items():
        wheel.input(name, unit, along=along(q, x, r))
    return wheel


def test_force_acts_along_the_derivative_of_its_displacement():
    wheel = beam_on_a_wheel(push=("N", lambda q, x, r: x), twist=("N m", lambda q, x, r: q / r + q**2 / r**2))
    model = solve.load(wheel, m=2.0, k=8.0, r=0.5)
    phase = np.array([0.0, 1.0, 2.5])
    assert model.inputs == ("push", "twist")
    assert model.labels.units["twist"] == "N m"
    assert np.allclose(
        input_matrix(model, phase, 3.0)[:, 0], np.stack((np.cos(phase), 2 + 0 * phase), axis=1)
    )
    found = solve.lqr(model, 1.0, {"q": 1.0}, {"push": 1.0, "twist": 1.0})
    assert found.gain(0.3).shape == (1, 2, 2)


def test_outputs_with_accelerations_are_refused_as_weights():
    wheel = beam_on_a_wheel(push=("N", lambda q, x, r: x))
    (q,) = (each.symbol for each in wheel.declared_coordinates)
    wheel.output("acceleration_of_q", rate(rate(q)), "m/s^2", "acceleration")
    wheel.output("velocity", rate(q), "m/s", "velocity")
    model = solve.load(wheel, m=2.0, k=8.0, r=0.5)
    with pytest.raises(ValueOutOfBoundsError, match="depends on accelerations"):
        solve.lqr(model, 1.0, {"acceleration_of_q": 1.0}, {"push": 1.0})
    by_output, by_state = (
        solve.lqr(model, 1.0, {name: 1.0}, {"push": 1.0}) for name in ("velocity", "q_dot")
    )
    assert np.allclose(by_output.riccati(0.5), by_state.riccati(0.5), rtol=1e-9)


def test_mechanism_without_inputs_generates_no_input_code():
    code = beam_on_a_wheel().code()
    assert "INPUTS" not in code
    assert "def inputs" not in code
    model = solve.load(beam_on_a_wheel(), m=2.0, k=8.0, r=0.5)
    assert model.inputs == ()
    assert input_matrix(model, np.zeros(3), 1.0).shape == (3, 1, 0)


def test_input_only_adds_lines_to_the_code():
    with_input = beam_on_a_wheel(push=("N", lambda q, x, r: x)).code().splitlines()
    hashes = [line for line in beam_on_a_wheel().code().splitlines() if "SHA256" not in line]
    lines = iter(with_input)
    assert all(line in lines for line in hashes)


@pytest.mark.parametrize(
    ("inputs", "error", "words"),
    [
        ({"push": ("N m", lambda q, x, r: x)}, UnitError, "virtual work of push"),
        ({"push": ("kN", lambda q, x, r: x)}, UnitError, "push"),
        ({"k": ("N", lambda q, x, r: x)}, DeclarationError, "declared twice"),
        ({"q": ("N", lambda q, x, r: x)}, DeclarationError, "name of an input"),
        ({"push": ("N", lambda q, x, r: rate(q))}, UnknownSymbolError, "not allowed"),
    ],
)
def test_invalid_inputs_are_refused(inputs, error, words):
    with pytest.raises(error, match=words):
        beam_on_a_wheel(**inputs).code()
