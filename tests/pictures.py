"""`python -m tests.pictures [NAME …]`: renew the pictures of the pages by the commands beside them.

A picture's command is the line of its page that draws a file of its name, `--plot NAME` or `--out NAME`, or
that writes an HTML page of its name, whose beginning Chromium shows, or a block of Python with
`savefig("NAME")`.
"""

import re
import shlex
import sys
from pathlib import Path
from typing import NamedTuple

from tests import browser

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


class Picture(NamedTuple):
    """A picture of a page, and what draws it: the words of a command, as they stand there."""

    page: Path
    file: Path
    command: str


def pictures() -> list[Picture]:
    """Of all pages. Raises LookupError for one that no command of its page draws."""
    return [
        Picture(page, (page.parent / name).resolve(), _command(page, Path(name).name))
        for page in PAGES
        for name in re.findall(r"!\[[^\]]*\]\(([^)]+\.png)\)", page.read_text(encoding="utf-8"))
    ]


def _command(page: Path, name: str) -> str:
    text = page.read_text(encoding="utf-8")
    lines = re.findall(r"python -m (?:solve|models)\b[^`\n]*", text)
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    for command in lines + blocks:
        page_of = f"--out {Path(name).with_suffix('.html')}"
        ways = f"--plot {name}", f"--out {name}", page_of, f'savefig("{name}"'
        if any(way in command for way in ways):
            return command
    raise LookupError(f"no command of {page.name} draws {name}")


def renew(picture: Picture) -> None:
    """Draw it where the page shows it. Raises RuntimeError where its command fails."""
    from models.coupler.__main__ import run as coupler
    from models.four_bar.__main__ import run as four_bar
    from models.portal_frame.__main__ import run as portal_frame
    from solve.commands.app import run as solve

    if "savefig(" in picture.command:
        exec(picture.command.replace(picture.file.name, str(picture.file)), {})
        return
    words = shlex.split(re.sub(r"--save \S+", "", picture.command))
    flag = "--out" if "--out" in words else "--plot"
    at = words.index(flag) + 1
    file = picture.file.with_suffix(Path(words[at]).suffix)
    words[at] = str(file)
    runs = {"solve": solve, "coupler": coupler, "four_bar": four_bar, "portal_frame": portal_frame}
    if runs[words[2].removeprefix("models.")](words[3:]) != 0:
        raise RuntimeError(f"{picture.command}: failed")
    if file != picture.file:
        browser.run(file, f"--screenshot={picture.file}", "--hide-scrollbars", "--window-size=960,1800")
        file.unlink()


def main() -> None:
    """Renew those whose name holds one of the arguments, by default all."""
    for picture in pictures():
        if any(name in picture.file.name for name in sys.argv[1:] or [""]):
            print(f"{picture.file.name}: {picture.command}", file=sys.stderr, flush=True)
            renew(picture)


if __name__ == "__main__":
    main()
