"""The command of the flexible coupler: `python -m models.coupler`."""

from collections.abc import Callable, Sequence

from solve.commands.program import Program


def _listed() -> Sequence[Callable[..., None]]:
    from models.coupler.command import picture

    return (picture,)


PROGRAM = Program("python -m models.coupler", _listed, None, '--speed "600 rpm" --plot bent.png')
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
