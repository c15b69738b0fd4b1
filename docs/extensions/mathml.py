"""Convert the equations of the pages to MathML, which browsers display without scripts or a network."""

import re
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml.converter import convert
from sphinx.application import Sphinx

_PRIMED = re.compile(r"<msup>(<mi>[^<]*</mi>)<mi>(&#x0203\d;)</mi></msup>")


def mathml(latex: str, display: str) -> str:
    """Return a LaTeX formula as MathML, with primes as operators: as superscripts they would be too high."""
    return _PRIMED.sub(r'\1<mo lspace="0" rspace="0">\2</mo>', convert(latex, display=display))


def _inline(translator: Any, node: Any) -> None:
    translator.body.append(mathml(node.astext(), "inline"))
    raise SkipNode


def _block(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block")}</div>')
    raise SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
