"""All cases of docs/wall.md and their tables."""

import math
from itertools import groupby

from tests.foreign import control, hill_equations, initial_values, rotors, three_bodies
from tests.foreign.wall import Case

CASES: list[Case] = [
    case
    for module in (initial_values, rotors, three_bodies, control, hill_equations)
    for case in module.CASES
]


def row(case: Case, computed: float) -> list[str]:
    """Return the cells of a case, with the computed value to the decimals that its tolerance allows."""
    decimals = max(0, math.ceil(-math.log10(case.tolerance)))
    return [case.what, case.printed, f"{round(computed, decimals) + 0.0:.{decimals}f}", case.place]


def tables() -> str:
    """Return one table per source, as in docs/wall.md."""
    text = []
    for source, cases in groupby(CASES, key=lambda case: case.source):
        text.append(f"**{source.author}, {source.title}, {source.year}** ({source.where})\n")
        text.append("| what | printed | here | place |\n|---|---|---|---|")
        text += [f"| {' | '.join(row(case, case.computed()))} |" for case in cases]
        text.append("")
    return "\n".join(text)
