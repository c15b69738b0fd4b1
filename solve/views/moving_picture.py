"""Pictures of a mechanism in motion: positions, animations, and HTML pages with an animation."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from solve.arrays import Array, Plane
from solve.results.formatting import prefixed
from solve.system import PeriodicSystem
from solve.views.page import document, svg_of
from solve.views.panels import frame_of, labelled
from solve.views.style import BLACK, BLUE, GREY, LIGHT, PAGE_WIDTH, VERMILION, Axes, Figure, page, styled

if TYPE_CHECKING:
    from matplotlib.lines import Line2D
    from matplotlib.text import Text

_SAME = 1e-6
"""Distance between two points, relative to the mechanism's size, up to which the points count as equal. This
distance is far below a pixel, and above round-off."""

_RIGID = {"color": "#B4B4B4", "linewidth": 2.4, "solid_capstyle": "round", "zorder": 2}
_MOVED = {"color": BLUE, "linewidth": 1.5, "solid_capstyle": "round", "zorder": 3}
_GROUND = {"color": BLACK, "linewidth": 1.0, "zorder": 1}
_JOINT = {"color": BLUE, "marker": "o", "markersize": 4, "linestyle": "", "zorder": 4}
_HELD = {"color": BLACK, "marker": "^", "markersize": 5.5, "linestyle": "", "zorder": 4}
_MARK = {"color": VERMILION, "linewidth": 1.0, "zorder": 3}
_DOT = {"color": VERMILION, "marker": "o", "markersize": 4, "linestyle": "", "zorder": 4}


class Panel(NamedTuple):
    """Quantity with its curve, and with its values (frames,) at the frames."""

    name: str
    curve: Array
    values: Array


class Drawn(NamedTuple):
    """Content of a picture. `phase` (k,) are the phases of the frames, and `fine` are the phases of the
    curves. `rigid` and `moved` map the names of lines to points x + iy (points, k) for the rigid motion and
    for the motion with vibration. There is one panel per quantity."""

    system: PeriodicSystem
    title: str
    caption: str
    doubt: str
    phase: Array
    fine: Array
    rigid: Mapping[str, Plane]
    moved: Mapping[str, Plane]
    panels: Sequence[Panel]

    @property
    def labels(self) -> list[str]:
        """Label of each frame: its phase, and the number of its period if there are several periods."""
        several = self.fine[-1] > 1.5 * self.system.period
        return [
            f"φ = {math.degrees(phase % self.system.period if several else phase):.0f}°"
            + (f", period {int(phase // self.system.period + _SAME) + 1}" if several else "")
            for phase in self.phase
        ]


class Mover(NamedTuple):
    """Line of the figure, with its points x + iy (points, frames) in the units of its axes."""

    artist: "Line2D"
    points: Plane

    def show(self, frame: int) -> None:
        """Move the line to its position in a frame."""
        self.artist.set_data(self.points[:, frame].real, self.points[:, frame].imag)


class Scene(NamedTuple):
    """Figure with its moving lines."""

    figure: Figure
    movers: list[Mover]
    label: "Text"
    labels: list[str]

    def show(self, frame: int) -> None:
        """Move all lines to their positions in a frame."""
        for mover in self.movers:
            mover.show(frame)
        self.label.set_text(self.labels[frame])


def scene(drawn: Drawn) -> Scene:
    """Return a scene with the mechanism on the left and, on the right, one panel per quantity with a moving
    mark."""
    low, high = _frame(drawn)
    width, height = (high - low).real, (high - low).imag
    # Inches: the axes are 3.7 wide, and each panel is at least 0.85 high.
    tall = min(max(3.7 * height / width, 2.0, 0.85 * len(drawn.panels)), 4.8)
    with page(tall + 0.95, drawn.title) as figure:
        grid = figure.add_gridspec(len(drawn.panels), 2, width_ratios=(1.3, 1))
        axes = figure.add_subplot(grid[:, 0])
        movers = _mechanism(axes, drawn)
        _framed(axes, low, high, drawn.system.labels.sketch_unit)
        label = axes.text(0.02, 0.98, drawn.labels[0], transform=axes.transAxes, va="top")
        below = None
        for row, panel in enumerate(drawn.panels):
            below = figure.add_subplot(grid[row, 1], sharex=below)
            below.tick_params(labelbottom=row == len(drawn.panels) - 1)
            movers += _panel(below, drawn, panel)
        figure.align_ylabels()
        _caption(figure, drawn)
    return Scene(figure, movers, label, drawn.labels)


def still(drawn: Drawn) -> Figure:
    """Figure of the mechanism at several positions, one panel per position."""
    count = len(drawn.phase)
    low, high = _frame(drawn)
    # Six positions of a tall mechanism fit side by side.
    tall = (high - low).imag > 1.8 * (high - low).real
    columns = count if count <= (6 if tall else 3) else 3 if count in (5, 6, 9) else 4
    rows = math.ceil(count / columns)
    row = (PAGE_WIDTH - 0.6) / columns * (high - low).imag / (high - low).real + 0.12
    with page(1.1 + rows * row, drawn.title) as figure:
        panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for frame, axes in enumerate(panels.flat):
            if frame >= count:
                axes.set_axis_off()
                continue
            for mover in _mechanism(axes, drawn):
                mover.show(frame)
            _framed(axes, low, high, drawn.system.labels.sketch_unit)
            axes.label_outer()
            axes.set_title(drawn.labels[frame].replace(", ", "\n" if columns > 4 else ", "))
        _caption(figure, drawn)
    return figure


def gif(drawn: Drawn) -> bytes:
    """Return the bytes of an animated GIF that repeats endlessly."""
    images = [*_images(scene(drawn))]
    stream = BytesIO()
    images[0].save(stream, "GIF", save_all=True, append_images=images[1:], duration=40, loop=0, optimize=True)
    return stream.getvalue()


def _images(scene: Scene) -> Iterator:
    """Yield the images of the frames, with a common palette. The fixed background is drawn only once."""
    from PIL import Image

    artists = [*(mover.artist for mover in scene.movers), scene.label]
    scene.figure.set_dpi(100)
    canvas, palette = scene.figure.canvas, None
    with styled():
        for artist in artists:
            artist.set_animated(True)
        canvas.draw()
        still = canvas.copy_from_bbox(scene.figure.bbox)  # type: ignore[attr-defined]
        for frame in range(len(scene.labels)):
            canvas.restore_region(still)  # type: ignore[attr-defined]
            scene.show(frame)
            for artist in sorted(artists, key=lambda artist: artist.get_zorder()):
                artist.axes.draw_artist(artist)
            pixels = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[attr-defined]
            image = Image.fromarray(np.ascontiguousarray(pixels))
            palette = palette or image.quantize(colors=64, method=Image.Quantize.FASTOCTREE)
            yield image.quantize(palette=palette, dither=Image.Dither.NONE)


def _mechanism(axes: Axes, drawn: Drawn) -> list[Mover]:
    """Draw the mechanism and its joints: fixed lines are black, the rigid motion is grey, and the vibration
    is blue."""
    movers, size = [], abs(np.subtract(*_frame(drawn)))
    for name, rigid in drawn.rigid.items():
        moved = drawn.moved[name]
        if is_still(moved, size):
            axes.plot(moved[:, 0].real, moved[:, 0].imag, **_GROUND)
            continue
        movers += [_mover(axes, rigid, _RIGID), _mover(axes, moved, _MOVED)]
        for end in {0: moved[0], -1: moved[-1]}.values():
            if is_still(end[None], size) and not is_closed(moved, size):
                axes.plot(end[0].real, end[0].imag, **_HELD)
    joints = _joints(drawn, size)
    return [*movers, *(_mover(axes, joint[None], _JOINT) for joint in joints)]


def _joints(drawn: Drawn, size: float) -> list[Plane]:
    """Return the positions x + iy (k,) of each joint."""
    ends = meeting_ends(drawn.rigid, drawn.moved, size)
    return [drawn.moved[name][end] for name, end in ends]


def meeting_ends(
    rigid: Mapping[str, Plane], moved: Mapping[str, Plane], size: float
) -> list[tuple[str, int]]:
    """Return one pair per joint: the name of a line and the index (0 or -1) of its end at the joint. A joint
    is a point at which the ends of two moving lines coincide in all frames. `size` is the size of the
    mechanism."""
    open_lines = [name for name, line in rigid.items() if not is_closed(line, size)]
    ends = [(name, end) for name in open_lines for end in (0, -1)]
    meeting = []
    for number, (name, end) in enumerate(ends):
        others = [rigid[other][at] for other, at in ends[number + 1 :] if other != name]
        meets = any(np.abs(rigid[name][end] - other).max() < _SAME * size for other in others)
        if meets and not is_still(moved[name][end][None], size):
            meeting.append((name, end))
    return meeting


def is_still(line: Plane, size: float) -> bool:
    """Return whether a line has the same position in all frames."""
    return bool(np.abs(line - line[:, :1]).max() < _SAME * size)


def is_closed(line: Plane, size: float) -> bool:
    """Return whether a line ends where it begins."""
    return bool(np.abs(line[0] - line[-1]).max() < _SAME * size)


def _panel(axes: Axes, drawn: Drawn, panel: Panel) -> list[Mover]:
    """Draw a quantity versus phase, with a mark at the phase of the frame."""
    from matplotlib.ticker import MultipleLocator

    factor, unit = prefixed(drawn.system.labels.units.get(panel.name, ""), float(np.abs(panel.curve).max()))
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.plot(np.degrees(drawn.fine), factor * panel.curve, color=BLUE)
    axes.set_xlim(0.0, math.degrees(drawn.fine[-1]))
    axes.set_ylabel(labelled(panel.name, unit))
    axes.margins(y=0.1)
    axes.xaxis.set_major_locator(MultipleLocator(math.degrees(drawn.fine[-1]) / 4))
    if axes.get_subplotspec().is_last_row():  # type: ignore[union-attr]
        axes.set_xlabel("phase φ (°)")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high)
    x = np.degrees(drawn.phase)
    return [
        _mover(axes, np.stack((x + 1j * low, x + 1j * high)), _MARK),
        _mover(axes, (x + 1j * factor * panel.values)[None], _DOT),
    ]


def _mover(axes: Axes, points: Plane, style: Mapping) -> Mover:
    (artist,) = axes.plot(points[:, 0].real, points[:, 0].imag, **style)
    return Mover(artist, points)


def _frame(drawn: Drawn) -> tuple[complex, complex]:
    """Return the lower left and the upper right corner of the area that contains all frames."""
    lines = (*drawn.rigid.values(), *drawn.moved.values())
    return frame_of(np.concatenate([line.ravel() for line in lines]))


def _framed(axes: Axes, low: complex, high: complex, unit: str) -> None:
    from matplotlib.ticker import MaxNLocator

    factor, shown = prefixed(unit, max(map(abs, (low, high))))
    axes.set(xlim=(low.real, high.real), ylim=(low.imag, high.imag), aspect="equal")
    for axis, set_label, name in ((axes.xaxis, axes.set_xlabel, "x"), (axes.yaxis, axes.set_ylabel, "y")):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_major_formatter(lambda value, _: f"{value * factor:.6g}".replace("-", "−"))
        set_label(f"{name} ({shown})" if shown else name)
    axes.grid(color=LIGHT, linewidth=0.4)


def _caption(figure: Figure, drawn: Drawn) -> None:
    lines = filter(None, (drawn.caption, drawn.doubt))
    figure.supxlabel("\n".join(lines), fontsize=8.5, color=VERMILION if drawn.doubt else GREY)


_SCRIPT = Path(__file__).with_name("moving_page.js")
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
    """Return an HTML page with an animation and the warnings below it."""
    animated = scene(drawn)
    picture, parts = _picture(animated)
    data = {"labels": animated.labels, "parts": parts}
    doubts = "".join(f"<li>{escape(warning)}</li>\n" for warning in warnings)
    doubts = f"<h2>Warnings</h2>\n<ul>{doubts}</ul>\n" if doubts else ""
    body = f"""<main>
<figure role="img" aria-label="{escape(drawn.title)}">{picture}</figure>
<div class="controls"><button id="play" type="button">Pause</button>
<input id="frame" type="range" min="0" max="{len(animated.labels) - 1}" value="0" aria-label="phase"></div>
{doubts}</main>
<script>
const data = {json.dumps(data, ensure_ascii=False, separators=(",", ":"))};
{_SCRIPT.read_text("utf-8")}</script>
"""
    return document(drawn.title, _POLICY, _STYLE, body)


def _picture(scene: Scene) -> tuple[str, list[dict]]:
    """Return an SVG picture with its moving lines and, for each moving line, an attribute and the value of
    this attribute in each frame."""
    figure = scene.figure
    with styled():
        # The unit of SVG pictures by matplotlib is 1/72 inch.
        figure.set_dpi(72)
        figure.canvas.draw()
    figure.set_layout_engine("none")
    height = figure.bbox.height
    x, y = scene.label.get_transform().transform(scene.label.get_position())
    for artist in (*(mover.artist for mover in scene.movers), scene.label):
        artist.set_visible(False)
    texts, parts = [], []
    for mover in sorted(scene.movers, key=lambda mover: mover.artist.get_zorder()):
        text, moved = _part(mover.artist, _on_paper(mover.artist, mover.points, height))
        texts.append(text)
        parts.append(moved)
    size = scene.label.get_fontsize()
    place = f'x="{x:.1f}" y="{height - y + size:.1f}"'
    label = f'<text id="label" {place} font-size="{size}" font-family="sans-serif"/>'
    return svg_of(figure).replace("</svg>", "".join([*texts, label, "</svg>"])), parts


def _on_paper(artist, points: Plane, height: float) -> Plane:
    """Return points x + iy in the units of the picture, with y pointing downwards."""
    pairs = np.stack((points.real, points.imag), axis=-1).reshape(-1, 2)
    x, y = artist.axes.transData.transform(pairs).T
    return (x + 1j * (height - y)).reshape(points.shape)


def _part(artist, line: Plane) -> tuple[str, dict]:
    """Return the SVG path of a line, and its motion: transformations if the line moves rigidly, otherwise the
    path in each frame."""
    width = artist.get_linewidth() if artist.get_linestyle() != "None" else artist.get_markersize()
    style = f'class="mover" stroke="{artist.get_color()}" stroke-width="{width}"'
    first = line[:, 0]
    middle = first.mean()
    arms, size = first - middle, np.abs(first - middle).max()
    means = line.mean(axis=0)
    turns = np.ones(line.shape[1], dtype=complex)
    if size > 0:
        turns = (arms.conj()[:, None] * (line - means)).sum(axis=0) / (np.abs(arms) ** 2).sum()
    error = np.abs(line - means - turns * arms[:, None]).max() + size * np.abs(np.abs(turns) - 1).max()
    if error <= _SAME * max(size, 1.0):
        moves = [
            f"matrix({b.real:.5g} {b.imag:.5g} {-b.imag:.5g} {b.real:.5g} {a.real:.2f} {a.imag:.2f})"
            for a, b in zip(means, turns, strict=True)
        ]
        return f'<path {style} d="{_path(arms)}"/>', {"name": "transform", "values": moves}
    return f"<path {style}/>", {"name": "d", "values": [_path(points) for points in line.T]}


def _path(points: Plane) -> str:
    """Return the SVG path through points. A single point is drawn as a dot."""
    numbers = [f"{place.real:.2f} {place.imag:.2f}" for place in points]
    return f"M{numbers[0]}" + ("L" + " ".join(numbers[1:]) if len(numbers) > 1 else "h0")
