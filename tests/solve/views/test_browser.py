"""Report in a browser: equations are rendered, the console is empty, and the page fits the width of a
telephone."""

import re

import pytest

import solve
from tests import browser

_ASKED = """<script>
addEventListener("load", () => {
  const equation = document.querySelector("math");
  document.documentElement.dataset.found = JSON.stringify([
    document.querySelectorAll("math").length, equation.namespaceURI,
    equation.getBoundingClientRect().height > 5,
    document.querySelector("figure svg").getBoundingClientRect().width > 200,
    document.documentElement.scrollWidth - document.documentElement.clientWidth,
    Math.max(...[...document.querySelectorAll(".wide")].map(e => e.offsetWidth - e.clientWidth))]);
});
</script></body>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    if browser.CHROMIUM is None:
        pytest.skip("no Chromium is installed")
    file = tmp_path_factory.mktemp("browser") / "report.html"
    solve.report(solve.load("mathieu"), "1.1:1.2:3 rad/s", rtol=1e-3).save(file)
    return file


@pytest.mark.slow
def test_browser_console_is_empty(page):
    _, message = browser.run(page, "--dump-dom")
    assert re.findall(r".*CONSOLE.*", message) == []


@pytest.mark.slow
@pytest.mark.parametrize("width", [360, 1200])
def test_browser_shows_equations_and_pictures_within_the_page_width(page, width):
    # The page itself allows no script.
    text = re.sub(r'<meta http-equiv="Content-Security-Policy".*?>', "", page.read_text("utf-8"))
    requested = page.with_name(f"asked{width}.html")
    requested.write_text(text.replace("</body>", _ASKED), encoding="utf-8")
    shown, _ = browser.run(requested, "--dump-dom", f"--window-size={width},800")
    match = re.search(r'data-found="([^"]*)"', shown)
    assert match
    equations, space, tall, wide, over, bars = match[1].replace("&quot;", '"').strip("[]").split(",")
    assert (int(equations), space.strip('"')) == (4, "http://www.w3.org/1998/Math/MathML")
    assert (tall, wide, int(over), int(bars)) == ("true", "true", 0, 0)
