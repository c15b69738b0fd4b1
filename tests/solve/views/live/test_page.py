"""Live page in a browser: sliders, typed units, errors, cursors, commands, widths and latency."""

import json
import os
import shlex
from pathlib import Path

import pytest

import solve
from solve.commands.app import run

pytestmark = pytest.mark.slow
pytest.importorskip("tornado", reason="the live window needs the extra `explore`")

SOLVED = "document.documentElement.dataset.detailed"


@pytest.fixture(scope="module")
def address():
    live = solve.explore("cam", "300 rpm")
    yield live.address
    live.close()


@pytest.fixture
def page(chromium, address):
    tab = chromium.open(address)
    tab.wait(SOLVED)
    yield tab
    assert tab.errors == []
    assert {request for request in tab.requests if not request.startswith((address, "data:"))} == set()


def number(tab):
    """Return the number of the displayed solution."""
    return int(tab.evaluate("document.documentElement.dataset.drawn || 0"))


def after(tab, work):
    """Wait until a newer solution, with its details, is drawn."""
    before = number(tab)
    work()
    tab.wait(f"Number({SOLVED}) > {before} && {SOLVED} === document.documentElement.dataset.drawn")


def slide(tab, name, place):
    """Move a slider to a position from 0 to 1000, as a mouse event would."""
    slider = f"document.querySelector('[data-name={name}] input[type=range]')"
    tab.evaluate(f"{slider}.value = {place}; {slider}.dispatchEvent(new Event('input', {{bubbles: true}}))")


def box(tab, selector):
    """Return left, top, width and height of an element."""
    rectangle = f"document.querySelector({json.dumps(selector)}).getBoundingClientRect()"
    return tab.evaluate(f"(r => [r.left, r.top, r.width, r.height])({rectangle})")


def value(tab, name):
    return float(tab.evaluate(f"document.querySelector('[data-name={name}] .typed input').value"))


def test_moved_slider_shows_the_orbit_at_its_value(page):
    after(page, lambda: slide(page, "k1", 550))
    k1 = value(page, "k1")
    orbit = solve.periodic(solve.load("cam", k1=k1), "300 rpm")
    assert page.text("#verdict") == orbit.verdict
    assert page.text("#summary").startswith(orbit.summary)
    warnings = page.evaluate("[...document.querySelectorAll('#warnings li')].map(e => e.textContent)")
    assert warnings == orbit.warnings
    assert page.evaluate("document.querySelectorAll('.curve .line').length") == 3


def test_mouse_moves_a_slider(page):
    left, top, width, height = box(page, "[data-name=speed] input[type=range]")
    before = value(page, "speed")

    def drag():
        page.mouse("Pressed", left + 0.3 * width, top + height / 2)
        page.mouse("Moved", left + 0.8 * width, top + height / 2)
        page.mouse("Released", left + 0.8 * width, top + height / 2)

    after(page, drag)
    assert value(page, "speed") > before


def test_typed_unit_is_converted_and_used_in_the_command(page):
    after(page, lambda: page.type("[data-name=k1] .typed input", "95 kN m/rad"))
    assert value(page, "k1") == 95e3
    assert page.text("#command") == 'solve periodic cam --case 1 --set "k1=95 kN m/rad" --speed "300 rpm"'
    after(page, lambda: page.type("[data-name=speed] .typed input", "5.5 Hz"))
    assert value(page, "speed") == pytest.approx(330)


def test_invalid_input_is_reported_beside_its_field(page):
    before = number(page)
    page.type("[data-name=k1] .typed input", "soft")
    page.wait("!document.querySelector('[data-name=k1] .refusal').hidden")
    assert "k1 is 'soft'; give a number" in page.text("[data-name=k1] .refusal")
    assert page.evaluate("document.querySelector('[data-name=k1] .typed input').ariaInvalid") == "true"
    assert number(page) == before
    after(page, lambda: page.type("[data-name=k1] .typed input", "9e4"))
    assert page.evaluate("document.querySelector('[data-name=k1] .refusal').hidden")


def test_cursor_of_a_sweep_sets_the_slider(page):
    page.evaluate("document.querySelector('#survey form').elements.of.value = 'q3.max_abs'")
    page.type("#survey [name=x-low]", "280")
    page.type("#survey [name=x-high]", "320")
    page.type("#survey [name=x-count]", "5")
    page.click("#survey form button")
    page.wait("!!document.querySelector('#survey .plot svg')")
    page.evaluate("document.querySelector('#survey .plot').scrollIntoView()")
    left, top, width, height = box(page, "#survey .plot svg")

    def click():
        page.mouse("Pressed", left + 0.5 * width, top + 0.4 * height)
        page.mouse("Released", left + 0.5 * width, top + 0.4 * height)

    after(page, click)
    middle = value(page, "speed")
    assert 295 < middle < 305
    after(page, lambda: page.command("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight"))
    assert value(page, "speed") == pytest.approx(middle + 0.4, abs=0.01)


def test_copied_command_reproduces_the_state(page, capsys):
    after(page, lambda: slide(page, "c1", 700))
    after(page, lambda: slide(page, "speed", 520))
    page.command("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    page.command("Page.bringToFront")
    page.click("[data-copies=command]")
    page.wait("document.querySelector('#said').textContent === 'Copied.'")
    copied = page.evaluate("navigator.clipboard.readText()")
    assert copied == page.text("#command")
    assert run([*shlex.split(copied)[1:], "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["parameters"]["c1"] == value(page, "c1")
    largest = page.text(".curve h3 small").removeprefix("largest ").split()
    assert f"{1e3 * found['coordinates']['q1']['max_abs']:.3g}" == largest[0]


def test_selected_quantities_are_shown(page):
    after(page, lambda: page.click("#quantities input[value=contact_force]"))
    titles = page.evaluate("[...document.querySelectorAll('.curve h3 b')].map(e => e.textContent)")
    assert titles == ["q1", "q2", "q3", "contact_force"]


def test_invalid_tolerance_or_magnification_is_not_sent(page):
    before = number(page)
    for selector, text in (("#rtol", "2"), ("#motion .scale", "-3")):
        page.type(selector, text)
        assert not page.evaluate(f"document.querySelector('{selector}').checkValidity()")
    page.type("[data-name=k1] .typed input", "soft")
    page.wait("!document.querySelector('[data-name=k1] .refusal').hidden")
    assert number(page) == before
    page.type("#rtol", "")
    after(page, lambda: page.type("#motion .scale", "3"))
    page.wait("document.querySelector('#motion small').textContent === 'vibration magnified 3 times'")


def test_reset_restores_an_extended_range(page):
    after(page, lambda: page.type("[data-name=speed] .typed input", "9000"))
    after(page, lambda: page.click("#reset"))
    place = page.evaluate("document.querySelector('[data-name=speed] input[type=range]').value")
    assert float(place) == pytest.approx(1000 * (300 - 60) / (900 - 60), abs=1)


def test_model_error_is_one_sentence_and_the_page_continues(chromium):
    live = solve.explore("coupler", "600 rpm")
    try:
        tab = chromium.open(live.address)
        tab.wait(SOLVED)
        tab.type("[data-name=l2] .typed input", "2 m")
        tab.wait("!document.querySelector('#fault').hidden")
        assert "the crank cannot turn fully" in tab.text("#fault")
        tab.resize(700, 800)
        tab.evaluate("new Promise((resolve) => setTimeout(resolve, 200))")
        assert not tab.evaluate("document.querySelector('#fault').hidden")
        assert tab.text("#verdict") == "no solution"
        after(tab, lambda: tab.click("#reset"))
        assert tab.evaluate("document.querySelector('#fault').hidden")
        assert tab.errors == []
    finally:
        live.close()


@pytest.mark.parametrize("width", [360, 420, 768, 1280, 1920])
def test_page_fits_the_width_of_the_window(page, width):
    page.resize(width, 900)
    page.wait(f"innerWidth === {width}")
    assert page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth") == 0
    assert page.evaluate("document.querySelector('#verdict').getBoundingClientRect().bottom") < 300
    page.evaluate("scrollTo(0, 1e5)")
    assert page.evaluate("document.querySelector('#verdict').getBoundingClientRect().top") >= 0


def test_page_reports_the_end_of_the_program(chromium):
    live = solve.explore("mathieu")
    tab = chromium.open(live.address)
    tab.wait(SOLVED)
    tab.click("#quit")
    tab.wait("document.querySelector('#fault').textContent.startsWith('The program has ended.')")
    live.close()


def test_two_windows_have_independent_values(page, chromium, address):
    other = chromium.open(address)
    other.wait(SOLVED)
    after(page, lambda: slide(page, "k1", 400))
    after(other, lambda: slide(other, "k1", 600))
    after(page, lambda: slide(page, "speed", 300))
    for tab in (page, other):
        orbit = solve.periodic(solve.load("cam", k1=value(tab, "k1")), f"{value(tab, 'speed')} rpm")
        assert tab.text("#summary").startswith(orbit.summary)
    assert value(page, "k1") < value(other, "k1")
    assert other.errors == []


MOVES = """(async (count) => {
    const slider = document.querySelector('[data-name=delta] input[type=range]');
    for (let k = 0; k < count; k += 1) {
        slider.value = 400 + k % 200;
        slider.dispatchEvent(new Event('input', {bubbles: true}));
        await new Promise((resolve) => setTimeout(resolve, 10));
    }
})"""


def test_memory_is_bounded_after_a_thousand_moves(chromium, record_property):
    """Latency depends on the machine and is only recorded. Memory and answers are tested."""
    live = solve.explore("mathieu")
    try:
        tab = chromium.open(live.address)
        tab.wait(SOLVED)
        # The caches of grids fill during the first moves.
        tab.evaluate(f"{MOVES}(450)")
        before = heap(tab), resident()
        for name in ("first", "last"):
            tab.evaluate("latencies.length = 0")
            tab.evaluate(f"{MOVES}(450)")
            tab.wait("latencies.length > 0")
            latencies = sorted(tab.evaluate("latencies"))
            record_property(f"median latency (ms), {name} moves", latencies[len(latencies) // 2])
        growth = heap(tab) - before[0], resident() - before[1]
        record_property("growth of page and program (MB)", [size / 1e6 for size in growth])
        assert max(growth) < 3e7
        tab.wait(f"{SOLVED} === document.documentElement.dataset.drawn")
        assert tab.errors == []
    finally:
        live.close()


def heap(tab):
    """Return the memory (bytes) of the JavaScript objects of a page."""
    tab.command("HeapProfiler.collectGarbage")
    return tab.evaluate("performance.memory.usedJSHeapSize")


def resident():
    """Return the resident memory (bytes) of this process, or 0 if the system has no file that states it."""
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if file.exists() else 0
