"""Command of the flexible coupler: `python -m models.coupler`."""

from solve.commands.app import Program

PROGRAM = Program(
    "python -m models.coupler", "models.coupler", {"command": ""}, None, '--speed "600 rpm" --plot bent.png'
)
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
