"""Statements of structures: errors, shared rotations at joints, and the generated module."""

from types import ModuleType

import casadi
import numpy as np
import pytest

from derive import Piecewise, Section, Structure, cos, pi, sqrt
from derive.checks import check
from derive.errors import DeclarationError, UnitError, UnknownSymbolError, UnusedParameterError
from derive.show import elements, equations
from derive.structure_text import structure_text


def stated() -> tuple[Structure, dict]:
    """Two links between three joints, not yet supported."""
    frame = Structure("frame", "Two links")
    E, A, I, rho, L, m = frame.parameters(  # noqa: E741 - the field's symbol
        E=("Pa", "modulus"),
        A=("m^2", "area"),
        I=("m^4", "second moment"),
        rho=("kg/m^3", "density"),
        L=("m", "length"),
        m=("kg", "mass"),
    )
    section = Section(E, A, I, rho, sqrt(A))
    frame.link("post", "foot", "knee", L, pi / 2, section)
    frame.link("arm", "knee", "tip", 2 * L, 0, section, inextensible=True)
    frame.mass("tip", m)
    return frame, {"L": L, "m": m, "section": section, "E": E}


def module_of(structure: Structure) -> ModuleType:
    check(structure)
    module = ModuleType(structure.name)
    exec(structure_text(structure, "0" * 64, structure.name), module.__dict__)
    return module


def test_joints_are_pins_unless_welded_or_clamped():
    frame, _ = stated()
    frame.clamp("foot")
    frame.weld("knee")
    module = module_of(frame)
    assert module.LINKS == (
        ("post", "foot", "knee", "", "post_knee", False),
        ("arm", "knee", "tip", "post_knee", "arm_tip", True),
    )
    assert module.JOINTS == (("foot", True), ("knee", False), ("tip", False))
    assert module.MOVES is False
    pinned, _ = stated()
    pinned.support("foot")
    assert [link[3:5] for link in module_of(pinned).LINKS] == [
        ("post_foot", "post_knee"),
        ("arm_knee", "arm_tip"),
    ]


def test_clamps_and_welds_may_apply_to_selected_links():
    frame, of = stated()
    frame.link("brace", "foot", "knee", of["L"], pi / 2, of["section"])
    frame.weld("foot", "post", "brace")
    frame.clamp("foot", "post")
    frame.weld("knee", "arm", "brace")
    rotations = {name: rest for name, _, _, *rest, _ in module_of(frame).LINKS}
    assert rotations == {
        "post": ["", "post_knee"],
        "arm": ["arm_knee", "arm_tip"],
        "brace": ["", "arm_knee"],
    }


def test_section_properties_match_the_declared_values():
    frame, _ = stated()
    frame.clamp("foot")
    properties = module_of(frame).properties()
    assert properties.name_in() == ["phase", "p"]
    computed = properties.call({"phase": 0.0, "p": casadi.DM([2e11, 4e-4, 3e-8, 7800, 0.5, 0.2])})
    columns = {name: np.array(value).ravel().tolist() for name, value in computed.items()}
    assert columns == {
        "angle": [np.pi / 2, 0],
        "length": [0.5, 1.0],
        "E": [2e11, 2e11],
        "EA": [8e7, 8e7],
        "EI": [pytest.approx(6e3)] * 2,
        "mu": [pytest.approx(3.12)] * 2,
        "height": [pytest.approx(0.02)] * 2,
        "mass": [0, 0, 0.2],
        "damping_ratio": [0],
    }


def test_every_structure_has_the_options_of_the_links():
    frame, _ = stated()
    frame.clamp("foot")
    (elements_, element) = module_of(frame).LINK_OPTIONS
    assert elements_ == ("elements", range(1, 101), 1)
    assert element == ("element", ("cubic", "internal", "curvature", "dynamic"), "cubic")


def test_structure_moves_if_a_link_rotates():
    frame, of = stated()
    frame.link("crank", "foot", "rim", of["L"], frame.phase, of["section"])
    frame.clamp("foot")
    assert module_of(frame).MOVES is True


def checked(build) -> None:
    frame, of = stated()
    build(frame, of)
    check(frame)


@pytest.mark.parametrize(
    ("build", "kind", "words"),
    [
        (lambda f, of: None, DeclarationError, ("frame has no support", "support(joint)")),
        (lambda f, of: f.clamp("fot"), DeclarationError, ('"fot"', 'did you mean "foot"')),
        (lambda f, of: f.clamp("foot", "arm"), DeclarationError, ("joint foot has no link arm", "post")),
        (lambda f, of: f.mass("top", of["m"]), DeclarationError, ('"top"', "foot, knee, tip")),
        (
            lambda f, of: f.link("post", "a", "b", of["L"], 0, of["section"]),
            DeclarationError,
            ("link post is declared twice",),
        ),
        (
            lambda f, of: f.link("ring", "a", "a", of["L"], 0, of["section"]),
            DeclarationError,
            ('starts and ends at "a"',),
        ),
        (
            lambda f, of: f.link("a b", "a", "b", of["L"], 0, of["section"]),
            DeclarationError,
            ('"a b" cannot be the name', "crank"),
        ),
        (
            lambda f, of: (f.clamp("foot"), f.link("rod", "tip", "arm_1", of["L"], 0, of["section"])),
            DeclarationError,
            ('"arm_1"', "a node within link arm", "rename"),
        ),
        (
            lambda f, of: (f.clamp("foot"), f.link("a", "b_c", "tip", of["L"], 0, of["section"]),
                           f.link("a_b", "c", "tip", of["L"], 0, of["section"])),
            DeclarationError,
            ('"a_b_c"', "the ends of two links", "rename"),
        ),
        (
            lambda f, of: (f.clamp("foot"), f.link("r", "a", "b", of["m"], 0, of["section"])),
            UnitError,
            ("length of link r", '"m"', "kg"),
        ),
        (
            lambda f, of: (f.clamp("foot"), f.link("r", "a", "b", of["L"] * cos(f.phase), 0, of["section"])),
            UnknownSymbolError,
            ("length of link r contains phase",),
        ),
        (
            lambda f, of: (f.clamp("foot"), setattr(f, "kinetic", of["E"])),
            DeclarationError,
            ("energies follow from its links",),
        ),
        (
            lambda f, of: (f.clamp("foot"), f.parameters(x=("m", "idle"))),
            UnusedParameterError,
            ("parameter x is not used",),
        ),
        (
            lambda f, of: (f.clamp("foot"), setattr(f, "damping_ratio", of["L"])),
            UnitError,
            ("damping ratio",),
        ),
    ],
)  # fmt: skip
def test_invalid_structures_are_refused(build, kind, words):
    with pytest.raises(kind) as caught:
        checked(build)
    for word in words:
        assert word in str(caught.value)


def test_structure_without_links_is_refused():
    with pytest.raises(DeclarationError, match="bare has no links"):
        check(Structure("bare", "Nothing"))


def test_generated_four_bar_contains_its_closed_loop():
    linkage = Structure("linkage", "A four-bar")
    a, b, c, d, E, A, I, rho = linkage.parameters(  # noqa: E741 - the field's symbol
        a=("m", "crank"), b=("m", "coupler"), c=("m", "follower"), d=("m", "ground"),
        E=("Pa", "modulus"), A=("m^2", "area"), I=("m^4", "second moment"), rho=("kg/m^3", "density"),
    )  # fmt: skip
    phi3, phi4 = linkage.four_bar("phi3", "phi4", crank=a, coupler=b, follower=c, ground=d)
    for name, ends, length, angle in (
        ("crank", "OA", a, linkage.phase), ("coupler", "AB", b, phi3), ("follower", "CB", c, phi4)
    ):  # fmt: skip
        linkage.link(name, *ends, length, angle, Section(E, A, I, rho))
    linkage.clamp("O")
    linkage.support("C")
    module = module_of(linkage)
    p = [0.2, 0.7, 0.6, 0.9, 1.0, 1.0, 1.0, 1.0]
    for phase in np.linspace(0, 2 * np.pi, 9):
        theta, t3, t4 = np.array(module.properties()(phase=phase, p=p)["angle"]).ravel()
        assert theta == pytest.approx(phase)
        gap = 0.2 * np.exp(1j * theta) + 0.7 * np.exp(1j * t3) - 0.9 - 0.6 * np.exp(1j * t4)
        assert abs(gap) < 1e-14
    assert len(module.CONDITIONS) == 2


def test_show_prints_the_links_and_the_elements():
    frame, _ = stated()
    frame.clamp("foot")
    text = equations(frame)
    assert "\nL_{arm} = 2 L\n" in text
    assert "\\frac{13}{35}" in elements()


def test_discontinuous_link_angles_are_refused():
    frame, parts = stated()
    frame.support("foot")
    angle = Piecewise((0, frame.phase < 2), (1, True))
    frame.link("wheel", "tip", "rim", parts["L"], angle, parts["section"])
    with pytest.raises(DeclarationError, match="angle of link wheel has a step or kink in the phase"):
        check(frame)
