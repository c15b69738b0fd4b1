"""Steps and kinks: slopes, phases, impulses, and terms that the linear equations omit."""

import math

import numpy as np
import pytest
import sympy
from modules import module_of, values

from derive import (
    Abs,
    Heaviside,
    Max,
    Mechanism,
    Piecewise,
    Rational,
    cos,
    pi,
    rate,
    rectangle,
    sign,
    sin,
    sqrt,
    trapezoid,
    wrapped,
)
from derive.emit import derive_equations, module_text
from derive.errors import (
    DeclarationError,
    ExpansionError,
    ImpulseError,
    UnitError,
    UnsupportedExpressionError,
)
from derive.switches import slope

x, y = sympy.symbols("x y", real=True)


def oscillator(**parameters):
    """Mass on a spring k, with further parameters. Returns the mechanism and a mapping from names to
    symbols."""
    one = Mechanism("one", "One mass")
    (q,) = one.coordinates(q=("m", "deflection"))
    named = {"m": ("kg", "mass", "> 0"), "k": ("N/m", "spring"), **parameters}
    symbols = dict(zip(named, one.parameters(**named), strict=True))
    one.kinetic = symbols["m"] * rate(q) ** 2 / 2
    one.potential = symbols["k"] * q**2 / 2
    return one, q, symbols


STOP = {"s": ("N/m", "stop"), "gap": ("m", "clearance")}


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (Max(0, x - y) ** 2, lambda a: 2 * max(0, a - 0.4)),
        (Abs(x), math.copysign),
        (Max(0, x) ** Rational(5, 2), lambda a: 2.5 * max(0, a) ** 1.5),
        (Piecewise((0, x < y), ((x - y) ** 3, True)), lambda a: 3 * max(0, a - 0.4) ** 2),
        (Max(0, x) ** 2 + Max(0, -x) ** 2, lambda a: 2 * a),
        (wrapped(x) ** 2 * 0 + sin(wrapped(x)), math.cos),
    ],
)
@pytest.mark.parametrize("at", [-1.3, -0.2, 0.3, 1.7])
def test_slopes_next_to_kinks(expression, expected, at):
    computed = float(slope(expression, x).subs({x: at, y: 0.4}))
    assert computed == pytest.approx(
        expected(1.0, at) if expected is math.copysign else expected(at), abs=1e-12
    )


@pytest.mark.parametrize(
    ("expression", "where"),
    [
        (Heaviside(x - y), "x - y = 0"),
        (x * sign(x - y), "x - y = 0"),
        (wrapped(x), r"x = 0 modulo 2\*pi"),
        (wrapped(x + 1, 4 * pi), r"x \+ 1 = 0 modulo 4\*pi"),
        (Piecewise((x, x < y), (2 * x, True)), "x - y = 0"),
        (y * rectangle(x, 0, y), ".* = 0"),
        (Max(0, x) * Heaviside(x - y), "x - y = 0"),
    ],
)
def test_slope_of_a_jump_is_refused(expression, where):
    with pytest.raises(
        ImpulseError,
        match=f"discontinuous where {where}, so its derivative with respect to x is an impulse",
    ):
        slope(expression, x)


def test_stop_is_linearised_about_the_desired_motion():
    """In the linear equations, the stop is inactive with a clearance and active with a preload. The residual
    contains it in full."""
    one, q, p = oscillator(**STOP)
    one.potential += p["s"] * Max(0, q - p["gap"]) ** 2 / 2
    module = module_of(one)
    for gap, stiffness, load in [(0.3, 5.0, 0.0), (-0.3, 12.0, -7 * 0.3)]:
        M, C, K, d = values(module.linearised(), 0.1, 2.0, [2, 5, 7, gap])
        assert (M[0, 0], C[0, 0], K[0, 0]) == (2, 0, stiffness)
        assert d[0, 0] == pytest.approx(load, rel=1e-15)
    (r,) = values(module.residual(), 0.1, 2.0, 0.5, 0, 0, [2, 5, 7, 0.3])
    assert r[0, 0] == pytest.approx(5 * 0.5 + 7 * 0.2, rel=1e-15)
    assert len(module.SWITCHED) == 1
    assert module.SWITCHED[0].startswith("Max(0, q - gap) is in the energies; linear results")
    ((text, meaning, names),) = module.CONDITIONS
    assert (text, names) == ("gap other than 0", ("gap",))
    assert "no linearisation where q - gap = 0" in meaning
    (margins,) = values(module.conditions(), 0.0, [2, 5, 7, 0.0])
    assert margins == [[0.0]]


def test_slope_of_a_hertzian_contact():
    """The slope of F = h (δ0 + q)^(3/2) is 3/2 h √δ0. Without preload, it is 0 on both sides."""
    hertz = {"h": ("N/m^2", "contact"), "b": ("m", "width", "> 0"), "preload": ("m", "preload", "> 0")}
    one, q, p = oscillator(**hertz)
    one.force(-p["h"] * sqrt(p["b"]) * Max(0, q + p["preload"]) ** Rational(3, 2), along=q)
    K = values(module_of(one).linearised(), 0.1, 2.0, [2, 5, 7, 4, 0.09])[2]
    assert K[0, 0] == pytest.approx(5 + 1.5 * 7 * 2 * 0.3, rel=1e-15)
    one, q, p = oscillator(**hertz)
    one.force(-p["h"] * sqrt(p["b"]) * Max(0, q) ** Rational(3, 2) * (1 + 0 * p["preload"]), along=q)
    equations = derive_equations(one)
    assert equations.linearised["K"][0] == p["k"]
    assert "h is in the energies but not in the linearised equations" in equations.nonlinear[0]


@pytest.mark.parametrize(
    "contact", [lambda q: Max(0, q) ** 2, lambda q: q * Abs(q), lambda q: Piecewise((0, q < 0), (q**2, True))]
)
def test_contact_without_clearance_has_no_linearisation(contact):
    one, q, p = oscillator(s=STOP["s"])
    one.potential += p["s"] * contact(q) / 2
    with pytest.raises(
        ExpansionError,
        match=r"no linearisation at the fundamental motion: .* is 0 during the whole motion, .*clearance or",
    ):
        derive_equations(one)


def test_modulus_of_a_square_root_is_differentiated():
    """SymPy does not recognise √(L² − q²) as real."""
    one, q, p = oscillator(L=("m", "wire"), u=("m", "side"), F=("N", "load"))
    side = sqrt(p["L"] ** 2 - q**2)
    one.potential += p["k"] * Abs(side - p["u"]) ** 3 / p["L"]
    one.force(p["F"] * sign(side - p["u"]) * Abs(side - 2 * p["u"]) / p["L"], along=q)
    module, given = module_of(one), [2.0, 5.0, 1.5, 0.5, 3.0]
    h, at = 0.2, math.sqrt(1.5**2 - 0.2**2)
    wire = -3 * 5 * (at - 0.5) ** 2 * h / at / 1.5
    r = values(module.residual(), 1.0, 1.0, h, 0.0, 0.0, given)[0].item()
    assert r == pytest.approx(5 * h + wire - 3 * abs(at - 1) / 1.5, rel=1e-14)
    stiffness = values(module.linearised(), 1.0, 1.0, given)[2].item()
    assert stiffness == pytest.approx(5 - 3 * 5 / 1.5**2, rel=1e-14)


def test_cancelling_kinks_leave_a_linear_stiffness():
    one, q, p = oscillator(s=STOP["s"])
    one.potential += p["s"] * (Max(0, q) ** 2 + Max(0, -q) ** 2) / 2
    K = values(module_of(one).linearised(), 0.1, 2.0, [2, 5, 7])[2]
    assert K[0, 0] == 12


def test_friction_requires_a_smoothing_velocity():
    one, q, p = oscillator(F=("N", "friction"), v0=("m/s", "smoothing velocity", "> 0"))
    one.force(-p["F"] * sign(rate(q)), along=q)
    with pytest.raises(ExpansionError, match=r"qd is 0 during the whole motion.*v/sqrt\(v\*\*2 \+ v0\*\*2\)"):
        derive_equations(one)
    one.forces.clear()
    one.dissipation = p["F"] * sqrt(rate(q) ** 2 + p["v0"] ** 2)
    C = values(module_of(one).linearised(), 0.1, 2.0, [2, 5, 7, 0.5])[1]
    assert C[0, 0] == pytest.approx(14, rel=1e-15)


def test_messages_name_the_omitted_terms():
    one, q, p = oscillator(k3=("N/m^3", "cubic"), W=("J", "weight"), J=("kg m^2", "flywheel"))
    one.potential += p["k3"] * q**4 / 4 + p["W"]
    # J has no effect on the vibration either, but it loads the drive during a run-up.
    one.kinetic += p["J"] * one.speed**2 / 2
    reported = []
    module_text(one, "", "one", reported.append)
    assert reported == [
        "k3 is in the energies but not in the linearised equations; linear results ignore it",
        "W is in the energies but has no effect: no equation of motion and no output contains it",
    ]


def test_message_names_an_omitted_series_once():
    one, q, _ = oscillator()
    P = one.series("P", 2, "N/m^3", "cubic spring over the turn")
    one.potential += P(one.phase) * q**4
    (sentence,) = derive_equations(one).nonlinear
    assert sentence.startswith("P is in the energies but not in the linearised equations")


def test_breaks_may_depend_on_parameters():
    one, q, p = oscillator(z=("1", "teeth", "integer, >= 1"), eps=("1", "contact ratio"), dk=("N/m", "step"))
    one.potential += p["dk"] * rectangle(p["z"] * one.phase + 1, 0, 2 * pi * p["eps"]) * q**2 / 2
    module = module_of(one)
    given = [2.0, 5.0, 3, 0.3, 7.0]
    tooth = 2 * math.pi / 3
    starts = [(-1 / 3 + k * tooth) % (2 * math.pi) for k in range(3)]
    ends = [(each + 0.3 * tooth) % (2 * math.pi) for each in starts]
    computed = sorted(set(module.breaks(1.0, given)))
    assert computed == pytest.approx(sorted([0.0, *starts, *ends]), abs=1e-14)
    for start in starts:
        K = [
            values(module.linearised(), start + at * tooth, 1.0, given)[2][0, 0]
            for at in (-0.01, 0.01, 0.29, 0.31)
        ]
        assert K == [5, 12, 12, 5]
    assert "drive_torque" not in {name for name, *_ in module.OUTPUTS}
    assert "would contain impulses" in module.NO_DRIVE_TORQUE


def test_step_phases_on_undefined_branches_are_ignored():
    one, _, p = oscillator(a=("1", "one number"), b=("1", "another"), s=("1", "slope"))
    threshold = Piecewise((sqrt(p["a"] - p["b"]), p["a"] > p["b"]), (sqrt(p["b"] - p["a"]), True))
    one.potential *= 1 + Heaviside(sin(one.phase) - threshold) + Heaviside(p["s"] * wrapped(one.phase) - 1)
    module = module_of(one)
    start = math.asin(0.5)
    for a, b in ((0.5, 0.25), (0.25, 0.5)):
        computed = set(module.breaks(1.0, [2.0, 5.0, a, b, 0.0]))
        assert sorted(computed) == pytest.approx([0.0, start, math.pi - start], abs=1e-14)


def test_parameter_may_have_the_name_of_a_function():
    one, q, p = oscillator(sign=("N", "friction"))
    one.force(-p["sign"] * sign(rate(q)), along=q)
    with pytest.raises(ExpansionError, match="there is no linearisation at the fundamental motion"):
        module_of(one)


def test_constant_breaks_match_the_closed_form():
    """√3 cos 2φ + sin 2φ = 2 cos(2φ − π/6) equals 1 if 2φ = π/6 ± π/3."""
    one, q, p = oscillator(F=("N", "load"))
    phase = one.phase
    one.force(p["F"] * Max(0, sqrt(3) * cos(2 * phase) + sin(2 * phase) - 1), along=q)
    one.force(p["F"] * Piecewise((1, phase < 2), (0, phase < 3), (2, True)), along=q)
    breaks = sorted(module_of(one).BREAKS)
    angles = [-math.pi / 12, math.pi / 4]
    expected = [(a + k * math.pi) % (2 * math.pi) for a in angles for k in range(2)]
    assert np.unique(np.round(breaks, 12)) == pytest.approx(sorted([0, 2, 3, *expected]), abs=1e-11)


def test_values_of_a_trapezoid():
    one, q, p = oscillator(F=("N", "load"))
    one.force(p["F"] * trapezoid(one.phase, 5.5, 6, 1 + 2 * pi, 2 + 2 * pi), along=q)
    module = module_of(one)
    shares = {5: 0, 5.5: 0, 5.75: 0.5, 6.1: 1, 0.9: 1, 1.25: 0.75, 2.1: 0}
    for phase, share in shares.items():
        d = values(module.linearised(), phase, 1.0, [2, 5, 1])[3][0, 0]
        assert d == pytest.approx(share, abs=1e-12)
    assert {5.5, 6.0, 1.0, 2.0} <= set(np.round(module.BREAKS, 12))


def cycloid(s):
    return s - sin(2 * pi * s) / (2 * pi)


def cubic(s):
    return s**2 * (3 - 2 * s)


@pytest.mark.parametrize(("rise", "allowed"), [(cycloid, True), (cubic, True), (lambda s: s, False)])
def test_prescribed_motion_may_jump_in_second_derivative(rise, allowed):
    """Cycloidal and cubic rises of a dwell cam are permitted. A linear rise would require an impulse."""
    one, q, p = oscillator(h=("m", "lift"), b=("rad", "rise", "> 0"))
    angle = one.phase
    lift = p["h"] * Piecewise((rise(angle / p["b"]), angle < p["b"]), (1, angle < pi), (0, True))
    back = p["h"] * Piecewise((0, angle < pi), (1 - rise((angle - pi) / pi), True))
    one.kinetic = p["m"] * rate(lift + back + q) ** 2 / 2
    if not allowed:
        with pytest.raises(ImpulseError, match="is discontinuous where"):
            derive_equations(one)
        return
    module = module_of(one)
    assert np.unique(np.round(module.breaks(1.0, [2, 5, 1, 1.2]), 12)) == pytest.approx([0, 1.2, math.pi])
    d = values(module.linearised(), 0.4, 3.0, [2, 5, 0.1, 1.2])[3][0, 0]
    s = x / sympy.Rational(12, 10)
    curvature = float(sympy.diff(rise(s), x, 2).subs(x, 0.4))
    assert d == pytest.approx(-2 * 9 * 0.1 * curvature, rel=1e-12)


def test_fundamental_motion_may_jump_in_its_second_derivative():
    """q̄ = g max(0, sin φ)² has q̄″ = 2g cos 2φ in its first half, and m (q̈ + Ω² q̄″) + k (q + q̄) = 0."""
    one, _, p = oscillator(g=("m", "lift"))
    one.fundamental(q=p["g"] * Max(0, sin(one.phase)) ** 2)
    module = module_of(one)
    for phase in (0.7, 2.0, 4.0):
        d = values(module.linearised(), phase, 3.0, [2, 5, 0.1])[3][0, 0]
        moved = 0.1 * max(0.0, math.sin(phase)) ** 2
        bent = 0.2 * math.cos(2 * phase) if phase < math.pi else 0.0
        assert d == pytest.approx(-2 * 9 * bent - 5 * moved, rel=1e-12, abs=1e-15)
    assert {0.0, math.pi} == set(module.BREAKS)


def test_pieces_may_contain_coordinates_if_conditions_contain_the_phase():
    one, q, p = oscillator(F=("N", "load"))
    one.force(p["F"], along=Piecewise((q, one.phase < 1), (2 * q, True)))
    module = module_of(one)
    loads = [values(module.linearised(), phase, 1.0, [2, 5, 1])[3][0, 0] for phase in (0.5, 1.5, 6.5)]
    assert loads == [1, 2, 1]


def moved_lift(rise):
    one, q, p = oscillator(h=("m", "lift"), J=("kg m^2", "shaft", "> 0"))
    (twist,) = one.coordinates(a=("rad", "twist"))
    angle = wrapped(one.phase + twist)
    lift = p["h"] * Piecewise((rise(angle / 2), angle < 2), (1 - rise((angle - 2) / (2 * pi - 2)), True))
    one.kinetic = p["m"] * rate(lift + q) ** 2 / 2 + p["J"] * rate(one.phase + twist) ** 2 / 2
    return one


@pytest.mark.slow
def test_shifted_motions_may_be_discontinuous_in_third_derivative_only():
    with pytest.raises(
        ExpansionError,
        match=r"it passes .* = 0, where forces or their slopes are discontinuous in the coordinates",
    ):
        derive_equations(moved_lift(cubic))
    smooth = derive_equations(moved_lift(cycloid))
    assert len(smooth.passages) >= 2


REFUSED = {
    "mass": (
        ImpulseError,
        r"is discontinuous where sin\(phase\) = 0, so its derivative with respect to phase is an impulse",
    ),
    "stop": (
        ImpulseError,
        r"discontinuous where .*gap.* = 0, so its derivative with respect to q is an impulse",
    ),
    "shifted": (DeclarationError, r"contains both the phase and a coordinate; .*wrapped\(phase \+ q\)"),
    "square": (UnsupportedExpressionError, "cannot be determined; let steps and kinks depend on the phase"),
    "open": (
        DeclarationError,
        r"has no value where no condition of .* holds; add a last piece with the condition True",
    ),
    "pieces": (UnitError, "cannot be added or compared"),
    "compared": (UnitError, "cannot be added or compared"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_unsupported_steps_are_refused(kind):
    one, q, p = oscillator(gap=("m", "clearance"))
    m, k, gap, phase = p["m"], p["k"], p["gap"], one.phase
    one.output("reach", gap, "m", "clearance")
    if kind == "mass":
        one.kinetic = m * rate(q) ** 2 * (1 + Heaviside(sin(phase))) / 2
    else:
        one.potential = {
            "stop": k * q**2 * Heaviside(q - gap),
            "shifted": k * gap**2 * Max(0, phase + q / gap) ** 2,
            "square": k * q**2 * Heaviside(phase**2 - 2),
            "open": k * q**2 * Piecewise((1, phase < 1)),
            "pieces": Piecewise((k * q**2, phase < 1), (k * q, True)),
            "compared": k * q**2 * Piecewise((1, q < phase), (0, True)),
        }[kind]
    error, message = REFUSED[kind]
    with pytest.raises(error, match=message):
        module_of(one)


def test_rate_of_a_discontinuous_expression_is_refused():
    with pytest.raises(ImpulseError, match="is discontinuous where"):
        rate(Heaviside(sin(oscillator()[0].phase)))
