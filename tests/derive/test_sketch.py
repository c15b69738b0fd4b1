"""Sketches of a mechanism: allowed expressions and generated code."""

import numpy as np
import pytest
import sympy

from derive import Mechanism, Section, Structure, cos, rate, sin, sqrt
from derive.checks import check
from derive.errors import DeclarationError, UnitError, UnknownSymbolError
from tests.derive.modules import module_of, values


def slider():
    """Crank of radius r on an elastic shaft, rod of length L, and slider on the x axis."""
    made = Mechanism("slider", "Slider crank")
    q = made.coordinate("q", "rad", "twist")
    J, k, r, L = made.parameters(
        J=("kg m^2", "crank"), k=("N m/rad", "shaft"), r=("mm", "crank"), L=("m", "rod")
    )
    made.kinetic, made.potential = J * rate(made.phase + q) ** 2 / 2, k * q**2 / 2
    angle = made.phase + q
    pin = r * cos(angle), r * sin(angle)
    place = r * cos(angle) + sqrt(L**2 - r**2 * sin(angle) ** 2)
    made.output("place", place, "m", "of the slider")
    return made, q, r, (pin, place)


def test_sketch_points_are_converted_to_coherent_units():
    made, _, r, (pin, place) = slider()
    made.sketch("rod", [pin, (place, 0)])
    made.sketch("disc", [(r * cos(made.around), r * sin(made.around) - made.metre / 4)])
    module = module_of(made)
    assert module.SKETCH == (("rod", "m", "points"), ("disc", "m", "curve"))
    phase, q, running = 0.7, 0.2, 0.3
    rod, disc = values(module.sketch(), phase, 10.0, [q], running, [1.0, 1.0, 50.0, 0.2])
    x, y = 0.05 * np.cos(0.9), 0.05 * np.sin(0.9)
    np.testing.assert_allclose(rod.ravel(), [x, y, x + np.sqrt(0.2**2 - y**2), 0], rtol=1e-14)
    turn = 2 * np.pi * running
    np.testing.assert_allclose(disc.ravel(), [0.05 * np.cos(turn), 0.05 * np.sin(turn) - 0.25], rtol=1e-14)


def test_coordinates_are_relative_to_the_fundamental_motion():
    made, q, r, _ = slider()
    made.sketch("mark", [(0, 0), (r * cos(q), r * sin(q))])
    made.fundamental(q=2 * made.phase)
    (mark,) = values(module_of(made).sketch(), 0.4, 10.0, [0.1], 0.0, [1.0, 1.0, 1000.0, 1.0])
    np.testing.assert_allclose(mark.ravel(), [0, 0, np.cos(0.9), np.sin(0.9)], rtol=1e-14)


def equations_of(made):
    text = made.code()
    return [text.split(f"def {name}(")[1].split("def ")[0] for name in ("linearised", "outputs")]


def test_sketches_do_not_change_the_equations():
    plain, sketched = slider()[0], slider()
    sketched[0].sketch("rod", [sketched[3][0], (sketched[3][1], 0)])
    texts = [equations_of(made) for made in (plain, sketched[0])]
    assert texts[0] == texts[1]


def test_mechanism_without_lines_generates_no_sketch():
    module = module_of(slider()[0])
    assert not hasattr(module, "SKETCH")
    assert not hasattr(module, "sketch")


def test_structure_may_have_lines_in_addition_to_its_links():
    beam = Structure("beam", "A beam")
    E, L = beam.parameters(E=("Pa", "modulus"), L=("m", "length"))
    metre = beam.metre
    beam.link("link", "A", "B", L, beam.phase, Section(E, metre**2, metre**4, 1))
    beam.support("A")
    beam.sketch("ground", [(-L, 0), (L, -beam.metre)])
    with pytest.raises(UnknownSymbolError, match="1 m"):
        check(beam)


@pytest.mark.parametrize(
    ("points", "error", "message"),
    [
        (lambda m, q, r: [(0, 0)], DeclarationError, "two or more"),
        (lambda m, q, r: [], DeclarationError, "two or more"),
        (lambda m, q, r: [(0, 0), (r, 0, 0)], DeclarationError, "two or more"),
        (lambda m, q, r: [(0, 0), r], DeclarationError, "two or more"),
        (lambda m, q, r: [(0, 0), (r, "r")], DeclarationError, "two or more"),
        (lambda m, q, r: r, DeclarationError, "two or more"),
        (lambda m, q, r: [(0, 0), (sympy.I * r, 0)], DeclarationError, "two or more"),
        (lambda m, q, r: [(0, 0), (r * cos(m.around), 0)], DeclarationError, "the moving point of a curve"),
        (lambda m, q, r: [(0, 0), (r, 0.2)], UnitError, "a number multiplied by metre"),
        (lambda m, q, r: [(0, 0), (r, r + 0.2)], UnitError, "sketch line"),
        (lambda m, q, r: [(0, 0), (r * rate(q), 0)], UnknownSymbolError, "sketch line contains qd"),
        (lambda m, q, r: [(0, 0), (sympy.Symbol("R"), 0)], UnknownSymbolError, "contains R, which is not"),
        (lambda m, q, r: [(0, 0), (r / 0, 0)], DeclarationError, "sketch line is not finite"),
    ],
)
def test_points_that_cannot_be_drawn_are_refused(points, error, message):
    made, q, r, _ = slider()

    def stated():
        made.sketch("line", points(made, q, r))
        check(made)

    with pytest.raises(error, match=message):
        stated()


def test_invalid_names_and_units_are_refused():
    made, *_ = slider()
    made.sketch("line", [(0, 0), (0, made.metre)])
    with pytest.raises(DeclarationError, match="sketch line is declared twice"):
        made.sketch("line", [(0, 0), (0, made.metre)])
    for name in ("a b", 3):
        with pytest.raises(DeclarationError, match=f'"{name}" cannot be a name'):
            made.sketch(name, [(0, 0), (0, made.metre)])
    for argument in ("q", "p"):
        with pytest.raises(DeclarationError, match="generated functions take arguments of that name"):
            made.sketch(argument, [(0, 0), (0, made.metre)])
    with pytest.raises(UnitError, match=r'"mm", which is 0\.001'):
        made.sketch("other", [(0, 0), (0, made.metre)], unit="mm")
    with pytest.raises(DeclarationError, match='sketch other is in "1", other sketches in "m"'):
        made.sketch("other", [(0, 0), (0, 1)], unit="1")


@pytest.mark.parametrize("symbol", ["around", "metre"])
def test_sketch_symbols_in_energies_are_refused(symbol):
    made, q, *_ = slider()
    made.sketch("line", [(0, 0), (made.metre * cos(made.around * 0), made.metre)])
    made.potential = made.potential + getattr(made, symbol) * q**2
    with pytest.raises(UnknownSymbolError, match="potential energy contains"):
        check(made)
