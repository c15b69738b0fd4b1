"""Equations of the pages as MathML, which browsers draw without a script or a network."""

from typing import Any

from latex2mathml.converter import convert
from sphinx.application import Sphinx


def _inline(translator: Any, node: Any) -> None:
    translator.body.append(convert(node.astext()))


def _block(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')


def _depart(translator: Any, node: Any) -> None:
    """What a node is, its beginning has written."""


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (_inline, _depart), (_block, _depart))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
