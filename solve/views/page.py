"""A report and its page: one file of HTML that needs no other, for a screen, a telephone and paper."""

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from solve.errors import SolveError
from solve.results.contents import versions
from solve.results.files import checked, write_atomic
from solve.results.formatting import greek
from solve.results.result import Result
from solve.system import PeriodicSystem
from solve.views.show import html
from solve.views.style import Figure, drawn
from solve.views.tables import table, text

OVER_SPEEDS = 1e-6
"""Least relative error that is asked for over the speeds: curves and tables there show fewer digits."""

ENDINGS = (".html",)

_STYLE = Path(__file__).with_name("page.css")
_SVG = re.compile(r"<svg\b.*</svg>", re.DOTALL)
_UNNEEDED = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->|(?<=<svg)[^>]*?(?= viewBox)", re.DOTALL
)
_NAME = re.compile(r'(\bid="|href="#|url\(#)')
"""What begins the name of an element of a picture, which must be its own on the whole page."""

_NUMBER = re.compile(r"\d+$")

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""What a browser may load: nothing from elsewhere."""

_GIVEN = "given"


@dataclass(frozen=True)
class Part:
    """A part of a report: its heading, what it shows in a sentence, and its result, or why there is none;
    orbit: which of the report's orbits that is, where there are two."""

    heading: str
    about: str
    result: Result | None = None
    reason: str = ""
    orbit: str = ""


@dataclass(frozen=True, eq=False)
class Report:
    """What is known of a system. parts: in the order of the page; speeds (rad/s) and rtol: as asked."""

    system: PeriodicSystem
    parts: Sequence[Part]
    speeds: Sequence[float]
    rtol: float

    @property
    def summary(self) -> list[str]:
        """What was found, a plain sentence or two a part, none twice."""
        found = (part.result.summary for part in self.parts if part.result is not None)
        return list(filter(None, dict.fromkeys(found)))

    @cached_property
    def warnings(self) -> dict[str, list[str]]:
        """What is doubtful, each sentence once, with the headings of the parts that say it."""
        found: dict[str, list[str]] = {}
        for part in self.parts:
            for said in part.result.warnings if part.result is not None else ():
                found.setdefault(said, []).append(part.heading)
        return found

    def orbit_of(self, heading: str) -> str:
        """Which of the report's orbits the part with this heading shows, where there are two."""
        return next(part.orbit for part in self.parts if part.heading == heading)

    @property
    def missing(self) -> dict[str, str]:
        """Why parts have no result, by their headings."""
        return {part.heading: part.reason for part in self.parts if part.reason}

    @cached_property
    def html(self) -> str:
        """The page."""
        return _page(self)

    def save(self, path: str | Path) -> None:
        """Write the page to a file that ends in .html, whole or not at all. Raises FileError."""
        write_atomic(checked(path, ENDINGS, "report"), self.write)

    def write(self, stream: BinaryIO) -> None:
        """The page into a stream."""
        stream.write(self.html.encode())

    def __repr__(self) -> str:
        return "\n".join(
            [f"Report of {self.system.name}; .save('report.html') writes its page", *self.summary]
        )


def _page(report: Report) -> str:
    system = report.system
    sections = {
        "Equations": _equations(system),
        "Parameters": _parameters(system),
        **{part.heading: _part(part) for part in report.parts},
        "How it was calculated": _made(report),
    }
    title = system.title or system.name
    links = "".join(f"<li>{_link(heading)}</li>" for heading in sections)
    case = f", case {system.case}" if system.case else ""
    body = f"""<header>
<h1>{escape(title)}</h1>
<p class="model">Model {escape(system.name + case)}</p>
</header>
<main>
{_section("Findings", _findings(report))}<nav aria-label="Parts of this report"><ol>{links}</ol></nav>
{"".join(_section(*section) for section in sections.items())}</main>
"""
    return document(title, _POLICY, _STYLE.read_text("utf-8"), body)


def document(title: str, policy: str, style: str, body: str) -> str:
    """A page of HTML that needs no other file. policy: what it may load; style, body: lines, each with its
    end."""
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
    """By which the page refers to a part."""
    return re.sub(r"\W+", "-", heading.lower())


def _link(heading: str, words: str = "") -> str:
    return f'<a href="#{_anchor(heading)}">{escape(words or heading)}</a>'


def _findings(report: Report) -> str:
    """The verdict, what else was found, and what is doubtful about it."""
    verdict = [f'<p class="verdict">{escape(sentence)}</p>' for sentence in report.summary[:1]]
    lines = [*verdict, _list(map(escape, report.summary[1:]), "found")]
    if report.warnings:
        links = {part.heading: _link(part.heading, part.orbit) for part in report.parts}
        texts = [
            f"{escape(said)} <small>({', '.join(links[each] for each in parts)})</small>"
            for said, parts in report.warnings.items()
        ]
        lines += ["<h3>Warnings</h3>", _list(texts, "warnings")]
    else:
        lines.append("<p>No warnings.</p>")
    return "\n".join(filter(None, lines))


def _list(items: Iterable[str], kind: str) -> str:
    lines = "".join(f"<li>{each}</li>\n" for each in items)
    return f'<ul class="{kind}">\n{lines}</ul>' if lines else ""


def _equations(system: PeriodicSystem) -> str:
    if not any(system.equations):
        return (
            '<p class="missing">Left out: the system was given as numbers, without equations in symbols.</p>'
        )
    signs = (each.replace("<mo>-</mo>", "<mo>&#x2212;</mo>") for each in system.equations)
    lines = "\n".join(f'<div class="wide">{each}</div>' for each in signs)
    about = "Entries of M, C, K and d that are not zero"
    if system.links:
        about = "What each link is made of; the matrices are assembled from it"
    return f'<p>{about}. φ is the phase of the drive, Ω its speed.</p>\n<div class="equations">{lines}</div>'


def _parameters(system: PeriodicSystem) -> str:
    if not system.parameters:
        return '<p class="missing">Left out: the system was given as numbers, without parameters.</p>'
    rows: list[tuple[str, ...]] = []
    for name, value in system.parameters.items():
        unit, meaning = system.parameter_labels.get(name, ("", ""))
        source = system.parameter_sources.get(name, _GIVEN)
        rows.append((greek(name), f"{value:.9g}", "–" if unit == "1" else unit, meaning, source))
    return _table(("name", "value", "unit", "meaning", "source"), _without_repeats(rows), "value")


def _without_repeats(rows: Iterable[tuple[str, ...]]) -> Iterator[tuple[str, ...]]:
    """Rows that follow each other and differ in nothing but the numbers in name and meaning are one."""

    def kind(row: tuple[str, ...]) -> tuple[str, ...]:
        name, value, unit, meaning, source = row
        return _NUMBER.sub("", name), value, unit, _NUMBER.sub("", meaning), source

    for _, alike in itertools.groupby(rows, kind):
        first, *_, last = [*alike] * 2
        between = zip(first, last, strict=True)
        yield tuple(one if one == other else _joined(one, other) for one, other in between)


def _joined(first: str, last: str) -> str:
    """
    >>> _joined("order 1", "order 12"), _joined("b1", "b12")
    ('order 1 … 12', 'b1 … b12')
    """
    return f"{first} … {last.rpartition(' ')[2]}"


def _part(part: Part) -> str:
    lines, result = [f"<p>{escape(part.about)}</p>"], part.result
    if part.reason:
        what = "Left out" if result is None else "Only stability is known"
        lines.append(f'<p class="missing">{what}: {escape(part.reason)}.</p>')
    if result is None:
        return "\n".join(lines)
    try:
        lines.append(_picture(result.plot(), part))
    except SolveError as reason:
        lines.append(f'<p class="missing">No picture: {escape(str(reason))}.</p>')
    shown = result._repr_html_()
    # Orbits and stability show theirs among what they print, the others do not.
    notes = [note for note in map(escape, getattr(result, "notes", ())) if note not in shown]
    return "\n".join([*lines, _wide(shown), _list(notes, "notes")])


def _wide(content: str) -> str:
    """Tables each in a frame of its own, in which what is wider than the page can be moved."""
    framed = content.replace("<table>", '<div class="wide" tabindex="0"><table>')
    return framed.replace("</table>", "</table></div>")


def _picture(figure: Figure, part: Part) -> str:
    svg = _NAME.sub(rf"\g<1>{_anchor(part.heading)}-", svg_of(figure))
    name = escape(f"{part.heading}: {part.about}")
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{name}"', 1)
    return f"<figure>{svg}</figure>"


def svg_of(figure: Figure) -> str:
    """The figure as an element of HTML, without what only a file of its own needs."""
    stream = BytesIO()
    drawn(figure, Path("picture.svg"))(stream)
    found = _SVG.search(stream.getvalue().decode())
    assert found
    return _UNNEEDED.sub("", found[0]).replace("xlink:href", "href")


def _made(report: Report) -> str:
    """What the page was made with; methods, steps and errors stand with each part."""
    system = report.system
    rows = {
        "relative error asked for": f"{report.rtol:g}, over the speeds {max(report.rtol, OVER_SPEEDS):g}",
        "options of the model": ", ".join(f"{name}={value}" for name, value in system.options.items()),
        "generated equations": system.model_hash or "",
        **versions(),
    }
    if report.speeds:
        span = system.speed_unit.span(min(report.speeds), max(report.speeds))
        rows = {"speeds asked for": f"{len(report.speeds)}, from {span}", **rows}
    return _table(("what", "value"), [row for row in rows.items() if row[1]])


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], number: str = "") -> str:
    """A table of texts, and of numbers under one of the headings."""
    made = table("", *headings, left=len(headings))
    for column in made.columns:
        column.justify = "right" if column.header == number else "left"
    for row in rows:
        made.add_row(*map(text, row))
    return _wide(html(made))
