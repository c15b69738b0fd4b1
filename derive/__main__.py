"""The command `derive`: generate, check or show a mechanism's equations."""

from collections.abc import Sequence

from derive.errors import DeriveError
from solve.terminal import command_line


def main() -> None:
    """Entry point of the console command."""
    command_line.main("derive", _run, DeriveError)


def _run(arguments: Sequence[str]) -> int | None:
    # Imported here, where an interruption during the import is handled.
    from derive.command import run

    return run(arguments)


if __name__ == "__main__":
    main()
