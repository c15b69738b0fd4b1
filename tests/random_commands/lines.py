"""Random command lines with the flags that each command lists in its help."""

import importlib
import random
from functools import cache
from pathlib import Path
from typing import Any

from typer.main import get_command

from derive.command import app
from solve.commands.app import SOLVE
from tests.random_commands.values import LINEAR, MECHANISMS, ODD, VALUES

MODELS = [
    f"models.{each.parent.name}"
    for each in sorted((Path(__file__).parents[2] / "models").glob("*/__main__.py"))
]
"""Those with commands of their own."""

CHEAP = {
    **dict.fromkeys(
        ("periodic", "floquet", "sensitivity", "validity", "fit", "transient", "animate"),
        (("--rtol", "1e-3"),),
    ),
    **dict.fromkeys(("sweep", "bands", "branch", "chart", "critical", "report"), (("--rtol", "1e-2"),)),
    "compare": (("--method", "rk4"), ("--steps", "64"), ("--rtol", "1e-2")),
    "tolerances": (("--samples", "64"), ("--index-samples", "4"), ("--rtol", "1e-2")),
}
NEEDED = {
    **dict.fromkeys(("periodic", "floquet", "sensitivity"), (("--speed", "30 rad/s"),)),
    "bands": (("--speeds", "1:1.2:3 rad/s"),),
    "sweep": (("--speeds", "30 40 rad/s"),),
    "branch": (("--speeds", "30:31 rad/s"), ("--points", "3")),
    "validity": (("--speeds", "30 40 rad/s"),),
    "critical": (("--speeds", "30:31:2 rad/s"),),
    "compare": (("--speed", "1 rad/s"),),
    "report": (("--speed", "30 rad/s"), ("--speeds", "30:31:2 rad/s"), ("--out", "a.html")),
    "animate": (("--speed", "30 rad/s"), ("--frames", "3"), ("--out", "a.gif")),
    "export": (("--speed", "30 rad/s"), ("--out", "a.mat")),
    "chart": (("--x", "delta=0.5:1.5:3"), ("--y", "epsilon=0.1:0.5:3")),
    "transient": (("--speed", "30 rad/s"), ("--turns", "3")),
    "tolerances": (("--speed", "30 rad/s"), ("--vary", "k1=±2 %")),
    "fit": (("--speed", "30 rad/s"), ("--data", "measured.csv"), ("--free", "k1")),
    "design": (("--time", "0.5 s"), ("--speeds", "10:20:3 rad/s"), ("--L4", "0.5:0.6:2 m")),
}
"""What a command needs, or is quick with, unless the line has it already."""


ENDLESS = {"explore"}
"""Commands that serve until they are interrupted."""


@cache
def flags() -> dict[tuple[str, ...], dict[str, bool]]:
    """Return a mapping from program and command to its flags, as listed in the help; each flag maps to
    whether it has a value."""
    found: dict[tuple[str, ...], dict[str, bool]] = {("derive",): _flags_of(get_command(app))}
    models = {program: importlib.import_module(f"{program}.__main__").PROGRAM for program in MODELS}
    for words, program in {"solve": SOLVE, **models}.items():
        for name in (name for name in program.listed if name not in ENDLESS):
            names = [name] if len(program.listed) > 1 else None
            found |= _flags_in(words, get_command(program.commands(name)), names)
    return found


def _flags_in(
    program: str, command: Any, names: list[str] | None = None
) -> dict[tuple[str, ...], dict[str, bool]]:
    """Return the flags of the given or of all commands of a program. The only command of a program has no
    name."""
    if not hasattr(command, "commands"):
        return {(program,): _flags_of(command)}
    return {(program, name): _flags_of(command.commands[name]) for name in names or command.commands}


def _flags_of(command: Any) -> dict[str, bool]:
    options = [each for each in command.params if each.param_type_name == "option"]
    return {"-h": False, **{each.opts[0]: not each.is_flag for each in options}}


def line(chance: random.Random) -> tuple[str, list[str]]:
    """Return a program and its arguments."""
    program = chance.choices(("solve", "derive", "models"), (12, 3, 4))[0]
    if program == "derive":
        models = chance.choices((*MECHANISMS, "cam", "mathieu", *ODD), k=chance.choice((0, 1, 1, 1, 2)))
        return program, [*models, *_given(chance, flags()[program,], 2)]
    known = flags()
    words = chance.choice([each for each in known if each[0].startswith(program)])
    program, *command = words
    given = _given(chance, known[words], chance.choice((0, 1, 1, 2, 3)))
    if not command:
        return program, ["--plot", chance.choice(VALUES["--plot"]), *given]
    (name,) = command
    if chance.random() < 0.02:
        return program, [chance.choice(ODD), *given]
    model = _model(chance, name) if program == "solve" else []
    for flag, value in (*CHEAP.get(name, ()), *NEEDED.get(name, ())):
        if flag in known[words] and flag not in given and chance.random() < 0.95:
            model += [flag, value]
    return program, [name, *model, *given]


def _model(chance: random.Random, command: str) -> list[str]:
    if command == "chart" and chance.random() < 0.9:
        return ["mathieu"]
    weights = (3, 3, 3, 6, 3, *[1] * (len(LINEAR) - 2))
    return chance.choices((*LINEAR, "spring.py", "nothing.py", chance.choice(ODD)), weights)


def _given(chance: random.Random, known: dict[str, bool], count: int) -> list[str]:
    words = []
    for flag in chance.choices(sorted(known), k=count):
        words.append(flag)
        if known[flag]:
            words.append(chance.choice(ODD if chance.random() < 0.35 else VALUES[flag]))
    return words
