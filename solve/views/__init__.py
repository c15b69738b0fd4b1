"""Displays of results: tables, figures, HTML, reports and animations. Only these modules use Matplotlib and
HTML."""

from solve.views.show import as_html, as_text, figure, waterfall
from solve.views.style import Figure

__all__ = ["Figure", "as_html", "as_text", "figure", "waterfall"]
