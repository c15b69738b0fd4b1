"""Treat docstrings as plain text, in which only words in backquotes are markup: they are code.

References to public types of `solve` or `derive` are linked to the entries of these types.
"""

import builtins
import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

import derive
import derive.errors
import solve
import solve.errors


def _plain(app: Sphinx, kind: str, name: str, about: Any, options: Any, lines: list[str]) -> None:
    """Escape characters that are markup in reStructuredText, as in |ρ|, and link the names of exceptions.
    Code in backquotes and examples remain unchanged."""
    module = derive.errors if name.startswith("derive.") else solve.errors
    for number, line in enumerate(lines):
        if line.lstrip().startswith((">>> ", "... ")):
            continue
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [_escaped(part, module) for part in parts[::2]]
        lines[number] = "".join(parts)


def _escaped(text: str, errors: Any) -> str:
    def entry(word: re.Match[str]) -> str:
        known = hasattr(builtins, word[0])
        return word[0] if known else f":py:exc:`~{errors.__name__}.{word[0]}`"

    return re.sub(r"\b\w+Error\b", entry, re.sub(r"([|*\\]|_\b)", r"\\\1", text))


def _short(app: Sphinx, kind: str, name: str, about: Any, options: Any, shown: str, returned: str) -> Any:
    """Shorten types in signatures to their last names, and NumPy arrays to `ndarray`."""
    array = r"ndarray\[tuple\[[^]]*\], dtype\[[^]]*\]\]"
    return tuple(
        text and re.sub(array, "ndarray", re.sub(r"~[\w.]+\.", "", text)) for text in (shown, returned)
    )


def _skipped(app: Sphinx, kind: str, name: str, about: Any, skip: bool, options: Any) -> bool | None:
    """Skip fields of named tuples without a docstring of their own."""
    return True if str(about.__doc__).startswith("Alias for field number") else None


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
    app.connect("autodoc-process-signature", _short)
    app.connect("autodoc-skip-member", _skipped)
    app.connect("missing-reference", _offered)
    return {"parallel_read_safe": True}
