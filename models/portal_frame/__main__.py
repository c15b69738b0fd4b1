"""The command of the portal frame: `python -m models.portal_frame`."""

from collections.abc import Callable, Sequence

from solve.commands.program import Program


def _listed() -> Sequence[Callable[..., None]]:
    from models.portal_frame.command import determinant

    return (determinant,)


PROGRAM = Program("python -m models.portal_frame", _listed, None, "--plot determinant.png")
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
