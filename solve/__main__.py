"""The command `solve`: periodic vibration, stability and studies of a model."""

import sys

from solve.commands.app import run


def main() -> None:
    """Entry point of the console command."""
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
