"""Command of the portal frame: `python -m models.portal_frame`."""

from solve.commands.app import Program

PROGRAM = Program(
    "python -m models.portal_frame", "models.portal_frame", {"command": ""}, None, "--plot determinant.png"
)
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
