"""Series: symbolic derivatives, and generated recurrences compared with sums term by term."""

import casadi
import numpy as np
import pytest
import sympy
from modules import module_of, values

from derive import Mechanism, rate
from derive.symbols import PHASE, SPEED, Moving


def probe() -> tuple[Mechanism, Moving]:
    """Unit mass; the outputs added to it are the values of series."""
    one = Mechanism("probe", "Values of series")
    (q,) = one.coordinates(q=("1", "angle"))
    one.energy = "1/s^2"
    one.kinetic = rate(q) ** 2 / 2
    one.decline_drive_torque("the probe has no units")
    return one, q


def outputs_at(mechanism: Mechanism, phase: float, q: float, p: list[float]) -> list[float]:
    results = values(module_of(mechanism).outputs(), phase, 1.0, q, 0.0, 0.0, p)
    return [float(result[0, 0]) for result in results]


def test_derivative_of_a_series_has_the_next_order():
    one, q = probe()
    U = one.transmission("U", harmonics=3, unit="m")
    angle = PHASE + q
    assert U(angle) == U(angle).func(angle, 0)
    assert U(angle).diff(q) == U(angle).func(angle, 1)
    assert sympy.diff(U(2 * q), q, 3) == 8 * U(q).func(2 * q, 3)
    assert rate(U(angle)) == sympy.expand((SPEED + q.rate) * U(angle).func(angle, 1))
    assert U(angle).is_real
    assert sympy.latex(U(PHASE).diff(PHASE) ** 2) == r"\left(U'\right)^{2}"
    assert sympy.latex(sympy.diff(U(q), q, 4)) == r"U^{(4)}\left(q\right)"


def test_transmission_is_the_zero_mean_integral_of_its_coefficients():
    """U from U′ = Σ aₖ cos kφ + bₖ sin kφ, and the derivatives of U of orders 0 to 5."""
    one, q = probe()
    U = one.transmission("U", harmonics=12, unit="1")
    for order in range(6):
        one.output(f"U{order}", sympy.diff(U(one.phase + q), q, order), "1", "derivative")
    generator = np.random.default_rng(65)
    a, b = generator.uniform(-1, 1, (2, 12))
    k = np.arange(1, 13)
    for phase, angle in [(0.0, 0.0), (0.3, -0.1), (6.1, 2.0), (40.0, 0.0)]:
        wave = (a - 1j * b) * np.exp(1j * k * (phase + angle))
        expected = [float(np.sum(wave * (1j * k) ** (order - 1.0)).real) for order in range(6)]
        computed = outputs_at(one, phase, angle, [*a, *b])
        for order, (one_value, other) in enumerate(zip(computed, expected, strict=True)):
            assert abs(one_value - other) < 1e-13 * np.sum(k ** (order - 1.0)), f"order {order}"


def test_series_with_mean_and_multiplied_argument():
    one, q = probe()
    F = one.series("F", harmonics=3, unit="1", meaning="load")
    k = one.harmonic_series("k", 4, unit="1", meaning="stiffness", angles="gamma")
    (z,) = one.parameters(z=("1", "teeth", "integer, >= 1"))
    one.output("load", F(q), "1", "load")
    one.output("slope", F(q).diff(q), "1", "slope")
    one.output("stiffness", k(z * q), "1", "stiffness")
    one.output("stiffness_slope", k(z * q).diff(q), "1", "slope")
    p = np.random.default_rng(73).uniform(-1, 1, 7 + 9)
    q_value, teeth = 0.7, 14
    mean, Fa, Fb = p[0], p[1:4], p[4:7]
    k0, amplitude, gamma = p[7], p[8:12], p[12:16]
    orders, meshes = np.arange(1, 4), np.arange(1, 5)
    x = orders * q_value
    expected = [
        mean + np.sum(Fa * np.cos(x) + Fb * np.sin(x)),
        np.sum(orders * (Fb * np.cos(x) - Fa * np.sin(x))),
        k0 + np.sum(amplitude * np.cos(meshes * teeth * q_value + gamma)),
        -np.sum(amplitude * meshes * teeth * np.sin(meshes * teeth * q_value + gamma)),
    ]
    assert k.mean == sympy.Symbol("k0", real=True)
    assert outputs_at(one, 0.0, q_value, [*p, teeth]) == pytest.approx(expected, rel=1e-12)


def test_nested_series_match_the_chain_rule():
    """A second cam is driven by the first: U(V(φ)) and its derivative."""
    one, _ = probe()
    V = one.transmission("V", harmonics=2, unit="1", coefficients=("c", "s"))
    U = one.transmission("U", harmonics=2, unit="1")
    one.output("both", U(V(one.phase)), "1", "output of the second cam")
    one.output("slope", U(V(one.phase)).diff(one.phase), "1", "its slope")
    c, s, a, b = np.random.default_rng(2).uniform(-1, 1, (4, 2))
    k = np.arange(1, 3)

    def integral(cosine, sine, angle):
        return np.sum((cosine * np.sin(k * angle) - sine * np.cos(k * angle)) / k)

    def slope(cosine, sine, angle):
        return np.sum(cosine * np.cos(k * angle) + sine * np.sin(k * angle))

    inner = integral(c, s, 0.8)
    expected = [integral(a, b, inner), slope(a, b, inner) * slope(c, s, 0.8)]
    assert outputs_at(one, 0.8, 0.0, [*c, *s, *a, *b]) == pytest.approx(expected, rel=1e-13)


def test_all_derivatives_require_two_trigonometric_calls():
    slider = Mechanism("slider", "Mass behind a cam and a spring")
    (q,) = slider.coordinates(q=("rad", "twist"))
    m, k, J = slider.parameters(m=("kg", "mass"), k=("N m/rad", "shaft"), J=("kg m^2", "cam"))
    U = slider.transmission("U", harmonics=12, unit="m")
    slider.kinetic = (J * rate(slider.phase + q) ** 2 + m * rate(U(slider.phase + q)) ** 2) / 2
    slider.potential = k * q**2 / 2
    function = module_of(slider).linearised()
    operations = [function.instruction_id(i) for i in range(function.n_instructions())]
    assert operations.count(casadi.OP_SIN) + operations.count(casadi.OP_COS) == 2
