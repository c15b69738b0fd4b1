"""`python -m models.four_bar elements`: frequencies by several kinds of elements (thesis Figs. 4.6, 5.3)."""

from typing import Annotated

from models.four_bar.commands.groups import FourBar
from models.four_bar.results.element_kinds import element_kinds
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results

_KINDS = "cubic:1,cubic:2,cubic:3,internal:1,curvature:1,dynamic:1"


def elements(
    four_bar: FourBar,
    results: Results,
    kinds: Annotated[str, Flag("Kinds of elements and how many a link.", "KIND:N,…")] = _KINDS,
    count: Annotated[int, Flag("Frequencies, from the lowest: up to 9.", "N")] = 4,
    turn: Annotated[int, Flag("Crank positions, evenly over the turn.", "N")] = 36,
) -> None:
    """Natural frequencies over a turn by several kinds of elements, beside the exact ones."""
    result = element_kinds(four_bar.loaded(), kinds.split(","), count, turn)
    deliver_result(results, result, four_bar.choices)
