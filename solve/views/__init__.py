"""Displays of results: tables, figures, HTML, reports and animations. Only these modules use Matplotlib and
HTML."""

from solve.views import branches as branches
from solve.views import chart as chart
from solve.views import comparison as comparison
from solve.views import controller as controller
from solve.views import critical_speeds as critical_speeds
from solve.views import fit as fit
from solve.views import followed_modes as followed_modes
from solve.views import frequencies as frequencies
from solve.views import optimum as optimum
from solve.views import orbit as orbit
from solve.views import over_time as over_time
from solve.views import tolerances as tolerances
from solve.views.show import as_html, as_text, figure
from solve.views.style import Figure
from solve.views.sweep import waterfall_figure

__all__ = ["Figure", "as_html", "as_text", "figure", "waterfall_figure"]
