"""The command `solve`: periodic vibration, stability and studies of a model."""

from collections.abc import Sequence

from solve.commands.door import enter
from solve.errors import SolveError


def main() -> None:
    """Entry point of the console command."""
    enter("solve", _run, SolveError)


def _run(arguments: Sequence[str]) -> int | None:
    # Loaded within: an interruption may come while Python still reads the packages.
    from solve.commands.app import called

    return called(arguments)


if __name__ == "__main__":
    main()
