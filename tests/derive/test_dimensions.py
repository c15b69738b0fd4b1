"""Units, dimensions of expressions, and homogeneity of generated equations."""

import importlib
import math
import re

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from derive.errors import UnitError
from derive.units import ONE, dimension_of, parse, require, size

force, length, mass, angle = sympy.symbols("force length mass angle", real=True)
KNOWN = {force: parse("N"), length: parse("m"), mass: parse("kg"), angle: parse("rad")}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("N m/rad", "J"), ("W", "J/s"), ("Pa", "N/m^2"), ("N", "kg m/s^2"), ("Hz", "1/s"), ("rad", "1"),
        ("N s/m", "kg/s"), ("N /m", "N/m"), ("m^-2", "1/m/m"), ("kg m^2", "N m s^2"),
    ],
)  # fmt: skip
def test_units_of_one_dimension(one, other):
    assert parse(one) == parse(other)


@pytest.mark.parametrize("text", ["bananas", "N/", "", "kg^", "kg^x", "degC", "mol", "cd/m^2", "N m)"])
def test_units_outside_mechanics_raise_an_error(text):
    with pytest.raises(UnitError, match=rf'the unit "{re.escape(text)}" is not understood'):
        parse(text)


@pytest.mark.parametrize(
    ("text", "coherent", "factor"),
    [
        ("mm", "m", 1e-3), ("kN/mm", "N/m", 1e6), ("deg", "rad", math.pi / 180),
        ("rpm", "rad/s", math.pi / 30),
        ("bar", "Pa", 1e5), ("g cm^2", "kg m^2", 1e-7), ("lbf", "N", 4.4482216152605), ("kilogram", "kg", 1),
        ("newton meter", "N m", 1), ("1/min", "1/s", 1 / 60), ("percent", "1", 0.01), ("V A", "W", 1),
        ("N/mm^1.5", "N m^-1.5", 1000**1.5),
    ],
)  # fmt: skip
def test_units_of_other_sizes(text, coherent, factor):
    assert parse(text) == parse(coherent)
    assert size(text) == pytest.approx(factor, rel=1e-14)
    assert size(coherent) == 1.0


def test_dimensions_print_in_base_units():
    assert [str(parse(text)) for text in ("N", "1", "1/s", "kg m^2", "W/K")] == [
        "kg m/s^2", "1", "1/s", "kg m^2", "kg m^2/s^3/K",
    ]  # fmt: skip


def dimension(expression: sympy.Expr) -> str:
    return str(dimension_of("it", expression, KNOWN))


def test_dimension_of_an_expression():
    assert dimension(force * length / mass) == "m^2/s^2"
    assert dimension(sympy.sqrt(force * length / mass)) == "m/s"
    assert dimension(sympy.atan2(length, 2 * length)) == "1"
    assert dimension(sympy.Max(0, force)) == "kg m/s^2"
    assert dimension(sympy.sign(force) * length) == "m"
    assert dimension_of("it", sympy.cos(angle) ** sympy.Symbol("z"), KNOWN | {sympy.Symbol("z"): ONE}) == ONE


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        (force + length, "it: force is in kg m/s^2 but length is in m; they cannot be added"),
        (force * (length + mass), "length is in m but mass is in kg"),
        (sympy.sin(length), "the argument length of sin is in m; it must be a pure number or an angle"),
        (sympy.exp(force / mass), "of exp is in m/s^2"),
        (length**mass, "the exponent of length**mass is in kg"),
        (length**angle, "to a power that is not rational"),
        (sympy.Max(length, mass), "cannot be added or compared"),
    ],
)
def test_inconsistent_units_are_named(expression, message):
    with pytest.raises(UnitError, match=re.escape(message)):
        dimension(expression)


def test_message_about_a_wrong_unit_states_both_units():
    with pytest.raises(
        UnitError, match=r'torque must be in "N" \(kg m/s\^2\) but force\*length is in kg m\^2/s\^2'
    ):
        require("torque", force * length, "N", KNOWN)
    require("nothing", sympy.S.Zero, "N", KNOWN)


def scale(unit: str, base: tuple[float, ...]) -> float:
    """Factor of the number of a quantity if the units of mass, length and time are kg, m and s divided by
    `base`."""
    return float(np.prod([b ** float(e) for b, e in zip(base, parse(unit).exponents[:3], strict=True)]))


@pytest.mark.parametrize("name", ["cam", "manipulator", "gear_pair"])
@settings(max_examples=10, deadline=None)
@given(base=st.tuples(*[st.sampled_from([0.25, 0.5, 2.0, 8.0])] * 3), seed=st.integers(0, 2**32 - 1))
def test_generated_equations_are_homogeneous_in_every_unit(name, base, seed):
    """Independent check of the units: with numbers in other base units, the equations yield the same
    motion."""
    module = importlib.import_module(f"generated.{name}")
    generator = np.random.default_rng(seed)
    p = generator.uniform(0.5, 2, len(module.PARAMETERS))
    if name == "gear_pair":
        p[4] = 14
    q = generator.uniform(-1, 1, (3, len(module.COORDINATES)))
    units = [unit for _, unit, _ in module.COORDINATES]
    rescaled = [
        [v * scale(f"{u}{per}", base) for v, u in zip(each, units, strict=True)]
        for each, per in zip(q, ("", "/s", "/s/s"), strict=True)
    ]
    speed, other_speed = 3.0, 3.0 * scale("1/s", base)
    other_p = [v * scale(unit, base) for v, (_, unit, *_) in zip(p, module.PARAMETERS, strict=True)]
    rows = np.array(module.residual()(0.7, speed, *q, p)).ravel()
    other_rows = np.array(module.residual()(0.7, other_speed, *rescaled, other_p)).ravel()
    expected = [r * scale("J", base) / scale(u, base) for r, u in zip(rows, units, strict=True)]
    assert other_rows == pytest.approx(expected, rel=1e-11)
    outputs = module.outputs().call([0.7, speed, *q, p])
    others = module.outputs().call([0.7, other_speed, *rescaled, other_p])
    for (label, unit, _), one, other in zip(module.OUTPUTS, outputs, others, strict=True):
        assert float(other) == pytest.approx(float(one) * scale(unit, base), rel=1e-11, abs=1e-300), label
