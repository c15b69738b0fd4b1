"""Docstrings are plain text: words in backquotes are code, nothing else is markup. Types that `solve` or `derive`
offer lead to their entries, whatever file they stand in."""

import re
from typing import Any

import derive
import solve
from docutils import nodes
from sphinx.application import Sphinx


def _plain(app: Sphinx, kind: str, name: str, about: Any, options: Any, lines: list[str]) -> None:
    """Letters that reStructuredText takes for markup, as |ρ|, are themselves outside of backquotes."""
    for number, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [re.sub(r"([|*\\]|_\b)", r"\\\1", part) for part in parts[::2]]
        lines[number] = "".join(parts)


def _offered(app: Sphinx, env: Any, node: Any, contents: nodes.Node) -> nodes.Node | None:
    name = str(node.get("reftarget", "")).rpartition(".")[2]
    for package in (solve, derive):
        if node.get("refdomain") == "py" and name in package.__all__:
            domain = env.get_domain("py")
            target = f"{package.__name__}.{name}"
            return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", target, node, contents)
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", _plain)
    app.connect("missing-reference", _offered)
    return {"parallel_read_safe": True}
