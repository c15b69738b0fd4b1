"""Report page: contents, omitted sections with reasons, and valid HTML."""

import itertools
import re
from dataclasses import replace
from functools import cache

import html5lib
import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate
from solve.certify.refinement import certified
from solve.commands.deliver import deliver_page
from solve.errors import FileError, MatricesError, MissingValueError, NoResultError, StructureError
from solve.views.page import Part, Report

HTML = "{http://www.w3.org/1999/xhtml}"
SVG = "{http://www.w3.org/2000/svg}"
MATHS = "{http://www.w3.org/1998/Math/MathML}"
RANGE = "1.1:1.2:3 rad/s"


@cache
def parsed(page):
    """Return the page as a tree. In strict mode, html5lib follows the HTML standard and stops at the first
    error, for example an unclosed tag or a repeated attribute. The parser of the standard library accepts any
    text."""
    return html5lib.HTMLParser(strict=True).parse(page)


def texts(tree, tag):
    return ["".join(each.itertext()) for each in tree.iter(HTML + tag)]


@pytest.fixture(scope="module")
def mathieu():
    return solve.report(solve.load("mathieu", epsilon=0.2), RANGE, rtol=1e-3)


@pytest.fixture(scope="module")
def driven():
    """Return a user oscillator: q″ + 0.2 q′ + 4 q = cos φ."""

    def oscillator(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.2 * one, 4.0 * one, np.cos(phase)[:, None]

    return solve.report(solve.PeriodicSystem(oscillator, ["q"]), "1:3:5 rad/s", "1 rad/s", rtol=1e-6)


@pytest.fixture(scope="module")
def frame():
    return solve.report(solve.load("portal_frame"))


@pytest.fixture
def undrawn(monkeypatch):
    """Return a report without figures. Drawing takes longer than solving."""
    monkeypatch.setattr("solve.views.page.svg_of", lambda _: "<svg></svg>")


@pytest.fixture(scope="module", params=["mathieu", "driven", "frame"])
def page(request):
    return request.getfixturevalue(request.param).html


def test_page_has_language_title_and_ordered_headings(page):
    tree = parsed(page)
    assert tree.get("lang") == "en"
    assert len(texts(tree, "h1")) == len(texts(tree, "main")) == 1
    assert texts(tree, "title") == texts(tree, "h1")
    levels = [int(each.tag[-1]) for each in tree.iter() if re.fullmatch(HTML + r"h\d", str(each.tag))]
    assert levels[0] == 1
    assert all(later <= before + 1 for before, later in itertools.pairwise(levels))


def test_identifiers_are_unique_and_references_resolve(page):
    tree = parsed(page)
    names = [each.get("id") for each in tree.iter() if each.get("id")]
    assert len(set(names)) == len(names)
    links = re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', page)
    assert links
    assert {first or second for first, second in links} <= set(names)


def test_page_loads_no_external_resources(page):
    tree = parsed(page)
    tags = {str(each.tag).split("}")[-1] for each in tree.iter()}
    assert not tags & {"script", "link", "iframe", "object", "img"}
    for each in tree.iter():
        for name, value in each.attrib.items():
            if str(name).split("}")[-1] in {"href", "src", "data", "srcset"}:
                assert value.startswith(("#", "data:")), (each.tag, name, value)
    assert "@import" not in page
    assert "default-src 'none'" in page


def test_tables_and_pictures_are_labelled_for_accessibility(page):
    tree = parsed(page)
    tables = list(tree.iter(HTML + "table"))
    assert tables
    for each in tables:
        assert all(cell.get("scope") in {"row", "col"} for cell in each.iter(HTML + "th"))
        assert any(cell.get("scope") == "row" for cell in each.iter(HTML + "th"))
    pictures = list(tree.iter(SVG + "svg"))
    assert pictures
    for each in pictures:
        assert each.get("role") == "img"
        assert len(each.get("aria-label")) > 20


def test_page_contains_equations_and_parameters_with_sources(mathieu):
    tree = parsed(mathieu.html)
    assert len(list(tree.iter(MATHS + "math"))) == len(mathieu.system.labels.equations) == 4
    table = next(each for each in tree.iter(HTML + "table"))
    rows = {row[0]: row[1:] for row in cells(table)}
    assert rows["ε"][0] == "0.2"
    assert rows["ε"][-1] == "given"
    assert rows["ζ"][-1] == solve.load("mathieu").labels.parameter_sources["zeta"] != ""


def test_closed_loop_report_states_that_equations_exclude_feedback(mathieu):
    press = solve.load("manipulator")
    closed = solve.lqr(press, "70 rpm", {"q2": 1e8}, {"u": 1e-3}, rtol=1e-4).closed
    page = Report(closed, [Part("Motion", "", reason="not computed")], [], 1e-4).html
    assert "d, without the feedback. " in page
    assert "manipulator with feedback" in page
    assert "without the feedback" not in mathieu.html


def cells(table):
    return [["".join(cell.itertext()) for cell in row] for row in table.iter(HTML + "tr")]


def test_numbered_parameters_share_one_row():
    page = Report(solve.load("cam"), [], [], 1e-8).html
    names = [row[0] for row in cells(next(parsed(page).iter(HTML + "table")))]
    assert "b1 … b12" in names
    assert {"a1", "a2", "a3", "a4", "a5", "a6 … a12"} <= set(names)
    assert "Fa1 … Fa6" in names


def test_page_contains_the_html_of_each_result(driven):
    orbit = solve.periodic(driven.system, 1.0, rtol=1e-6)
    bare = re.compile(r"<[^>]*>|\s")
    assert bare.sub("", orbit._repr_html_()) in bare.sub("", driven.html)
    assert orbit.summary in driven.summary
    # 1/√((4 − 1)² + 0.2²)
    assert "max|q| = 0.333" in driven.summary[0]


def test_each_orbit_is_solved_once(undrawn, monkeypatch):
    solved = []

    def counted(points, method, request):
        if request.orbit:
            speeds = points.speeds.tolist() if hasattr(points, "speeds") else [points.speed]
            solved.extend((round(60 / (2 * np.pi) * speed, 6), type(points).__name__) for speed in speeds)
        return certified(points, method, request)

    for module in ("solve.single", "solve.batch.batch"):
        monkeypatch.setattr(f"{module}.certified", counted)
    report = solve.report(solve.load("cam"), "595:605:3 rpm", "620 rpm", rtol=1e-3)
    assert {"Critical speeds", "Sensitivities"} <= {part.heading for part in report.parts if part.result}
    assert len(set(solved)) == len(solved)


def test_impossible_sections_are_omitted_with_a_reason(driven, mathieu, frame):
    for heading in ("Vibration by the nonlinear equations", "Validity of the linear model"):
        assert "nonlinear equations" in driven.missing[heading]
    assert "differentiated" in driven.missing["Sensitivities"]
    assert "has no load" in mathieu.missing["Response versus speed"]
    assert list(frame.missing) == ["Motion"]
    for report in (driven, mathieu, frame):
        stated = [text for text in texts(parsed(report.html), "p") if text.startswith(("Left out", "Only"))]
        for reason in report.missing.values():
            assert any(reason in text for text in stated)


def test_report_omits_the_vibration_of_a_machine_without_steady_motion():
    """Stability and frequencies are reported. The periodic motion and the linear response are not."""
    machine = Mechanism("driven_discs", "Two discs that turn freely")
    q1, q2 = machine.coordinates(q1=("rad", "disc 1"), q2=("rad", "disc 2"))
    J, k, k3 = machine.parameters(
        J=("kg m^2", "disc"), k=("N m/rad", "shaft"), k3=("N m/rad^3", "stiffening")
    )
    T = machine.parameter("T", "N m", "torque")
    machine.kinetic = J * (rate(q1) ** 2 + rate(q2) ** 2) / 2
    machine.potential = k * (q1 - q2) ** 2 / 2 + k3 * (q1 - q2) ** 4 / 4
    machine.force(T * (1 + cos(machine.phase)), along=q1)
    system = solve.load(machine, J=1.0, k=3.0, k3=0.5, T=2.0)
    report = solve.report(system, "1:2:3 rad/s", "1.5 rad/s")
    vibration = {"Response versus speed", "Critical speeds", "Validity of the linear model"}
    assert vibration | {"Vibration and stability"} <= report.missing.keys()
    assert all("mean torque" in report.missing[heading] for heading in vibration)
    assert "the periodic motion is" not in report.html
    assert "the motion relative to rigid-body modes is stable" in report.html
    assert "compared with the nonlinear ones" not in report.html


def test_report_without_a_load_contains_stability(mathieu):
    stability = solve.floquet(mathieu.system, 1.0, rtol=1e-3)
    assert mathieu.summary[0] == stability.summary
    assert "Only stability is known: mathieu has no load" in "".join(parsed(mathieu.html).itertext())


def test_failed_section_states_its_reason_and_others_remain():
    """There are no bands at a single speed."""
    report = solve.report(solve.load("mathieu", epsilon=0.2), "1.1 rad/s", rtol=1e-3)
    assert "two speeds" in report.missing["Unstable bands"]
    assert report.summary


def test_warnings_are_listed_once_with_their_sections(undrawn):
    cam = solve.load("cam")
    orbit = solve.periodic(cam, "600 rpm", rtol=1e-2)
    assert len(orbit.warnings) == 2
    parts = [Part(heading, "The same.", orbit) for heading in ("One", "Other")]
    report = Report(cam, parts, [], 1e-2)
    assert report.warnings == {text: ["One", "Other"] for text in orbit.warnings}
    items = ["".join(each.itertext()) for each in parsed(report.html).iter(HTML + "li")]
    for text in report.warnings:
        assert items.count(f"{text} (One, Other)") == 1


def test_warning_states_its_orbit(undrawn, capsys, tmp_path):
    """Both orbits lift off. The page and the terminal state the orbit of each warning."""
    cam = solve.load("cam")
    parts = [
        Part(f"By {each}", "The same.", solve.periodic(cam, f"{rpm} rpm", rtol=1e-2), orbit=each)
        for each, rpm in (("linear orbit", 600), ("nonlinear orbit", 610))
    ]
    report = Report(cam, parts, [], 1e-2)
    items = ["".join(each.itertext()) for each in parsed(report.html).iter(HTML + "li")]
    deliver_page(report, tmp_path / "cam.html")
    message = capsys.readouterr().err
    for orbit in ("linear orbit", "nonlinear orbit"):
        (item,) = [each for each in items if "lifts off" in each and each.endswith(f"({orbit})")]
        assert f"warning: {item}\n" in message


def test_notes_are_shown_once(undrawn):
    cam = solve.load("cam")
    orbit = solve.floquet(cam, "600 rpm", rtol=1e-2)
    noted = replace(orbit, engine_notes=["made by hand"])
    bands = replace(solve.bands(cam, "60:61:2 rad/s", rtol=1e-2), notes=["narrow & few"])
    page = Report(cam, [Part("One", "Its own.", noted), Part("Other", "Beside.", bands)], [], 1e-2).html
    assert page.count("made by hand") == page.count("narrow &amp; few") == 1


def test_repeated_report_is_identical_byte_for_byte(frame):
    assert solve.report(solve.load("portal_frame")).html == frame.html


def test_interrupted_report_leaves_no_file(frame, tmp_path):
    frame.save(tmp_path / "frame.html")
    assert (tmp_path / "frame.html").read_text("utf-8") == frame.html
    with pytest.raises(FileError, match=r"allowed: \.html"):
        frame.save(tmp_path / "frame.pdf")
    assert [path.name for path in tmp_path.iterdir()] == ["frame.html"]


def test_moving_model_requires_a_speed_and_speeds():
    with pytest.raises(MissingValueError, match="states no speed"):
        solve.report(solve.load("cam"), "60:61:2 rad/s")
    with pytest.raises(MissingValueError, match="no speeds given"):
        solve.report(solve.load("cam"), speed="60 rad/s")


def test_singular_mass_matrix_is_refused():
    def singular(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return 0.0 * one, one, one, one[..., 0]

    with pytest.raises(MatricesError, match="M is singular"):
        solve.report(solve.PeriodicSystem(singular, ["q"]), RANGE, 1.0)


def test_report_without_frequencies_is_refused(monkeypatch):
    def refused(*_):
        raise StructureError("the links do not meet")

    monkeypatch.setattr("solve.views.report.frequencies", refused)
    with pytest.raises(NoResultError, match="the links do not meet"):
        solve.report(solve.load("portal_frame"))
