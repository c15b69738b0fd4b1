"""`python -m tests.solve.views.live.record` writes docs/live.gif, an animation of the live window."""

import io
from pathlib import Path

from PIL import Image

import solve
from tests import devtools
from tests.pages import DOCS

FILE = DOCS / "live.gif"
_WIDTH, _HEIGHT, _SHOWN = 1180, 800, 800
_FRAME_MS = 160
_PLACES = [*range(330, 850, 40), *range(850, 330, -40)]
"""Places of the slider of the speed, from 0 to 1000."""


def record(file: Path = FILE) -> None:
    """Write an animation of the window while a slider moves."""
    live, images = solve.explore("cam", "300 rpm"), []
    slider = "document.querySelector('[data-name=speed] input[type=range]')"
    try:
        with devtools.browser() as running:
            tab = running.open(live.address, _WIDTH, _HEIGHT)
            tab.wait("document.documentElement.dataset.detailed")
            for place in _PLACES:
                before = tab.evaluate("document.documentElement.dataset.detailed")
                tab.evaluate(f"{slider}.value = {place}; {slider}.dispatchEvent(new Event('input'))")
                tab.wait(f"document.documentElement.dataset.detailed !== '{before}'")
                images.append(Image.open(io.BytesIO(tab.picture())).convert("RGB"))
    finally:
        live.close()
    size = _SHOWN, round(_SHOWN * _HEIGHT / _WIDTH)
    small = [image.resize(size, Image.Resampling.LANCZOS) for image in images]
    # Rare colours, of verdict, warnings and cursor, are kept.
    palette = small[0].quantize(colors=64, method=Image.Quantize.MAXCOVERAGE)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in small]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=_FRAME_MS, loop=0, optimize=True)


if __name__ == "__main__":
    record()
