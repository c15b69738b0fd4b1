"""Animations of mechanisms: geometry compared with closed forms, vibration with the orbit, and files."""

import json
import re
from io import BytesIO

import html5lib
import numpy as np
import pytest
from PIL import Image

import solve
from derive import Mechanism, Section, Structure, cos, rate, sin, sqrt
from solve.equations import sketched
from solve.errors import (
    NoLoadError,
    NoMotionError,
    NoSketchError,
    ReopenedError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.views.animation import Animation
from solve.views.moving_picture import scene
from tests import browser

TURN = np.linspace(0.0, 2 * np.pi, 37)
ROUGH = {"rtol": 1e-4}
NAMES = ("cam", "manipulator", "gear_pair", "coupler", "four_bar", "mathieu", "meissner")
SPEEDS = {"cam": "100 rpm", "coupler": "600 rpm", "four_bar": "20 rad/s"}


def rigid(model):
    return sketched(model, TURN, 10.0, np.zeros((model.n, len(TURN))))


def length(line):
    return np.abs(line[-1] - line[0])


@pytest.fixture(scope="module")
def coupler():
    return solve.animate(solve.load("coupler"), "600 rpm", **ROUGH)


@pytest.fixture(scope="module")
def mathieu():
    return solve.animate(solve.load("mathieu"), frames=5, **ROUGH)


@pytest.mark.parametrize(
    ("name", "links"),
    [
        ("coupler", {"crank": "l2", "coupler": "l3", "follower": "l4"}),
        ("four_bar", {"crank": "L1", "coupler": "L2", "follower": "L3"}),
    ],
)
def test_rigid_links_keep_their_lengths_and_meet(name, links):
    model = solve.load(name)
    lines = rigid(model)
    for link, parameter in links.items():
        np.testing.assert_allclose(length(lines[link]), model.parameters[parameter], rtol=1e-12)
    np.testing.assert_allclose(lines["crank"][-1], lines["coupler"][0], atol=1e-14)
    np.testing.assert_allclose(lines["coupler"][-1], lines["follower"][-1], atol=1e-12)
    np.testing.assert_allclose(lines["crank"][-1], length(lines["crank"]) * np.exp(1j * TURN), atol=1e-12)


def test_cam_follower_matches_the_transmission_function():
    """U is the integral with zero mean of Σ aₖ cos kφ, chapter Eq. (65). The cam profile touches the
    follower."""
    model = solve.load("cam")
    lines = rigid(model)
    lift = sum(model.parameters[f"a{k}"] / k * np.sin(k * TURN) for k in range(1, 13))
    np.testing.assert_allclose(lines["follower"][0], 1j * (0.5 + lift), atol=1e-14)
    profile = lines["cam"]
    above = np.array([np.abs(profile - foot).min() for foot in lines["follower"][0]])
    assert above.max() < 0.7 * 2 * np.pi / 360
    around = np.linspace(0, 2 * np.pi, 361)
    radii = 0.5 + sum(model.parameters[f"a{k}"] / k * np.sin(k * around) for k in range(1, 13))
    np.testing.assert_allclose(np.abs(profile[:, 0]), radii, rtol=1e-12)


def test_sketch_of_the_cam_follows_its_coordinates():
    model = solve.load("cam")
    q = np.array([[0.3], [0.01], [0.002]])
    lines, later = sketched(model, np.zeros(1), 1.0, q), sketched(model, np.array([0.3]), 1.0, 0 * q)
    np.testing.assert_allclose(lines["cam"], later["cam"], atol=1e-14)
    np.testing.assert_allclose(lines["follower"] - later["follower"], 0.01j, atol=1e-14)
    np.testing.assert_allclose(lines["output"] - later["output"], 0.012j, atol=1e-14)


def test_gears_roll_on_each_other():
    model = solve.load("gear_pair")
    lines = rigid(model)
    pinion, wheel = (np.unwrap(np.angle(lines[f"{each}_mark"].T @ [-1, 1])) for each in ("pinion", "wheel"))
    ratio = model.parameters["rb1"] / model.parameters["rb2"]
    np.testing.assert_allclose(wheel - wheel[0], -ratio * (pinion - pinion[0]), atol=1e-12)
    distance = (model.parameters["rb1"] + model.parameters["rb2"]) / np.cos(np.radians(20))
    assert lines["wheel_mark"][0, 0].real == pytest.approx(distance, rel=1e-12)


def test_drawn_coupler_is_the_magnified_sum_of_its_modes(coupler):
    """The deflection is w = Σ q_k sin kπξ across the chord, at 33 points."""
    rigid, moved = coupler.lines(TURN, 0.0)["coupler"], coupler.lines(TURN, 7.0)["coupler"]
    q, xi = coupler.vibration(TURN), np.linspace(0, 1, 33)
    w = sum(q[k - 1] * np.sin(k * np.pi * xi)[:, None] for k in (1, 2, 3))
    across = 1j * (rigid[-1] - rigid[0]) / length(rigid)
    np.testing.assert_allclose(moved - rigid, 7.0 * w * across, atol=1e-14)


def test_links_of_a_structure_end_at_its_joints():
    model = solve.load("four_bar")
    animation = solve.animate(model, "20 rad/s", **ROUGH)
    q = dict(zip(model.coordinates, animation.vibration(TURN), strict=True))
    still, moved = animation.lines(TURN, 0.0), animation.lines(TURN, 3.0)
    for link, end, joint in (("crank", -1, "A"), ("coupler", 0, "A"), ("coupler", -1, "B")):
        there = 3.0 * (q[f"{joint}_x"] + 1j * q[f"{joint}_y"])
        np.testing.assert_allclose(moved[link][end] - still[link][end], there, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_moving_model_shows_a_visible_vibration(name):
    animation = solve.animate(solve.load(name), SPEEDS.get(name), frames=3, **ROUGH)
    turn = np.linspace(0, animation.span, 500)
    rigid, moved = animation.lines(turn, 0.0), animation.lines(turn, animation.scale)
    everywhere = np.concatenate([line.ravel() for line in rigid.values()])
    size = max(np.ptp(everywhere.real), np.ptp(everywhere.imag))
    largest = max(np.abs(moved[line] - rigid[line]).max() for line in rigid)
    # Of 1, 2, 5, 10, … the next would be up to 2.5 times as large.
    assert largest > 0.12 * size / 2.6
    assert largest < 0.125 * size or animation.scale == 1
    assert Image.open(BytesIO(gif(animation))).n_frames == 3


def gif(made: Animation) -> bytes:
    stream = BytesIO()
    made._write(".gif", stream)
    return stream.getvalue()


def test_animation_of_an_orbit_shows_this_orbit(coupler):
    model = solve.load("coupler")
    orbit = solve.periodic(model, "600 rpm", **ROUGH)
    animation = solve.animate(orbit, scale=10, show=["stress"])
    assert animation.vibration(TURN).tolist() == orbit.at(TURN).tolist() == coupler.vibration(TURN).tolist()
    assert animation.title == "coupler, case table2, 600 rpm: vibration magnified 10 times"
    assert animation.signals["stress"](TURN).tolist() == orbit.signal("stress")(TURN).tolist()
    assert solve.animate(orbit, scale=1).title.endswith("vibration at its true size")
    assert list(coupler.signals) == ["q1", "q2", "q3"]


def test_animation_uses_the_nonlinear_orbit():
    model = solve.load("cam")
    orbit = solve.nonlinear(model, "300 rpm", rtol=1e-4)
    animation = solve.animate(model, "300 rpm", nonlinear=True, rtol=1e-4)
    assert animation.vibration(TURN).tolist() == orbit.at(TURN).tolist()
    assert list(animation.warnings) == orbit.warnings


def test_free_vibration_matches_the_closed_form():
    """With a constant stiffness, it is cos(√delta t), whose largest value is 1."""
    animation = solve.animate(solve.load("mathieu", epsilon=0, zeta=0, delta=2.0), "1 rad/s", rtol=1e-8)
    phase = np.linspace(0, animation.span, 200)
    assert animation.span == pytest.approx(8 * np.pi)
    np.testing.assert_allclose(animation.vibration(phase)[0], np.cos(np.sqrt(2.0) * phase), atol=2e-4)
    assert animation.scale == 1


def test_figure_states_that_the_motion_is_unstable():
    animation = solve.animate(solve.load("mathieu", case="unstable"), frames=2, **ROUGH)
    assert animation.plot()._supxlabel.get_text().endswith("unstable: it grows")
    assert animation.warnings[0] == "unstable: it grows"
    assert animation.html.count("<li>unstable") == 0
    steady = solve.animate(solve.load("mathieu"), frames=2, **ROUGH)
    assert "unstable" not in steady.plot()._supxlabel.get_text()


def test_animation_has_ninety_frames_and_loops(mathieu, coupler):
    assert len(coupler.drawn(still=False).phase) == 90
    image = Image.open(BytesIO(gif(mathieu)))
    assert image.format == "GIF"
    assert (image.n_frames, image.info["loop"], image.info["duration"]) == (5, 0, 40)
    assert image.size[0] == 720
    assert gif(mathieu) == gif(mathieu)


def test_page_is_valid_html_without_external_resources(mathieu):
    page = mathieu.html
    tree = html5lib.HTMLParser(strict=True).parse(page)
    assert tree is not None
    references = re.findall(r'(?<![-\w])(?:href="|src="|url\()([^"\s)]*)', page)
    assert all(reference.startswith("#") for reference in references)
    assert not re.findall(r"https?://(?!www\.w3\.org)", page)
    assert page.count('class="mover"') == len(page_data(page)["parts"])


def test_notebook_shows_the_page_in_a_frame(mathieu):
    frame = html5lib.HTMLParser(strict=True).parseFragment(mathieu._repr_html_())[0]
    assert frame.attrib["srcdoc"] == mathieu.html


def page_data(page):
    match = re.search(r"^const data = (.*);$", page, re.MULTILINE)
    assert match
    return json.loads(match[1])


def test_page_moves_lines_as_the_figure_does(coupler, laid_out):
    """Each path, moved as by the script, agrees with the line of matplotlib to a hundredth of a point."""
    made = Animation(**{**vars(coupler), "frames": 4})
    page, seen = made.html, scene(made.drawn(still=False))
    figure = seen.figure
    figure.set_dpi(72)
    figure.canvas.draw()
    paths = re.findall(r'<path class="mover"[^>]*?(?: d="([^"]*)")?/>', page)
    movers = sorted(seen.movers, key=lambda mover: mover.artist.get_zorder())
    data = page_data(page)
    assert data["labels"] == ["φ = 0°", "φ = 90°", "φ = 180°", "φ = 270°"]
    kinds = set()
    for path, part, mover in zip(paths, data["parts"], movers, strict=True):
        kinds.add(part["name"])
        for frame, value in enumerate(part["values"]):
            places = numbers(value if part["name"] == "d" else path)
            places = places.reshape(-1, 2) @ [1, 1j]
            if part["name"] == "transform":
                a, b, _, _, x, y = numbers(value)
                places = (a + 1j * b) * places + x + 1j * y
            expected = mover.artist.axes.transData.transform(
                np.stack((mover.points[:, frame].real, mover.points[:, frame].imag), axis=-1)
            )
            expected = expected[:, 0] + 1j * (figure.bbox.height - expected[:, 1])
            np.testing.assert_allclose(places, expected, atol=0.03)
    assert kinds == {"d", "transform"}


def numbers(text):
    return np.array([float(each) for each in re.findall(r"-?[\d.]+(?:e[-+]?\d+)?", text.replace("h0", ""))])


@pytest.mark.slow
def test_page_is_animated_in_a_browser(mathieu, tmp_path):
    if browser.CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    mathieu.save(tmp_path / "moving.html")
    shown, message = browser.run(tmp_path / "moving.html", "--dump-dom", "--virtual-time-budget=100")
    assert re.findall(r".*CONSOLE.*", message) == []
    assert re.search(r'<text id="label"[^>]*>φ = ', shown)
    assert len(re.findall(r'<path class="mover"[^>]* transform="matrix', shown)) > 3


@pytest.mark.parametrize("ending", [".png", ".pdf", ".svg"])
def test_still_figure_shows_several_positions(mathieu, tmp_path, ending):
    file = tmp_path / f"still{ending}"
    mathieu.save(file)
    assert file.stat().st_size > 10_000
    titles = [axes.get_title() for axes in mathieu.plot().axes if axes.axison]
    assert titles == [f"φ = {x}°, period {k}" for x, k in ((0, 1), (108, 2), (36, 4), (144, 5), (72, 7))]


def spring(lines):
    made = Mechanism("spring", "A mass on a spring that is shaken")
    q = made.coordinate("q", "m", "deflection")
    m, k, a, L = made.parameters(m=("kg", "mass"), k=("N/m", "spring"), a=("m", "way"), L=("m", "rod"))
    made.kinetic = m * rate(q + a * cos(made.phase)) ** 2 / 2
    made.potential = k * q**2 / 2
    made.output("height", sqrt(L**2 - (q + a) ** 2), "m", "of a rod")
    if lines:
        made.sketch("rod", [(0, 0), (a * sin(made.phase), sqrt(L**2 - a**2))])
    return made


NUMBERS = {"m": 1.0, "k": 100.0, "a": 0.1, "L": 1.0}


def test_mechanism_in_memory_is_animated():
    animation = solve.animate(solve.load(spring(True), **NUMBERS), "50 rad/s", **ROUGH)
    x = animation.lines(TURN, 1.0)["rod"][-1].real
    np.testing.assert_allclose(x, 0.1 * np.sin(TURN), atol=1e-15)


def test_lines_that_shrink_to_a_point_are_drawn():
    animation = solve.animate(
        solve.load(spring(True), **NUMBERS | {"a": 1e-200, "L": 1e-190}), 50.0, frames=2, **ROUGH
    )
    assert Image.open(BytesIO(gif(animation))).n_frames == 2


def test_undefined_sketch_line_is_reported():
    with pytest.raises(ValueOutOfBoundsError, match="sketch rod of spring is not defined"):
        solve.animate(solve.load(spring(True), **NUMBERS | {"L": 0.05}), "50 rad/s", **ROUGH)


def test_mechanism_without_lines_is_refused_with_advice():
    with pytest.raises(NoSketchError, match=r"spring declares no lines.*mechanism\.sketch.*docs/motion\.md"):
        solve.animate(solve.load(spring(False), **NUMBERS), "50 rad/s")


def test_invalid_animations_are_refused():
    cam, mathieu = solve.load("cam"), solve.load("mathieu")
    with pytest.raises(NoMotionError, match="portal_frame"):
        solve.animate(solve.load("portal_frame"))
    for wrong in (
        {"scale": -1.0},
        {"scale": np.nan},
        {"frames": 0},
        {"frames": 2.5},
        {"frames": 721},
        {"scale": "50"},
    ):
        with pytest.raises(ValueOutOfBoundsError, match="allowed"):
            solve.animate(cam, "100 rpm", **wrong)
    with pytest.raises(NoLoadError, match="mathieu has no load"):
        solve.animate(mathieu, nonlinear=True)
    with pytest.raises(UnknownNameError, match="q9"):
        solve.animate(mathieu, show=["q9"])
    with pytest.raises(ValueOutOfBoundsError, match=r"frames is 90; allowed: 1 … 12"):
        solve.animate(cam, "100 rpm", frames=90, **ROUGH).plot()


def test_animated_orbit_has_its_speed_method_and_equations():
    orbit = solve.periodic(solve.load("coupler"), "600 rpm", **ROUGH)
    for wrong in ({"speed": "100 rpm"}, {"nonlinear": True}, {"method": "radau"}):
        with pytest.raises(ValueOutOfBoundsError, match="omit speed"):
            solve.animate(orbit, **wrong)
    assert solve.animate(orbit, show="q2").signals.keys() == {"q2"}


def test_orbit_from_a_file_cannot_be_animated(tmp_path):
    orbit = solve.periodic(solve.load("coupler"), "600 rpm", **ROUGH)
    orbit.save(tmp_path / "orbit.npz")
    with pytest.raises(ReopenedError, match="load the model again"):
        solve.animate(solve.open(tmp_path / "orbit.npz"))


def test_structure_may_have_lines_in_addition_to_links():
    """The structure is a rotating beam, clamped to a disc, in front of a fixed wall."""
    rotor = Structure("rotor", "A turning beam on a disc")
    E, A, I, rho, L = rotor.parameters(  # noqa: E741 - the field's symbol
        E=("Pa", "modulus"), A=("m^2", "area"), I=("m^4", "second moment"), rho=("kg/m^3", "density"),
        L=("m", "length"),
    )  # fmt: skip
    rotor.link("beam", "hub", "tip", L, rotor.phase, Section(E, A, I, rho))
    rotor.clamp("hub")
    rotor.damping_ratio = 0.02
    radius = 0.1 * rotor.metre
    rotor.sketch("disc", [(radius * cos(rotor.around), radius * sin(rotor.around))])
    rotor.sketch("wall", [(-L, -rotor.metre), (L, -rotor.metre)])
    model = solve.load(rotor, E=2.1e11, A=1e-4, I=1e-9, rho=7850, L=0.5)
    lines = rigid(model)
    assert list(lines) == ["beam", "disc", "wall"]
    np.testing.assert_allclose(lines["beam"][-1], 0.5 * np.exp(1j * TURN), atol=1e-14)
    np.testing.assert_allclose(np.abs(lines["disc"]), 0.1, rtol=1e-14)
    np.testing.assert_allclose(lines["wall"][1], np.full(37, 0.5 - 1j))


def test_positions_of_a_tall_mechanism_are_drawn_in_a_row():
    animation = solve.animate(solve.load("mathieu", delta=-1), **ROUGH)
    width, height = animation.plot().get_size_inches()
    assert height < width
