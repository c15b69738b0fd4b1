"""Projection onto mode functions: integrals compared with quadrature, beams and columns with closed forms."""

from itertools import product

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
import scipy.special
import sympy
from modules import module_of

from derive import Mechanism, cos, pi, rate, sin
from derive.checks import check
from derive.emit import module_text
from derive.errors import (
    DeclarationError,
    SingularMassError,
    UnitError,
    UnknownSymbolError,
    UnsupportedExpressionError,
)
from derive.field import MODE_I, MODE_J, XI, modal_integral, modal_moment
from derive.galerkin import project
from derive.show import equations

MOST = 20
NUMBERS = range(1, MOST + 1)


def sine(k, xi):
    """Mode functions of a beam that is pinned at both ends."""
    return sin(k * pi * xi)


def cantilever(k, xi):
    """Clamped at 0 and free at 1: deflection and slope vanish at 0, and the curvature vanishes at 1."""
    return 1 - cos((2 * k - 1) * pi * xi / 2)


def guided(k, xi):
    """Rotation is prevented at both ends, deflection is free."""
    return cos(k * pi * xi)


def weighted_sine(k, xi):
    """Sine multiplied by a power of ξ: of the permitted form, although no practical boundary condition leads
    to it."""
    return xi * sin(k * pi * xi)


SHAPES = [sine, cantilever, guided, weighted_sine]
NODE, WEIGHT = np.polynomial.legendre.leggauss(80)
NODE, WEIGHT = (NODE + 1) / 2, WEIGHT / 2


def sampled(shape, order):
    """Derivatives of the mode functions at the quadrature nodes (MOST, 80)."""
    k = sympy.Symbol("k", integer=True, positive=True)
    function = sympy.lambdify((k, XI), shape(k, XI).diff(XI, order))
    return np.array([np.broadcast_to(function(number, NODE), NODE.shape) for number in NUMBERS])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("a", "b", "power"), [(0, 0, 0), (1, 1, 2), (2, 2, 0), (0, 1, 1), (2, 0, 1)])
def test_integrals_of_pairs_equal_quadrature(shape, a, b, power):
    integral = modal_integral(shape, a, b, power, MOST)
    different, equal = (
        sympy.lambdify((MODE_I, MODE_J), integral.different),
        sympy.lambdify(MODE_I, integral.equal),
    )
    closed = np.array([[equal(i) if i == j else different(i, j) for j in NUMBERS] for i in NUMBERS])
    first, second = sampled(shape, a), sampled(shape, b)
    summed = (first * WEIGHT * NODE**power) @ second.T
    scale = np.sqrt(np.outer((first**2) @ WEIGHT, (second**2) @ WEIGHT))
    assert (abs(closed - summed) / scale).max() < 1e-12


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("a", "power"), [(0, 0), (0, 1), (1, 0), (1, 2)])
def test_moments_equal_quadrature(shape, a, power):
    moment = sympy.lambdify(MODE_J, modal_moment(shape, a, power, MOST))
    values = sampled(shape, a)
    error = np.array([moment(j) for j in NUMBERS]) - values @ (WEIGHT * NODE**power)
    assert (abs(error) / np.sqrt((values**2) @ WEIGHT)).max() < 1e-12


def test_orthogonal_modes_have_exact_zeros():
    for order in range(3):
        integral = modal_integral(sine, order, order, 0, MOST)
        assert integral.different == 0
        assert integral.equal == (MODE_I * pi) ** (2 * order) / 2
    assert modal_integral(guided, 0, 2, 0, MOST).different == 0
    assert modal_moment(sine, 1, 0, MOST) == 0


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (lambda k, xi: xi ** (k + 1), "with the term exp.*log"),
        (lambda k, xi: sin(k * pi * xi / 2), "with the term exp"),
        (lambda k, xi: sin(k * xi), "with the term exp"),
        (
            lambda k, xi: cos((k - 1) * pi * xi) - cos((k + 1) * pi * xi),
            "frequencies coincide at i = 3, j = 1",
        ),
    ],
)
def test_mode_functions_of_another_form_are_refused(shape, message):
    with pytest.raises(UnsupportedExpressionError, match=message):
        modal_integral(shape, 0, 0, 0, MOST)


def column(shape, load="none", most=MOST) -> Mechanism:
    """Uniform beam with one of three loads: on a rotating hub, under its axial weight, or compressed at its
    end."""
    beam = Mechanism("column", "Uniform beam")
    L, mu, EI, alpha = beam.parameters(
        L=("m", "length", "> 0"), mu=("kg/m", "mass a length", "> 0"),
        EI=("N m^2", "bending stiffness", "> 0"), alpha=("s", "material damping", ">= 0"),
    )  # fmt: skip
    modes = beam.option("modes", range(1, most + 1), default=3)
    line = beam.field("w", "m", "deflection", length=L, shape=shape, modes=modes, coordinates="c")
    x, w, u = line.position, line.deflection, line.shortening
    velocity = rate(w) ** 2
    potential = EI * line.curvature**2 / 2
    if load == "hub":
        velocity = (rate(w) + (x - u) * beam.speed) ** 2 + (rate(u) + w * beam.speed) ** 2
    if load == "weight":
        (g,) = beam.parameters(g=("m/s^2", "gravity against the axis"))
        potential += mu * g * (x - u)
    if load == "thrust":
        (P,) = beam.parameters(P=("N", "compression at the end"))
        beam.force(P, along=line.total_shortening)
    if load != "none":
        beam.output("tension", line.at(line.tension, L / 4), "N", "at the quarter")
    beam.output("deflection", line.at(w, 2 * L / 3), "m", "at two thirds")
    beam.output("slope_rate", line.at(rate(line.slope), 2 * L / 3), "rad/s", "at two thirds")
    beam.output(
        "bending", line.at(EI * (line.curvature + alpha * rate(line.curvature)), L / 4), "N m", "moment"
    )
    beam.kinetic = line.integral(mu * velocity / 2)
    beam.potential = line.integral(potential)
    beam.dissipation = line.integral(alpha * EI * rate(line.curvature) ** 2 / 2)
    return beam


L, MU, EI, ALPHA = 1.7, 0.9, 320.0, 2e-3


def matrices(module, *extra, modes=3, speed=1.0):
    return [np.array(part) for part in module.linearised(modes=modes)(0.3, speed, [L, MU, EI, ALPHA, *extra])]


@pytest.mark.parametrize("modes", [1, 3, MOST])
def test_frequencies_of_a_pinned_beam_are_exact(modes):
    M, C, K, d = matrices(module_of(column(sine)), modes=modes)
    exact = (np.arange(1, modes + 1) * np.pi / L) ** 2 * np.sqrt(EI / MU)
    np.testing.assert_allclose(np.sqrt(scipy.linalg.eigh(K, M)[0]), exact, rtol=1e-12)
    np.testing.assert_allclose(C, ALPHA * K, rtol=1e-14)
    assert not d.any()


def test_frequencies_of_a_cantilever_converge_from_above():
    """The reference is (βl)² of the clamped–free beam. With any number of modes, the result is an upper
    bound."""
    module = module_of(column(cantilever))
    computed = []
    for modes in (4, 10, MOST):
        M, _, K, _ = matrices(module, modes=modes)
        computed.append(np.sqrt(scipy.linalg.eigh(K, M)[0][:2] * MU / EI) * L**2)
    exact = np.array([1.8751040687119611, 4.694091132974174]) ** 2
    errors = np.array(computed) / exact - 1
    assert (errors > 0).all()
    assert (np.diff(errors, axis=0) < 0).all()
    assert (errors[-1] < [2e-5, 5e-4]).all()


def test_column_under_own_weight_buckles_at_greenhills_length():
    """The column is clamped at the bottom: μ g l³/EI = (9/4) j², where j is the first zero of Bessel's
    function of order −1/3."""
    zero = scipy.optimize.brentq(lambda z: scipy.special.jv(-1 / 3, z), 1.5, 2.2)
    module = module_of(column(cantilever, "weight"))
    critical = scipy.optimize.brentq(
        lambda load: np.linalg.eigvalsh(matrices(module, load * EI / (MU * L**3), modes=MOST)[2])[0], 1, 20
    )
    assert critical == pytest.approx(9 / 4 * zero**2, rel=1e-5)
    assert critical > 9 / 4 * zero**2


def test_pinned_column_buckles_at_eulers_load():
    module = module_of(column(sine, "thrust"))
    P = 0.4 * np.pi**2 * EI / L**2
    K = matrices(module, P, modes=5)[2]
    k = np.arange(1, 6)
    np.testing.assert_allclose(K, np.diag(EI * L / 2 * (k * np.pi / L) ** 4 * (1 - 0.4 / k**2)), rtol=1e-12)


def test_rotating_beam_is_stiffened_by_its_tension():
    """Tension N = μ Ω² (l² − x²)/2 and transverse load −μ Ω² w, both integrated by quadrature."""
    module, speed = module_of(column(cantilever, "hub")), 40.0
    M, C, K, d = matrices(module, modes=6, speed=speed)
    w, slope, curvature = (sampled(cantilever, order)[:6] / L**order for order in range(3))
    tension = MU * speed**2 * L**2 * (1 - NODE**2) / 2
    dx = WEIGHT * L
    by_hand = EI * (curvature * dx) @ curvature.T + (slope * dx * tension) @ slope.T
    by_hand -= MU * speed**2 * (w * dx) @ w.T
    np.testing.assert_allclose(K, by_hand, rtol=0, atol=1e-12 * abs(by_hand).max())
    np.testing.assert_allclose(M, MU * (w * dx) @ w.T, rtol=1e-12)
    np.testing.assert_allclose(
        C, ALPHA * EI * (curvature * dx) @ curvature.T, rtol=0, atol=1e-12 * abs(C).max()
    )
    assert not d.any()
    at_rest = np.zeros(6)
    _, at_quarter, *_ = module.outputs(modes=6)(0.3, speed, at_rest, at_rest, at_rest, [L, MU, EI, ALPHA])
    assert float(at_quarter) == pytest.approx(MU * speed**2 * L**2 * (1 - 1 / 16) / 2, rel=1e-14)


def test_drive_torque_is_the_rate_of_angular_momentum():
    """To first order in the deflection, the angular momentum is μ∫(x² Ω + x ẇ) dx."""
    module, modes = module_of(column(cantilever, "hub")), 5
    q, qd, qdd = np.random.default_rng(1).normal(size=(3, modes))
    torque = module.outputs(modes=modes)(0.3, 40.0, q, qd, qdd, [L, MU, EI, ALPHA])[0]
    moment = sampled(cantilever, 0)[:modes] @ (WEIGHT * NODE) * L**2
    assert float(torque) == pytest.approx(MU * moment @ qdd, rel=1e-12)


def test_field_values_at_positions_match_the_mode_sum():
    module, modes = module_of(column(sine)), 7
    q, qd = np.random.default_rng(2).normal(size=(2, modes))
    values = module.outputs(modes=modes)(0.3, 1.0, q, qd, 0 * q, [L, MU, EI, ALPHA])[1:]
    k = np.arange(1, modes + 1) * np.pi
    curvature = -((k / L) ** 2) * np.sin(k / 4)
    expected = [np.sin(2 * k / 3) @ q, k / L * np.cos(2 * k / 3) @ qd, EI * curvature @ (q + ALPHA * qd)]
    np.testing.assert_allclose([float(value) for value in values], expected, rtol=1e-12)


def test_generated_mode_functions_match_their_definition():
    module = module_of(column(cantilever))
    assert module.FIELDS == (("w", "m", "deflection"),)
    shapes = np.array(module.fields(modes=4)(0.3)).ravel()
    np.testing.assert_allclose(shapes, 1 - np.cos((np.arange(1, 5) - 0.5) * np.pi * 0.3), rtol=1e-14)


def test_residual_matches_the_matrices():
    module, modes = module_of(column(cantilever, "hub")), 4
    q, qd, qdd = np.random.default_rng(3).normal(size=(3, modes))
    r = np.array(module.residual(modes=modes)(0.3, 9.0, q, qd, qdd, [L, MU, EI, ALPHA])).ravel()
    M, C, K, d = matrices(module, modes=modes, speed=9.0)
    np.testing.assert_allclose(r, M @ qdd + C @ qd + K @ q - d.ravel(), rtol=1e-13)


def test_generated_text_is_independent_of_the_number_of_modes():
    few, many = (module_text(column(sine, most=most), "0" * 64, "column") for most in (3, 20))
    listed = "".join(f'    ("c{k}", "m", "deflection: amplitude of mode {k}"),\n' for k in range(4, 21))
    assert len(many) == len(few) + len(listed) + len("1, 21") - len("1, 4")


def test_printed_equations_contain_modal_integrals():
    shown = equations(column(sine, "hub"))
    assert r"M_{ij} = L \mu \int \psi_i \psi_j d\xi" in shown
    assert r"\int \xi^2 \psi_i' \psi_j' d\xi" in shown
    assert shown.endswith("d_i = 0")


def statement() -> tuple[Mechanism, sympy.Symbol, sympy.Symbol]:
    beam = Mechanism("beam", "Uniform beam")
    length, mu = beam.parameters(L=("m", "length", "> 0"), mu=("kg/m", "mass a length", "> 0"))
    return beam, length, mu


def declared(shape=sine, values=range(1, 4)):
    beam, length, mu = statement()
    modes = beam.option("modes", values)
    return beam, beam.field("w", "m", "deflection", length=length, shape=shape, modes=modes), mu


def test_field_excludes_other_coordinates_and_fields():
    beam, line, _ = declared()
    with pytest.raises(DeclarationError, match="no other coordinates and no second field"):
        beam.field("v", "m", "deflection", length=line.length, shape=sine, modes=beam.declared_options[0])
    beam, length, _ = statement()
    beam.coordinates(q1=("m", "displacement"))
    with pytest.raises(DeclarationError, match="no other coordinates and no second field"):
        beam.field("w", "m", "deflection", length=length, shape=sine, modes=beam.option("modes", range(1, 4)))


def test_number_of_modes_must_be_an_integer_option():
    with pytest.raises(DeclarationError, match="an option with a range from 1 on"):
        declared(values=("few", "many"))
    with pytest.raises(DeclarationError, match="an option with a range from 1 on"):
        declared(values=range(4))
    beam, length, _ = statement()
    with pytest.raises(DeclarationError, match=r"modes is 2; give an option with a range from 1 on"):
        beam.field("w", "m", "deflection", length=length, shape=sine, modes=2)


def test_mode_function_must_depend_on_number_and_position_only():
    stray = sympy.Symbol("beta", real=True)
    with pytest.raises(DeclarationError, match="must depend on both k and xi, and on nothing else"):
        declared(shape=lambda k, xi: sin(k * stray * xi))
    with pytest.raises(DeclarationError, match="must depend on both k and xi, and on nothing else"):
        declared(shape=lambda k, xi: sin(pi * xi))


def test_names_derived_from_a_field_are_reserved():
    beam, *_ = declared()
    for name in ("w", "w_slope", "q3", "q1d"):
        with pytest.raises(DeclarationError, match="is declared twice"):
            beam.parameters(**{name: ("m", "length")})


def test_names_of_generated_functions_are_reserved():
    beam, length, mu = statement()
    modes = beam.option("modes", range(1, 4))
    line = beam.field("pairs", "m", "deflection", length=length, shape=sine, modes=modes)
    beam.kinetic = line.integral(mu * rate(line.deflection) ** 2 / 2)
    with pytest.raises(DeclarationError, match='"pairs" cannot be the name of a field'):
        module_of(beam)


def test_names_of_modal_integrals_are_reserved():
    beam, line, _ = declared()
    (mass,) = beam.parameters(w_00_0=("kg/m", "mass a length", "> 0"))
    beam.kinetic = line.integral(mass * rate(line.deflection) ** 2 / 2)
    with pytest.raises(DeclarationError, match='"w_00_0" is the name of an integral of mode functions'):
        project(beam, line)


def test_density_outside_an_integral_is_refused():
    beam, line, mu = declared()
    beam.kinetic = mu * rate(line.deflection) ** 2 / 2
    with pytest.raises(UnknownSymbolError, match="kinetic energy contains wd, which is not allowed there"):
        check(beam)


def test_wrong_unit_of_a_density_is_refused():
    beam, line, mu = declared()
    beam.kinetic = line.integral(mu * line.deflection**2)
    with pytest.raises(UnitError, match="kinetic energy"):
        check(beam)


def test_values_at_positions_are_allowed_in_outputs_only():
    beam, line, mu = declared()
    beam.kinetic = line.integral(mu * rate(line.deflection) ** 2 / 2) + mu * line.at(line.deflection, 0) ** 2
    with pytest.raises(UnknownSymbolError, match="energy contains w_at_1, which is not allowed there"):
        check(beam)


def test_outputs_cannot_depend_on_the_position():
    beam, line, mu = declared()
    beam.kinetic = line.integral(mu * rate(line.deflection) ** 2 / 2)
    beam.output("somewhere", line.deflection, "m", "deflection")
    with pytest.raises(UnknownSymbolError, match="output somewhere contains w, which is not allowed there"):
        check(beam)


def projected(beam):
    check(beam)
    return module_text(beam, "0" * 64, "beam")


def test_field_without_inertia_is_refused():
    beam, line, mu = declared()
    beam.potential = line.integral(mu * line.curvature**2 * line.length**4 * beam.speed**2)
    with pytest.raises(SingularMassError, match="no inertia to w"):
        projected(beam)


def test_densities_must_be_polynomials_in_the_position():
    beam, line, mu = declared()
    beam.kinetic = line.integral(mu * sin(line.position / line.length) * rate(line.deflection) ** 2 / 2)
    with pytest.raises(UnsupportedExpressionError, match="must be polynomials in w_position"):
        projected(beam)


def test_nested_integrals_are_refused():
    beam, line, mu = declared()
    inner = line.integral(mu * rate(line.deflection) ** 2 / 2)
    beam.kinetic = line.integral(inner / line.length)
    with pytest.raises(DeclarationError, match="sums of integrals over w, without nested integrals"):
        projected(beam)
    beam.kinetic = inner**2 / (mu * line.length**3 * beam.speed**2)
    with pytest.raises(DeclarationError, match="sums of integrals over w, without nested integrals"):
        projected(beam)


def test_every_pair_of_derivatives_couples_in_the_correct_entry():
    """Nonconservative forces such as follower forces make K nonsymmetric."""
    beam, line, mu = declared()
    beam.kinetic = line.integral(mu * rate(line.deflection) ** 2 / 2)
    w, slope = line.deflection, line.slope
    beam.dissipation = line.integral(mu * beam.speed**2 * rate(w) * slope * line.length)
    K = np.array(module_of(beam).linearised(modes=3)(0.0, 2.0, [L, MU])[2])
    first, second = sampled(sine, 0)[:3], sampled(sine, 1)[:3]
    by_hand = MU * 4.0 * L * (first * WEIGHT) @ second.T
    np.testing.assert_allclose(K, by_hand, rtol=0, atol=1e-12 * abs(by_hand).max())
    assert not any(K[i, i] for i in range(3))
    assert all(K[i, j] == pytest.approx(-K[j, i]) for i, j in product(range(3), range(3)))
