"""Errors in the statement of a mechanism and their messages."""

import math

import pytest
import sympy

from derive import Matrix, Mechanism, cos, rate
from derive.checks import check
from derive.errors import (
    DeclarationError,
    UnitError,
    UnknownSymbolError,
    UnsupportedExpressionError,
    UnusedParameterError,
)


def oscillator() -> tuple[Mechanism, sympy.Symbol, sympy.Symbol, sympy.Symbol]:
    one = Mechanism("one", "One mass")
    (q,) = one.coordinates(q=("m", "displacement"))
    m, k = one.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"))
    one.kinetic = m * rate(q) ** 2 / 2
    one.potential = k * q**2 / 2
    return one, q, m, k


def test_complete_statement_is_accepted():
    one, *_ = oscillator()
    check(one)


@pytest.mark.parametrize(
    "described", [("", "mass"), ("kg", ""), ("kg",), "kg", ("kg", "mass", "> 0", "more")]
)
def test_unit_and_meaning_are_required(described):
    with pytest.raises(DeclarationError, match="m2 requires a unit and a meaning"):
        oscillator()[0].parameters(m2=described)
    with pytest.raises(DeclarationError, match="q2 requires a unit and a meaning"):
        oscillator()[0].coordinates(q2=described)


@pytest.mark.parametrize(
    "bound", ["positive", ">", "> x", "0 <", "> 0 < 1", "> 0,", "integers", "> 1.2.3", 3]
)
def test_malformed_bounds_are_refused(bound):
    with pytest.raises(DeclarationError, match=r"the bound .* is not understood"):
        oscillator()[0].parameters(m2=("kg", "mass", bound))


@pytest.mark.parametrize("bound", ["", "> 0", ">= -1.5", "< 1e-3", "integer", "integer, >= 1", "> 0, < 1"])
def test_valid_bounds_are_accepted(bound):
    one, *_ = oscillator()
    one.parameters(m2=("kg", "mass", bound))
    assert one.declared_parameters[-1].bound == bound


@pytest.mark.parametrize(
    ("bound", "form"), [(">0", "> 0"), ("integer,>=1", "integer, >= 1"), (">-1E-3 ,<.5", "> -1E-3, < .5")]
)
def test_bounds_have_a_normal_form(bound, form):
    one, q, *_ = oscillator()
    one.parameters(m2=("kg", "mass", bound))
    assert one.declared_parameters[-1].bound == form
    if "integer" not in bound:
        one.output("where", q, "m", "displacement")
        one.limit("where", bound, beyond="it is elsewhere")
        assert one.limits == [("where", form, "it is elsewhere")]


@pytest.mark.parametrize("bound", ["", "integer", "integer, >= 1"])
def test_limits_require_a_bound_without_integer(bound):
    with pytest.raises(DeclarationError, match="limit: drive_torque requires a bound such as"):
        oscillator()[0].limit("drive_torque", bound, beyond="the motor stalls")


def test_bound_of_a_coordinate_is_refused():
    with pytest.raises(DeclarationError, match=r"q2: a coordinate has no bound; use trust"):
        oscillator()[0].coordinates(q2=("m", "displacement", "> 0"))


@pytest.mark.parametrize(
    "name", ["phase", "speed", "parameters", "casadi", "lambda", "_x", "µ", "time", "multiplier_re"]
)
def test_reserved_names_are_refused(name):
    with pytest.raises(DeclarationError, match=f'"{name}" cannot be a name'):
        oscillator()[0].parameters(**{name: ("kg", "mass")})


@pytest.mark.parametrize("name", ["m", "q", "qd", "qdd"])
def test_repeated_names_are_refused(name):
    with pytest.raises(DeclarationError, match=f'"{name}" is declared twice'):
        oscillator()[0].parameters(**{name: ("kg", "mass")})


def test_coordinate_rate_cannot_share_a_parameter_name():
    one, *_ = oscillator()
    one.parameters(xd=("m", "something"))
    with pytest.raises(DeclarationError, match='"xd" is declared twice'):
        one.coordinates(x=("m", "position"))


def test_output_names_must_differ_from_all_other_names():
    one, q, *_ = oscillator()
    with pytest.raises(DeclarationError, match='"k" is declared twice'):
        one.output("k", q, "m", "displacement")
    for argument in ("p", "qd"):
        with pytest.raises(DeclarationError, match=f'"{argument}" cannot be the name of an input, an output'):
            one.output(argument, q, "m", "displacement")
        with pytest.raises(
            DeclarationError, match=f'"{argument}" cannot be the name of an input, an output, an option'
        ):
            one.option(argument, ("soft", "hard"))
    one.output("drive_torque", q, "m", "displacement")
    with pytest.raises(
        DeclarationError, match='"drive_torque" is reserved for the output that follows from the energies'
    ):
        check(one)


def test_unknown_symbol_in_an_energy_is_refused():
    one, q, *_ = oscillator()
    one.potential = sympy.Symbol("kk") * q**2
    with pytest.raises(
        UnknownSymbolError, match="potential energy contains kk, which is not declared; did you mean k"
    ):
        check(one)


def test_undeclared_symbol_with_a_declared_name_is_refused():
    one, q, *_ = oscillator()
    one.potential = sympy.Symbol("k") * q**2
    with pytest.raises(UnknownSymbolError, match="a symbol named k other than the declared one"):
        check(one)


def test_acceleration_in_an_energy_is_refused():
    one, q, m, _ = oscillator()
    one.kinetic = m * q * rate(rate(q)) / 2
    with pytest.raises(UnknownSymbolError, match="kinetic energy contains qdd, which is not allowed there"):
        check(one)


def test_rate_in_potential_energy_or_displacement_is_refused():
    """Lagrange's equations in the form used here have no term for such a rate."""
    one, q, m, k = oscillator()
    one.potential += m * q * rate(q) * one.speed
    with pytest.raises(UnknownSymbolError, match="potential energy contains qd, which is not allowed there"):
        check(one)
    one, q, _, k = oscillator()
    one.force(k * q, along=rate(q) / one.speed)
    with pytest.raises(UnknownSymbolError, match=r"displacement .* contains qd, which is not allowed there"):
        check(one)


@pytest.mark.parametrize("attribute", ["kinetic", "potential", "dissipation", "period"])
@pytest.mark.parametrize("given", [None, "k*q**2", [1]])
def test_attribute_without_an_expression_is_refused(attribute, given):
    one, *_ = oscillator()
    setattr(one, attribute, given)
    with pytest.raises(DeclarationError, match=r" is .*; give a number or an expression"):
        check(one)


@pytest.mark.parametrize("number", [sympy.nan, sympy.oo, sympy.zoo])
def test_infinite_expressions_are_refused(number):
    one, q, _, k = oscillator()
    one.output("worst", k * q * number, "N", "force")
    with pytest.raises(DeclarationError, match=r"output worst is not finite: .*division by zero"):
        check(one)


@pytest.mark.parametrize("period", [0, -2 * sympy.pi])
def test_period_must_be_positive(period):
    one, *_ = oscillator()
    one.period = period
    with pytest.raises(DeclarationError, match=r"period is .*; give a positive angle"):
        check(one)


def test_period_with_a_parameter_is_refused():
    one, q, _, k = oscillator()
    (z,) = one.parameters(z=("1", "teeth"))
    one.potential, one.period = z * k * q**2, 2 * sympy.pi * z
    with pytest.raises(UnknownSymbolError, match="period contains z, which is not allowed there"):
        check(one)


def test_fundamental_motion_with_coordinates_is_refused():
    one, q, *_ = oscillator()
    one.fundamental(q=q * cos(one.phase))
    with pytest.raises(UnknownSymbolError, match="motion of q contains q, which is not allowed there"):
        check(one)


def test_unused_parameter_is_refused():
    one, *_ = oscillator()
    one.parameters(spare=("kg", "forgotten"))
    with pytest.raises(UnusedParameterError, match="parameter spare is not used"):
        check(one)


def test_unused_series_is_refused():
    one, *_ = oscillator()
    one.transmission("U", harmonics=2, unit="m")
    with pytest.raises(UnusedParameterError, match="parameter a1 is not used"):
        check(one)


def test_unused_option_is_refused():
    one, *_ = oscillator()
    one.option("law", ("soft", "hard"))
    with pytest.raises(UnusedParameterError, match="option law is not used"):
        check(one)


def test_wrong_units_of_energies_forces_and_outputs_are_refused():
    for attribute, what in [
        ("kinetic", "kinetic energy"),
        ("potential", "potential"),
        ("dissipation", "dissipation"),
    ]:
        one, q, *_ = oscillator()
        setattr(one, attribute, q)
        with pytest.raises(UnitError, match=f"{what}.* must be in .* but q is in m"):
            check(one)
    one, q, _, k = oscillator()
    one.force(k, along=q)
    with pytest.raises(UnitError, match='virtual work of k along q must be in "J"'):
        check(one)
    one, q, *_ = oscillator()
    one.output("where", q, "N", "force")
    with pytest.raises(UnitError, match=r'output where must be in "N" \(kg m/s\^2\) but q is in m'):
        check(one)
    one, q, _, k = oscillator()
    one.potential = k * q**2 / 2 + k * q
    with pytest.raises(
        UnitError, match=r"potential energy: .* is in .* but .* is in .*; they cannot be added"
    ):
        check(one)


def test_length_as_argument_of_a_transmission_is_refused():
    one, q, _, k = oscillator()
    U = one.transmission("U", harmonics=1, unit="m")
    one.potential = k * U(q) ** 2
    with pytest.raises(UnitError, match="the argument q of U is in m"):
        check(one)


def test_mechanism_without_coordinates_is_refused():
    with pytest.raises(DeclarationError, match="empty has no coordinates"):
        check(Mechanism("empty", "Nothing"))


def test_energies_in_another_unit_have_no_drive_torque():
    bare = Mechanism("bare", "Equation without units", energy="1/s^2")
    (q,) = bare.coordinates(q=("1", "number"))
    bare.kinetic = rate(q) ** 2 / 2
    with pytest.raises(DeclarationError, match="give no drive torque in N m"):
        check(bare)
    bare.decline_drive_torque("it has no units")
    check(bare)


def test_options_require_values_and_one_expression_per_value():
    one, *_ = oscillator()
    with pytest.raises(DeclarationError, match="option law has the values"):
        one.option("law", ("soft",))
    law = one.option("law", ("soft", "hard"))
    with pytest.raises(DeclarationError, match="one expression for each of soft, hard; given: soft"):
        law.choose(soft=1)
    with pytest.raises(DeclarationError, match='"law_soft" is declared twice'):
        one.parameters(law_soft=("1", "taken"))


def test_names_other_than_coordinates_and_outputs_are_refused():
    one, *_ = oscillator()
    for declare in (lambda: one.trust(x=1.0), lambda: one.fundamental(x=one.phase)):
        with pytest.raises(DeclarationError, match="x is not a coordinate; declared: q"):
            declare()
    with pytest.raises(DeclarationError, match="limit: x is not an output; declared: drive_torque"):
        one.limit("x", "> 0", beyond="nothing holds")


@pytest.mark.parametrize("bound", [0, -1.0, math.inf, math.nan, "5", None])
def test_bounds_of_the_linear_model_must_be_positive(bound):
    with pytest.raises(DeclarationError, match=r"trust: q=.* must be a positive number"):
        oscillator()[0].trust(q=bound)


def test_series_require_at_least_one_harmonic():
    with pytest.raises(DeclarationError, match="U has no harmonics"):
        oscillator()[0].transmission("U", harmonics=0, unit="m")


def test_expressions_without_generated_code_are_refused():
    from modules import module_of

    one, q, _, k = oscillator()
    (z,) = one.parameters(z=("1", "number"))
    one.potential = k * q**2 * sympy.zeta(z)
    with pytest.raises(UnsupportedExpressionError, match=r"zeta\(z\) cannot be generated; known functions"):
        module_of(one)


def test_one_coordinate_and_one_parameter_are_declared_without_tuples():
    one = Mechanism("one", "One mass")
    q, m = one.coordinate("q", "m", "displacement"), one.parameter("m", "kg", "mass", "> 0")
    k = one.parameter("k", "N/m", "spring")
    one.kinetic, one.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    check(one)
    assert [parameter.bound for parameter in one.declared_parameters] == ["> 0", ""]
    with pytest.raises(DeclarationError, match='"q" is declared twice'):
        one.coordinate("q", "m", "displacement")


def test_matrices_in_place_of_scalars_are_refused():
    mine = Mechanism("mine", "With vectors")
    q = Matrix(mine.coordinates(q1=("m", "one"), q2=("m", "other")))
    with pytest.raises(DeclarationError, match=r"kinetic is a matrix of 2 by 2; give one entry, such as q.T"):
        mine.kinetic = rate(q) * rate(q).T
    for force, along in ((1, q), (q, 1), (q, q.T)):
        with pytest.raises(DeclarationError, match="give two numbers, or two vectors of one shape"):
            mine.force(force, along=along)
