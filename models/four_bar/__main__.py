"""The commands of the four-bar linkage: `python -m models.four_bar COMMAND`."""

from collections.abc import Callable, Sequence

from solve.commands.program import Program


def _listed() -> Sequence[Callable[..., None]]:
    from models.four_bar.commands.corrected import corrected
    from models.four_bar.commands.curve import curve
    from models.four_bar.commands.design import design
    from models.four_bar.commands.elements import elements
    from models.four_bar.commands.linkage import linkage
    from models.four_bar.commands.modes import modes
    from models.four_bar.commands.study import study

    return linkage, elements, study, corrected, modes, curve, design


PROGRAM = Program(
    "python -m models.four_bar",
    _listed,
    "The four-bar linkage of the thesis.",
    'linkage --speed "300 rpm" --coupler-point 0.164,0.1 --plot linkage.png',
)
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
