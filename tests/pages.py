"""Documentation pages: README and docs, with their links, anchors and entries in the site."""

import re
import unicodedata
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
TOP = [ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING")]
EVERY = [*TOP, *sorted(DOCS.glob("**/*.md"))]
_CODE = re.compile(r"^(`{3,}).*?^\1$", flags=re.DOTALL | re.MULTILINE)
_INCLUDED = re.compile(r"```\{include\} (\S+)\n")


class Link(NamedTuple):
    """Relative link of a page: the file and the anchor in it."""

    page: Path
    target: Path
    anchor: str


def links(page: Path) -> list[Link]:
    """Return the relative links of a page, including pictures. Links to other sites are omitted."""
    prose = re.sub(r"`[^`\n]+`", "", _CODE.sub("", page.read_text(encoding="utf-8")))
    found = []
    for address in re.findall(r"\]\(([^)\s]+)\)", prose):
        if not re.match(r"\w+:", address):
            path, _, anchor = address.partition("#")
            found.append(Link(page, (page.parent / path).resolve() if path else page, anchor))
    return found


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings, as repository viewers and MyST generate them."""
    text = _CODE.sub("", page.read_text(encoding="utf-8"))
    return {_slug(title) for title in re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)}


def _slug(title: str) -> str:
    words = re.sub(r"\[([^]]*)\]\([^)]*\)|[`*]", r"\1", title).strip().lower()
    kept = (word for word in words if word in " -_" or unicodedata.category(word)[0] in "LN")
    return "".join(kept).replace(" ", "-")


def of_the_site() -> set[Path]:
    """Return the pages in the table of contents of the site, the front page and included pages."""
    index = DOCS / "index.md"
    found = {index}
    for body in re.findall(r"```\{toctree\}\n(.*?)```", index.read_text(encoding="utf-8"), flags=re.DOTALL):
        names = [line for line in body.splitlines() if line and not line.startswith(":")]
        found |= {DOCS / f"{name}{ending}" for name in names for ending in (".md", ".ipynb")}
    pages = {page for page in found if page.suffix == ".md" and page.exists()}
    included = {
        (page.parent / name).resolve()
        for page in pages
        for name in _INCLUDED.findall(page.read_text("utf-8"))
    }
    return found | included
