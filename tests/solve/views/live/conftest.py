"""Fixtures: a browser, a session of the live window without a page, and mechanism files in a separate
folder."""

import time

import pytest

import solve
from derive.command import run as derive
from solve.views.live.controls import first_speed
from solve.views.live.session import Session
from solve.views.live.texts import Origin
from tests import browser, devtools

SPRING = """from derive import Mechanism, rate, cos


def mechanism():
    made = Mechanism("spring", "A mass on a driven spring")
    (q,) = made.coordinates(q=("m", "way"))
    m, k, c, F = made.parameters(
        m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), c=("N s/m", "damper", ">= 0"), F=("N", "load")
    )
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2
    made.dissipation = c * rate(q) ** 2 / 2
    made.force(F * cos(made.phase), along=q)
    return made
"""
CASES = """[case.only]
speed = "3 rad/s"
[case.only.parameters]
m = { value = 2, unit = "kg", source = "chosen" }
k = { value = 50, unit = "N/m", source = "chosen" }
c = { value = 1, unit = "N s/m", source = "chosen" }
F = { value = 10, unit = "N", source = "chosen" }
"""


@pytest.fixture(scope="module")
def running_browser():
    if browser.CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    # Pages in motion would take most of the time of the tests.
    with devtools.browser("--force-prefers-reduced-motion") as running:
        yield running


@pytest.fixture
def chromium(running_browser):
    """Yield a browser whose pages are closed after the test. Otherwise, they would change with the values of
    later tests."""
    yield running_browser
    running_browser.close_pages()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return an empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def spring(folder):
    """Return the path of a derived mechanism file with a case file, m = 2 kg, k = 50 N/m."""
    (folder / "spring.py").write_text(SPRING, encoding="utf-8")
    (folder / "spring.toml").write_text(CASES, encoding="utf-8")
    assert not derive(["spring.py"])
    return "spring.py"


class Window:
    """Session with the messages that it has sent."""

    def __init__(self, model, speed=None, origin=None):
        self.sent, self.points, self.waiting = [], [], []
        origin = Origin.from_model(model) if origin is None else origin
        self.session = Session(model, origin, first_speed(model, speed), self._send, self._later)

    def _send(self, message, points):
        self.sent.append(message)
        self.points.append(points)

    def _later(self, delay, work):
        self.waiting.append((delay, work))

    def ask(self, action, **message):
        """Return the messages sent in answer, including later ones."""
        before = len(self.sent)
        getattr(self.session, action)(message)
        while self.waiting:
            self.waiting.pop(0)[1]()
        return self.sent[before:]

    def solution(self, **message):
        """Return the solution for the current values of the sliders."""
        number = int(time.monotonic() * 1e6)
        self.session.replace(number)
        return next(each for each in self.ask("solve", number=number, **message) if each["is"] != "progress")


@pytest.fixture
def window():
    """Return a function that opens the window of a model by its name."""
    return lambda name, *arguments, **options: Window(solve.load(name, **options), *arguments)
