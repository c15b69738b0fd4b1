"""`python -m tests.pictures [NAME …]`: renew the figures of the pages with the commands printed next to them.

The command of a figure is the line of its page that writes a file of this name: with `--plot NAME`, with
`--out NAME`, or as an HTML page, the top of which Chromium shows. Otherwise it is Python code with
`savefig("NAME")`, either a script next to the figure or a code block of the page.
"""

import re
import shlex
import sys
import tempfile
from contextlib import chdir
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image

from tests import browser
from tests.pages import EVERY, ROOT


class Picture(NamedTuple):
    """Figure of a page with the arguments of the command that draws it, as printed on the page."""

    page: Path
    file: Path
    command: str


def pictures() -> list[Picture]:
    """Return the figures of all pages. Raises LookupError if no command on its page draws a figure."""
    return [
        Picture(page, (page.parent / name).resolve(), _command(page, name))
        for page in EVERY
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+\.png)\)", page.read_text(encoding="utf-8"))
    ]


def _command(page: Path, place: str) -> str:
    script, name = (page.parent / place).with_suffix(".py"), Path(place).name
    if script.is_file():
        return script.read_text(encoding="utf-8")
    text = page.read_text(encoding="utf-8")
    lines = re.findall(r"python -m (?:solve|models)\b[^`\n]*", text)
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    for command in lines + blocks:
        page_of = f"--out {Path(name).with_suffix('.html')}"
        ways = f"--plot {name}", f"--out {name}", page_of, f'savefig("{name}"'
        if any(way in command for way in ways):
            return command
    raise LookupError(f"no command of {page.name} draws {name}")


def run_script(picture: Picture) -> dict[str, Any]:
    """Draw the figure with its Python code and return the variables of the code as a mapping from their
    names."""
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        exec(picture.command.replace(f'"{picture.file.name}"', f'"{picture.file.as_posix()}"'), names)
    return names


def run_command(picture: Picture, *flags: str) -> None:
    """Draw the figure with its command and additional flags. Raises RuntimeError if the command fails."""
    from models.coupler.__main__ import run as coupler
    from models.four_bar.__main__ import run as four_bar
    from models.portal_frame.__main__ import run as portal_frame
    from solve.commands.app import run as solve

    words = shlex.split(re.sub(r"--save \S+", "", picture.command))
    flag = "--out" if "--out" in words else "--plot"
    at = words.index(flag) + 1
    file = picture.file.with_suffix(Path(words[at]).suffix)
    words[at] = str(file)
    runs = {"solve": solve, "coupler": coupler, "four_bar": four_bar, "portal_frame": portal_frame}
    if runs[words[2].removeprefix("models.")]([*words[3:], *flags]) != 0:
        raise RuntimeError(f"{picture.command}: failed")
    if file != picture.file:
        browser.run(file, f"--screenshot={picture.file}", "--hide-scrollbars", "--window-size=960,1800")
        file.unlink()


def renew(picture: Picture) -> None:
    """Write the figure at its place in the page with 256 colours. Raises RuntimeError if its command
    fails."""
    run_script(picture) if "savefig(" in picture.command else run_command(picture)
    with Image.open(picture.file) as drawn:
        few = drawn.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    few.save(picture.file, optimize=True)


def main() -> None:
    """Renew the figures whose names contain one of the arguments; by default, all."""
    for picture in pictures():
        place = picture.file.relative_to(ROOT).as_posix()
        if any(name in place for name in sys.argv[1:] or [""]):
            print(f"{place}: {picture.command.splitlines()[0]}", file=sys.stderr, flush=True)
            renew(picture)


if __name__ == "__main__":
    main()
