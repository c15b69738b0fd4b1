"""An animation as one page of HTML: a picture as SVG, of which the script moves the parts that move."""

import json
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from solve.arrays import Plane
from solve.views.moving_picture import Drawn, Scene, scene
from solve.views.page import document, svg_of
from solve.views.style import styled

_SCRIPT = Path(__file__).with_name("moving_page.js")
_POINTS_PER_INCH = 72
"""Of SVG pictures of matplotlib."""

_RIGID = 1e-6
"""Distance from a rigid motion, as a part of the line's size, that counts as none."""

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
_STYLE = """\
body { margin: 0 auto; padding: 1rem; max-width: 56rem; color: #222; background: #fff; }
body { font: 1rem/1.5 sans-serif; }
figure { margin: 0; }
svg { display: block; width: 100%; height: auto; }
.controls { display: flex; gap: 0.75rem; align-items: center; }
input { flex: 1; }
path.mover { fill: none; stroke-linecap: round; stroke-linejoin: round; }
"""


def page_text(drawn: Drawn, warnings: Sequence[str]) -> str:
    """The page; warnings stand below the picture."""
    made = scene(drawn)
    picture, parts = _picture(made)
    data = {"labels": made.labels, "parts": parts}
    doubts = "".join(f"<li>{escape(each)}</li>\n" for each in warnings)
    doubts = f"<h2>Warnings</h2>\n<ul>{doubts}</ul>\n" if doubts else ""
    body = f"""<main>
<figure role="img" aria-label="{escape(drawn.title)}">{picture}</figure>
<div class="controls"><button id="play" type="button">Pause</button>
<input id="frame" type="range" min="0" max="{len(made.labels) - 1}" value="0" aria-label="phase"></div>
{doubts}</main>
<script>
const data = {json.dumps(data, ensure_ascii=False, separators=(",", ":"))};
{_SCRIPT.read_text("utf-8")}</script>
"""
    return document(drawn.title, _POLICY, _STYLE, body)


def _picture(made: Scene) -> tuple[str, list[dict]]:
    """The picture with its moving parts added, and what moves each: an attribute, and its values by frame."""
    figure = made.figure
    with styled():
        figure.set_dpi(_POINTS_PER_INCH)
        figure.canvas.draw()
    figure.set_layout_engine("none")
    height = figure.bbox.height
    x, y = made.label.get_transform().transform(made.label.get_position())
    for artist in (*(mover.artist for mover in made.movers), made.label):
        artist.set_visible(False)
    texts, parts = [], []
    for mover in sorted(made.movers, key=lambda mover: mover.artist.get_zorder()):
        text, moved = _part(mover.artist, _on_paper(mover.artist, mover.places, height))
        texts.append(text)
        parts.append(moved)
    size = made.label.get_fontsize()
    place = f'x="{x:.1f}" y="{height - y + size:.1f}"'
    label = f'<text id="label" {place} font-size="{size}" font-family="sans-serif"/>'
    return svg_of(figure).replace("</svg>", "".join([*texts, label, "</svg>"])), parts


def _on_paper(artist, places: Plane, height: float) -> Plane:
    """Places in the units of the picture, whose y goes downwards, as x + iy."""
    pairs = np.stack((places.real, places.imag), axis=-1).reshape(-1, 2)
    x, y = artist.axes.transData.transform(pairs).T
    return (x + 1j * (height - y)).reshape(places.shape)


def _part(artist, places: Plane) -> tuple[str, dict]:
    """A path of SVG, and what moves it: a transformation where the line is rigid, else its points."""
    width = artist.get_linewidth() if artist.get_linestyle() != "None" else artist.get_markersize()
    style = f'class="mover" stroke="{artist.get_color()}" stroke-width="{width}"'
    first = places[:, 0]
    middle = first.mean()
    arms, size = first - middle, np.abs(first - middle).max()
    means = places.mean(axis=0)
    turns = np.ones(places.shape[1], dtype=complex)
    if size > 0:
        turns = (arms.conj()[:, None] * (places - means)).sum(axis=0) / (np.abs(arms) ** 2).sum()
    error = np.abs(places - means - turns * arms[:, None]).max() + size * np.abs(np.abs(turns) - 1).max()
    if error <= _RIGID * max(size, 1.0):
        moves = [
            f"matrix({b.real:.5g} {b.imag:.5g} {-b.imag:.5g} {b.real:.5g} {a.real:.2f} {a.imag:.2f})"
            for a, b in zip(means, turns, strict=True)
        ]
        return f'<path {style} d="{_path(arms)}"/>', {"name": "transform", "values": moves}
    return f"<path {style}/>", {"name": "d", "values": [_path(each) for each in places.T]}


def _path(places: Plane) -> str:
    """A line through places; one alone is a dot."""
    numbers = [f"{each.real:.2f} {each.imag:.2f}" for each in places]
    return f"M{numbers[0]}" + ("L" + " ".join(numbers[1:]) if len(numbers) > 1 else "h0")
