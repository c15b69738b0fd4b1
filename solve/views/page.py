"""Report on a system as a self-contained HTML page for large and small screens and for paper."""

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from solve.arguments import matches_annotations
from solve.errors import SolveError
from solve.results.contents import versions
from solve.results.files import checked, write_atomic
from solve.results.formatting import greek
from solve.results.result import Result
from solve.studies.control.feedback import FeedbackLoop
from solve.system import PeriodicSystem
from solve.views.panels import DRAWN_RTOL
from solve.views.show import html
from solve.views.style import Figure, drawn
from solve.views.tables import table, text

ENDINGS = (".html",)

_STYLE = Path(__file__).with_name("page.css")
_SVG = re.compile(r"<svg\b.*</svg>", re.DOTALL)
_UNNEEDED = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|(?<=<svg)[^>]*?(?= viewBox)", re.DOTALL
)
_NAME = re.compile(r'(\bid="|href="#|url\(#)')
"""Pattern that matches the beginning of an identifier in a picture. Identifiers must be unique on the
page."""

_NUMBER = re.compile(r"\d+$")

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy, by which the page loads nothing from elsewhere."""

_GIVEN = "given"


@dataclass(frozen=True)
class Part:
    """Section of a report.

    `heading` is the title, and `about` a sentence on the content. `result` is None if there is no result;
    `reason` then states why. `orbit` is the name of the orbit if the report contains two orbits.
    """

    heading: str
    about: str
    result: Result | None = None
    reason: str = ""
    orbit: str = ""


@dataclass(frozen=True, eq=False)
class Report:
    """Report on a system, from `solve.report`.

    Attributes
    ----------
    system : PeriodicSystem
        System of the report.
    parts : sequence of Part
        Sections in the order of the page.
    speeds : sequence of float
        Requested speeds in rad/s.
    rtol : float
        Requested relative tolerance.
    """

    system: PeriodicSystem
    parts: Sequence[Part]
    speeds: Sequence[float]
    rtol: float

    @property
    def summary(self) -> list[str]:
        """Sentences on the findings of the sections, without repetitions."""
        sentences = (part.result.summary for part in self.parts if part.result is not None)
        return list(filter(None, dict.fromkeys(sentences)))

    @cached_property
    def warnings(self) -> dict[str, list[str]]:
        """Mapping from each warning to the headings of the sections that contain it."""
        headings: dict[str, list[str]] = {}
        for part in self.parts:
            for warning in part.result.warnings if part.result is not None else ():
                headings.setdefault(warning, []).append(part.heading)
        return headings

    def orbit_of(self, heading: str) -> str:
        """Name of the orbit of the section with this heading; empty if the report has only one orbit."""
        return next(part.orbit for part in self.parts if part.heading == heading)

    @property
    def missing(self) -> dict[str, str]:
        """Mapping from the headings of sections without a result to the reasons."""
        return {part.heading: part.reason for part in self.parts if part.reason}

    @cached_property
    def html(self) -> str:
        """HTML text of the page."""
        return _page(self)

    @matches_annotations
    def save(self, path: str | Path) -> None:
        """Write the page to a file that ends in .html, completely or not at all. Raises FileError."""
        write_atomic(checked(path, ENDINGS, "report"), self.write)

    def write(self, stream: BinaryIO) -> None:
        """Write the page to a stream."""
        stream.write(self.html.encode())

    def __repr__(self) -> str:
        return "\n".join(
            [f"Report of {self.system.labels.name}; .save('report.html') writes its page", *self.summary]
        )


def _page(report: Report) -> str:
    system = report.system
    sections = {
        "Equations": _equations(system),
        "Parameters": _parameters(system),
        **{part.heading: _part(part) for part in report.parts},
        "How it was calculated": _settings(report),
    }
    title = system.labels.title or system.labels.name
    links = "".join(f"<li>{_link(heading)}</li>" for heading in sections)
    case = f", case {system.labels.case}" if system.labels.case else ""
    body = f"""<header>
<h1>{escape(title)}</h1>
<p class="model">Model {escape(system.labels.name + case)}</p>
</header>
<main>
{_section("Findings", _findings(report))}<nav aria-label="Parts of this report"><ol>{links}</ol></nav>
{"".join(_section(*section) for section in sections.items())}</main>
"""
    return document(title, _POLICY, _STYLE.read_text("utf-8"), body)


def document(title: str, policy: str, style: str, body: str) -> str:
    """Return a self-contained HTML page. `policy` is its content security policy. All lines of `style` and
    `body` end in a newline."""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{escape(title)}</title>
<style>
{style}</style>
</head>
<body>
{body}</body>
</html>
"""


def _section(heading: str, content: str) -> str:
    return f'<section id="{_anchor(heading)}">\n<h2>{escape(heading)}</h2>\n{content}\n</section>\n'


def _anchor(heading: str) -> str:
    """Return the HTML identifier of a section, from its heading."""
    return re.sub(r"\W+", "-", heading.lower())


def _link(heading: str, text: str = "") -> str:
    return f'<a href="#{_anchor(heading)}">{escape(text or heading)}</a>'


def _findings(report: Report) -> str:
    """Return the HTML of the verdict, the other findings and the warnings."""
    verdict = [f'<p class="verdict">{escape(sentence)}</p>' for sentence in report.summary[:1]]
    lines = [*verdict, _list(map(escape, report.summary[1:]), "found")]
    if report.warnings:
        links = {part.heading: _link(part.heading, part.orbit) for part in report.parts}
        texts = [
            f"{escape(warning)} <small>({', '.join(links[heading] for heading in headings)})</small>"
            for warning, headings in report.warnings.items()
        ]
        lines += ["<h3>Warnings</h3>", _list(texts, "warnings")]
    else:
        lines.append("<p>No warnings.</p>")
    return "\n".join(filter(None, lines))


def _list(items: Iterable[str], kind: str) -> str:
    lines = "".join(f"<li>{item}</li>\n" for item in items)
    return f'<ul class="{kind}">\n{lines}</ul>' if lines else ""


def _equations(system: PeriodicSystem) -> str:
    if not any(system.labels.equations):
        return (
            '<p class="missing">Left out: the system was given as numbers, without equations in symbols.</p>'
        )
    equations = (line.replace("<mo>-</mo>", "<mo>&#x2212;</mo>") for line in system.labels.equations)
    lines = "\n".join(f'<div class="wide">{line}</div>' for line in equations)
    about = "Nonzero entries of M, C, K and d"
    if system.labels.links:
        about = "Members of each link, from which the matrices are assembled"
    if isinstance(system, FeedbackLoop):
        about += ", without the feedback"
    return f'<p>{about}. φ is the phase of the drive, Ω its speed.</p>\n<div class="equations">{lines}</div>'


def _parameters(system: PeriodicSystem) -> str:
    if not system.labels.parameters:
        return '<p class="missing">Left out: the system was given as numbers, without parameters.</p>'
    rows: list[tuple[str, ...]] = []
    for name, value in system.labels.parameters.items():
        unit, meaning = system.labels.parameter_labels.get(name, ("", ""))
        source = system.labels.parameter_sources.get(name, _GIVEN)
        rows.append((greek(name), f"{value:.9g}", "–" if unit == "1" else unit, meaning, source))
    return _table(("name", "value", "unit", "meaning", "source"), _without_repeats(rows), "value")


def _without_repeats(rows: Iterable[tuple[str, ...]]) -> Iterator[tuple[str, ...]]:
    """Yield rows. Successive rows whose names and meanings differ only in their numbers are merged into one
    row."""

    def kind(row: tuple[str, ...]) -> tuple[str, ...]:
        name, value, unit, meaning, source = row
        return _NUMBER.sub("", name), value, unit, _NUMBER.sub("", meaning), source

    for _, run in itertools.groupby(rows, kind):
        first, *_, last = [*run] * 2
        cells = zip(first, last, strict=True)
        yield tuple(one if one == other else _joined(one, other) for one, other in cells)


def _joined(first: str, last: str) -> str:
    """Return a string for a range of names with a common beginning.

    >>> _joined("order 1", "order 12"), _joined("b1", "b12")
    ('order 1 … 12', 'b1 … b12')
    """
    return f"{first} … {last.rpartition(' ')[2]}"


def _part(part: Part) -> str:
    lines, result = [f"<p>{escape(part.about)}</p>"], part.result
    if part.reason:
        extent = "Left out" if result is None else "Only stability is known"
        lines.append(f'<p class="missing">{extent}: {escape(part.reason)}.</p>')
    if result is None:
        return "\n".join(lines)
    try:
        lines.append(_picture(result.plot(), part))
    except SolveError as reason:
        lines.append(f'<p class="missing">No picture: {escape(str(reason))}.</p>')
    shown = result._repr_html_()
    # Orbits and stability contain their notes in the heading; other results do not.
    notes = [note for note in map(escape, getattr(result, "notes", ())) if note not in shown]
    return "\n".join([*lines, _wide(shown), _list(notes, "notes")])


def _wide(content: str) -> str:
    """Return HTML in which each table is in a frame that scrolls if the table is wider than the page."""
    framed = content.replace("<table>", '<div class="wide" tabindex="0"><table>')
    return framed.replace("</table>", "</table></div>")


def _picture(figure: Figure, part: Part) -> str:
    svg = _NAME.sub(rf"\g<1>{_anchor(part.heading)}-", svg_of(figure))
    name = escape(f"{part.heading}: {part.about}")
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{name}"', 1)
    return f"<figure>{svg}</figure>"


def svg_of(figure: Figure) -> str:
    """Return a figure as an SVG element of HTML."""
    stream = BytesIO()
    drawn(figure, Path("picture.svg"))(stream)
    element = _SVG.search(stream.getvalue().decode())
    assert element
    return _UNNEEDED.sub("", element[0]).replace("xlink:href", "href")


def _settings(report: Report) -> str:
    """Return an HTML table of tolerances, options and versions. Methods, steps and errors are stated in the
    sections."""
    system = report.system
    rows = {
        "relative tolerance": f"{report.rtol:g}, over the speeds {max(report.rtol, DRAWN_RTOL):g}",
        "options of the model": ", ".join(f"{name}={value}" for name, value in system.labels.options.items()),
        "generated equations": system.labels.model_hash or "",
        **versions(),
    }
    if report.speeds:
        span = system.labels.speed_unit.span(min(report.speeds), max(report.speeds))
        rows = {"speeds": f"{len(report.speeds)}, from {span}", **rows}
    return _table(("setting", "value"), [row for row in rows.items() if row[1]])


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], number: str = "") -> str:
    """Return an HTML table of texts. The column with the heading `number` is formatted as numbers."""
    cells = [[*map(text, row)] for row in rows]
    content = table("", *headings, left=len(headings), rows=cells)
    for column in content.columns:
        column.justify = "right" if column.header == number else "left"
    return _wide(html(content))
