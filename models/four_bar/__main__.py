"""Commands of the four-bar linkage: `python -m models.four_bar COMMAND`."""

from solve.commands.app import Program

_COMMANDS = {
    "linkage": "Rigid motion: class, transmission angle, mechanical advantage, coupler curves, joint forces.",
    "elements": "Natural frequencies over a revolution by element type, compared with exact frequencies.",
    "study": "Stress, deflection or energy versus speed for several values of a parameter or option.",
    "corrected": "One element per link with corrected dynamic stiffness, compared with more elements.",
    "modes": "Contribution of each mode to a deflection or stress over one revolution.",
    "curve": "Path of a coupler point, compared with that of the rigid linkage.",
    "design": "Design for high speed: limiting critical speeds, quiet bands, "
    "run-up with a moving ground pivot.",
}
PROGRAM = Program(
    "python -m models.four_bar",
    "models.four_bar.studies",
    _COMMANDS,
    "Studies of the four-bar linkage of the thesis.",
    'linkage --speed "300 rpm" --coupler-point 0.164,0.1 --plot linkage.png',
    {"elements": "modes"},
)
run, commands, main = PROGRAM.run, PROGRAM.commands, PROGRAM.main

if __name__ == "__main__":
    main()
