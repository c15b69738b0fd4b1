"""Style of figures: sizes and colours for a printed page. The global state of pyplot is not used."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from solve.results.files import write_atomic
from solve.results.formatting import greek

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure
else:
    # For annotations only: matplotlib is imported when something is drawn.
    Artist = Axes = Figure = SubFigure = object

# Palette of Okabe and Ito, whose colours colour-blind readers can distinguish; dark colours come first.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
BLACK, GREY, LIGHT = "#222222", "#666666", "#DDDDDD"
MANY = BLUE, VERMILION, GREEN, PURPLE, BLACK, ORANGE, SKY, "#7A4B00", "#5B2A86", GREY, "#8A8D00", "#B00060"

PAGE_WIDTH = 7.2
"""Width of figures in inches, which spans two columns of a journal."""

_STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "figure.titlesize": 10,
    "axes.linewidth": 0.7,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LIGHT,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "legend.frameon": False,
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": BLACK,
    "ytick.labelcolor": BLACK,
    "text.color": BLACK,
    "axes.labelcolor": BLACK,
    "mathtext.fontset": "dejavusans",
    "axes.formatter.limits": (-3, 4),
    "svg.hashsalt": "parametric-vibration",
}


@contextmanager
def styled() -> Iterator[None]:
    """Context manager in which figures are created and drawn in the style of this program."""
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(height: float) -> Figure:
    """Return an empty figure of page width, with a layout that avoids overlaps."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(PAGE_WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@contextmanager
def page(height: float, title: str) -> Iterator[Figure]:
    """Context manager that provides a new figure with a title, `height` inches high, in the style of this
    program. A "$" is shown unchanged, because texts may come from a user."""
    with styled():
        figure = new_figure(height)
        figure.suptitle(greek(title), fontweight="bold")
        yield figure
        _without_mathematics(figure)


def _without_mathematics(artist: Artist) -> None:
    """Switch off mathematical text for an artist and its children, except for powers of ten at ticks."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text
    from matplotlib.ticker import FixedFormatter

    if isinstance(artist, Text):
        artist.set_parse_math(False)
    if isinstance(artist, Axis) and not isinstance(artist.get_major_formatter(), FixedFormatter):
        artist.label.set_parse_math(False)
        return
    for child in artist.get_children():
        _without_mathematics(child)


def save_figure(figure: Figure, file: Path) -> None:
    """Write the figure in the format of the file's ending. The bytes are reproducible. Raises FileError."""
    write_atomic(file, drawn(figure, file))


def drawn(figure: Figure, file: Path) -> Callable[[BinaryIO], None]:
    """Return a function that writes the figure to a stream, in the format that the file's ending states."""
    metadata = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(file.suffix.lower(), {})
    kind = file.suffix.lower().removeprefix(".")

    def draw(stream: BinaryIO) -> None:
        with styled():
            figure.savefig(stream, format=kind, dpi=200, metadata=metadata)

    return draw
