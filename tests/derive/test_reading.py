"""Printed equations: agreement with the equations that are solved, and layout."""

from xml.etree import ElementTree

import mpmath
import pytest
import sympy
from modules import module_of

from derive import Mechanism, Piecewise, cos, emit, loader, pi, rate, sin, sqrt, wrapped
from derive.emit import derive_equations
from derive.errors import CaseError
from derive.functions import PeriodicFunction
from derive.reading import read
from derive.show import case_numbers, equations, latex
from derive.switches import arbitrary_points, in_order
from solve import load

NAMES = [name for name in loader.names() if name != loader.BEAM_ELEMENTS]


def slider():
    """Mechanism whose M would fill a page if written out. It already has a parameter l_a."""
    crank = Mechanism("slider", "Slider-crank with elastic shaft and rod")
    q, u = crank.coordinates(q=("rad", "twist"), u=("m", "stretch"))
    m, r, L, k, l_a = crank.parameters(
        m=("kg", "slider"), r=("m", "crank"), L=("m", "rod"), k=("N m/rad", "shaft"), l_a=("N/m", "rod")
    )
    phi = crank.phase + q
    x = r * cos(phi) + sqrt((L + u) ** 2 - r**2 * sin(phi) ** 2)
    crank.kinetic = m * (rate(x) ** 2 + r**2 * rate(phi) ** 2) / 2
    crank.potential = (k * q**2 + l_a * u**2) / 2
    return crank


def shaken(name="S"):
    """Mechanism with every function that is printed in its own way. `name` is the name of its series."""
    mine = Mechanism("shaken", "With pieces of the phase")
    q = mine.coordinate("q", "m", "deflection")
    m, k, c = mine.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"), c=("N/m", "less spring"))
    s = mine.series(name, harmonics=2, unit="m", meaning="motion of the support")
    stiffness = Piecewise((k, wrapped(3 * mine.phase) < pi), (c, True))
    mine.kinetic = m * rate(q + s(2 * mine.phase)) ** 2 / 2
    mine.potential = stiffness * q**2 / 2
    return mine


def value(expression, point):
    """Value of an expression at an arbitrary point. Series are replaced by other functions."""
    stood_in = expression.replace(
        lambda part: isinstance(part, PeriodicFunction), lambda part: cos(part.args[0] + part.order)
    )
    return stood_in.subs(point).evalf(20)


@pytest.mark.parametrize("name", ["slider", "cam", "gear_pair"])
def test_printed_equations_match_the_solved_equations(name):
    mechanism = slider() if name == "slider" else loader.load(loader.find(name))
    linearised = derive_equations(mechanism).linearised
    computed = read(mechanism, linearised)
    point = arbitrary_points(in_order(*linearised.values()))[2]
    values = dict(point)
    for each in computed:
        for symbol in each.left:
            assert symbol not in values, f"{symbol} has two meanings"
            values[symbol] = value(each.right, values)
    for name, matrix in linearised.items():
        for i, j in ((i, j) for i in range(matrix.rows) for j in range(matrix.cols)):
            index = "" if matrix.rows == 1 else f"_{i + 1}{j + 1}" if matrix.cols > 1 else f"_{i + 1}"
            assert mpmath.almosteq(
                value(matrix[i, j], point), values.get(sympy.Symbol(f"{name}{index}"), 0), 1e-15
            )


def test_repeated_kinematic_expressions_have_names():
    shown = equations(slider())
    assert "l_b = \\sqrt{L^2 - r^2 \\sin^2(\\varphi)} % m\n" in shown
    assert "M_{12} = M_{21} = - L l_c m / l_b\n" in shown
    assert len(shown) < 2000


# The derivation of the joint takes longer than that of all other models together.
@pytest.mark.parametrize("name", [name for name in NAMES if name != "planar_joint"])
def test_lines_fit_a_terminal(name):
    assert max(map(len, equations(loader.load(loader.find(name))).splitlines())) <= 80


def test_inline_fractions_have_the_same_value():
    x, y, z = sympy.symbols("x y z")
    assert latex((x + y) / z**2) == "(x + y) / z^2"
    assert latex(x / (y + z) ** 2) == r"\frac{x}{\left(y + z\right)^2}"


@pytest.mark.parametrize("name", NAMES)
def test_derive_and_solve_read_equal_case_numbers(name):
    """Both packages read the same numbers from a case, whatever their units."""
    source = loader.find(name)
    mechanism = loader.load(source)
    for case in [line[6:-1] for line in source.cases.read_text("utf-8").splitlines() if line[:6] == "[case."]:
        if "." not in case:
            ours = case_numbers(source.cases, case, mechanism)
            theirs = load(name, case=case).parameters
            assert {
                symbol.name: pytest.approx(number, rel=1e-15) for symbol, number in ours.items()
            } == theirs


@pytest.mark.parametrize(
    "edit",
    [
        ('unit = "kg"', "unit = 3"),
        ("[common.parameters]", "[common]\nparameters = 3\n[other]"),
        ("value = 28", "values = 5"),
    ],
)
def test_invalid_case_file_is_refused_without_internal_error(edit, tmp_path):
    source = loader.find("cam")
    text = source.cases.read_text("utf-8")
    assert edit[0] in text
    (tmp_path / "cases.toml").write_text(text.replace(*edit, 1), "utf-8")
    with pytest.raises(CaseError):
        case_numbers(tmp_path / "cases.toml", "1", loader.load(source))


def text(element):
    """Visible text of a formula, without invisible operators."""
    return "".join(ElementTree.fromstring(element).itertext()).replace("\u2062", "").replace("\u2061", "")


def test_mathml_agrees_with_latex():
    cam = [text(equation) for equation in load("cam").module.EQUATIONS]
    assert cam[0].startswith("\u03b7a=contactbilateral")
    assert cam[1:4] == ["M11=I1+(m2+m3)U\u20322", "M12=M21=(m2+m3)U\u2032", "M13=M31=m3U\u2032"]
    pieces = [text(equation) for equation in module_of(shaken()).EQUATIONS]
    assert pieces == ["M=m", "C=0", "K={k(3φmod2π)<πcelse", "d=-4mΩ2S\u2033(2φ)"]
    coupler = [text(equation) for equation in load("coupler").module.EQUATIONS]
    assert coupler[0] == "Mij=Al3ρ∫ψiψjdξ+Iρ∫ψi\u2032ψj\u2032dξl3"
    assert "∂l3φ4φ4\u2033" in coupler[2]
    assert "θcrank=φ" in [text(equation) for equation in load("four_bar").module.EQUATIONS]


def test_series_may_have_the_name_of_a_function():
    assert [text(equation) for equation in module_of(shaken("Ei")).EQUATIONS][-1] == "d=-4mΩ2Ei\u2033(2φ)"


def test_long_equations_are_omitted_with_a_reason(monkeypatch):
    monkeypatch.setattr(emit, "MOST_TO_READ", 3)
    module = module_of(shaken())
    assert not hasattr(module, "EQUATIONS")
    words = "M, C, K and d take {} operations; up to 3 are printed for reading"
    assert words.format(module.OPERATIONS["linearised"]) == module.NO_EQUATIONS
