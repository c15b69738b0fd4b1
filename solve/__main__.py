"""The command `solve`: periodic vibration, stability and studies of a model."""

from solve.commands.app import SOLVE

main = SOLVE.main

if __name__ == "__main__":
    main()
