"""Command lines by chance: flags of each command with values that fit, values that do not, and odd ones."""

import random
from pathlib import Path

LINEAR = ("cam", "manipulator", "gear_pair", "mathieu", "coupler", "four_bar", "portal_frame")

ODD = (
    "",
    " ",
    "-",
    "--",
    "=",
    ":",
    "::",
    "0",
    "-1",
    "1.5",
    "nan",
    "inf",
    "-inf",
    "1e300",
    "1e-300",
    "5e-324",
    "9" * 5000,
    "x" * 300,
    "é漢",
    "\udcff",
    "1:2",
    "1:2:3:4",
    "a=b=c",
    "k1=",
    "=1",
    "(" * 3000,
    "%s%n",
    "$(id)",
    "../../etc/passwd",
    "/dev/full",
    "/",
    "~",
    "cam",
    "None",
    "[]",
    "1e400",
    "0x10",
    "1_000",
    "99999999999999",
    "600 rpm",
    "q1",
    "k1=1:2:3",
    "\t\n",
    "--help=1",
    "L2=0.2:0.6:3",
    "0.1:1:3 rad/s",
    "true",
    "📐",
)

SPEED = (
    "600 rpm",
    "1 rad/s",
    "10 Hz",
    "30 rad/s",
    "1e-300 rpm",
    "1e300 rpm",
    "600 rpm*9**9**9",
    "600 kg",
    "1 rad/s/s",
    "600  rpm",
    "5e-324 rad/s",
    "1e4 rpm",
    "0.01 rpm",
)
SPEEDS = (
    "1:2:3 rad/s",
    "600 700 rpm",
    "30:40:4 rad/s",
    "1 rad/s",
    "2:1:2 rad/s",
    "1:2:100000000 rpm",
    "1 1 rad/s",
    "1e-300:1e300:3 rpm",
    "1:2:1 rpm",
)
SET = (
    "k1=8e4",
    "k1=1e300",
    "k1=5e-324",
    "F=1e308",
    "m2=5e-324",
    "I1=1e-300",
    "L2=0.3",
    "L2=1e300",
    "c1=0",
    "delta=1",
    "epsilon=1e308",
    "zeta=0",
    "z1=1e300",
    "m=1e-320",
    "k1=-1",
    "nope=1",
    "rho=1e300",
    "E=1e308",
    "e=1e300",
    "omega=1e300",
    "zeta=1e300",
    "I1=1e200",
    "k3=1e-308",
    "a1=1e308",
)
OPTION = (
    "load=constant",
    "modes=1",
    "modes=3",
    "modes=99999999",
    "elements=1",
    "elements=1,2,1",
    "elements=9999",
    "terms=full",
    "element=cubic",
    "element=quintic",
    "load=",
    "damping=modal",
    "=x",
)
METHOD = (
    "auto",
    "radau",
    "gauss",
    "newmark",
    "rk4",
    "fourier",
    "hsu",
    "hill",
    "march",
    "modal",
    "bahgat-willmert",
    "RADAU",
    "rk5",
)
NAME = (
    "q1",
    "q2",
    "contact_force",
    "drive_torque",
    "x",
    "error",
    "follower_midpoint_stress_plus",
    "q99",
    "speed",
)
PICTURE = (
    "a.svg",
    "a.png",
    "a.pdf",
    "a.jpeg",
    "none/a.png",
    "folder.png",
    "full.png",
    "y" * 300 + ".png",
    ".png",
)
DATA = (
    "a.csv",
    "a.npz",
    "a.mat",
    "a.nc",
    "a.xlsx",
    "none/a.csv",
    "folder.csv",
    "full.csv",
    "y" * 300 + ".nc",
)
CASES = {
    "good.toml": '[case.1]\nspeed = "600 rpm"\n[case.1.parameters]\n'
    'k1 = { value = 8e4, unit = "N m/rad", source = "s" }\n',
    "deep.toml": "x = " + "[" * 3000 + "]" * 3000,
    "digits.toml": f'[case.1.parameters]\nk1 = {{ value = {"9" * 5000}, unit = "N", source = "s" }}\n',
    "count.toml": '[case.1.parameters]\na = { value = 1, count = 100000000, unit = "m", source = "s" }\n',
    "tower.toml": '[case.1.parameters]\nk1 = { value = 1, unit = "kg**(9**9**9)", source = "s" }\n',
    "empty.toml": "",
    "speed.toml": '[case.1]\nspeed = "600 rpm*9**9**9"\n',
    "large.toml": '[case.1.parameters]\nk1 = { value = 1e308, unit = "kN m/rad", source = "s" }\n',
}
MECHANISMS = {
    "syntax.py": "def mechanism(:",
    "exits.py": "raise SystemExit(3)",
    "interrupts.py": "raise ValueError('x' * 10000)",
    "nothing.py": "def mechanism():\n    return None\n",
    "deep.py": "def mechanism():\n    return " + "-" * 50000 + "1\n",
    "recursive.py": "def mechanism():\n    return mechanism()\n",
    "missing.py": "x = 1\n",
    "bytes.py": "\udcff",
    "spring.py": "from derive import Mechanism, rate, cos\n\n\ndef mechanism():\n"
    '    made = Mechanism("spring", "A mass on a spring")\n    (q,) = made.coordinates(q=("m", "way"))\n'
    '    m, k = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"))\n'
    "    made.kinetic = m * rate(q)**2 / 2\n"
    "    made.potential = k * q**2 / 2 * (2 + cos(made.phase))\n    return made\n",
    "power.py": "from derive import Mechanism, rate\n\n\ndef mechanism():\n"
    '    made = Mechanism("power", "p")\n    (q,) = made.coordinates(q=("m^9999999", "way"))\n'
    "    return made\n",
}

_OF_MODEL = {"--case": ("1", "2", "0", "x"), "--cases": tuple(CASES), "--set": SET, "--option": OPTION}
_RESULTS = {"--plot": PICTURE, "--save": DATA, "--json": None}
_SETTINGS = {"--gamma": ("0.5", "0.25", "2"), "--beta": ("0.25", "0"), "--order": ("5", "4", "99999999")}
_ACCURACY = {"--method": METHOD, "--rtol": ("1e-3", "1e-2", "1e-15", "0.5"), **_SETTINGS}
_EVERY = {"--limit": ("1e7", "1", "1e300", "0"), "--debug": None, "-h": None}
_STEPS = {"--steps": ("16", "64", "200", "0", "1", "99999999999")}
_COUNT = ("1", "3", "0", "100000000", "10")
_RANGE = (
    "delta=0.5:1.5:3",
    "k1=7e4:9e4:3",
    "speed=1:2:3 rad/s",
    "L2=0.2:0.3:2",
    "delta=0:1:100000000",
    "epsilon=0:1:3",
    "k1=1e300:1e308:3",
)
_MODEL = {**_OF_MODEL, **_RESULTS, **_EVERY}

SOLVE = {
    "periodic": {
        **_MODEL,
        **_ACCURACY,
        **_STEPS,
        "--speed": SPEED,
        "--harmonics": _COUNT,
        "--show": NAME,
        "--quasi-static": None,
        "--scale": ("dB", "linear"),
        "--all-multipliers": None,
    },
    "floquet": {**_MODEL, **_ACCURACY, **_STEPS, "--speed": SPEED, "--all-multipliers": None},
    "sweep": {
        **_MODEL,
        **_ACCURACY,
        **_STEPS,
        "--speeds": SPEEDS,
        "--show": NAME,
        "--waterfall": NAME,
        "--harmonics": _COUNT,
        "--turn": NAME,
    },
    "bands": {**_MODEL, **_ACCURACY, "--speeds": SPEEDS},
    "chart": {
        **_MODEL,
        **_ACCURACY,
        "--speed": SPEED,
        "--x": _RANGE,
        "--y": _RANGE,
        "--tolerance": ("1e-2", "1"),
        "--cut": ("delta=1", "speed=1 rad/s"),
    },
    "critical": {
        **_MODEL,
        **_ACCURACY,
        "--speeds": SPEEDS,
        "--of": NAME,
        "--figure": ("rms", "max"),
        "--orders": _COUNT,
        "--campbell": None,
    },
    "frequencies": {
        **_MODEL,
        "--position": ("70 deg", "1e300 rad", "1 m"),
        "--count": _COUNT,
        "--turn": _COUNT,
        "--over": _RANGE,
        "--modes": None,
    },
    "compare": {**_MODEL, **_SETTINGS, "--speed": SPEED},
}
FOUR_BAR = {
    "linkage": {
        "--case": ("1",),
        "--cases": tuple(CASES),
        "--set": SET,
        "--speed": SPEED,
        "--plot": PICTURE,
        "--branch": ("open", "crossed"),
        "--position": ("70 deg",),
        "--coupler-point": ("0.1,0", "1e308,1"),
        "--base-planes": PICTURE,
        "--json": None,
        **_EVERY,
    },
    "modes": {
        **_MODEL,
        "--speed": SPEED,
        "--of": NAME,
        "--count": _COUNT,
        "--uncoupled": None,
        "--rtol": ("1e-2",),
    },
    "curve": {
        **_MODEL,
        "--speed": SPEED,
        "--along": ("0.5", "1e300"),
        "--across": ("0.1", "1e308"),
        "--rtol": ("1e-2",),
    },
    "study": {
        **_MODEL,
        "--speeds": SPEEDS,
        "--over": ("L4=0.5,0.6", "L4=0.5:0.6:2"),
        "--of": NAME,
        "--rtol": ("1e-2",),
    },
}
DERIVE = {
    "--check": None,
    "--full": None,
    "--show": None,
    "--out": ("out", "folder.csv/x", "file.txt"),
    "--all": None,
}
COUPLER = {
    **_OF_MODEL,
    "--speed": SPEED,
    "--plot": PICTURE,
    "--positions": _COUNT,
    "--magnification": ("10", "0"),
    **_EVERY,
}

CHEAP = {
    "periodic": ("--rtol", "1e-3"),
    "floquet": ("--rtol", "1e-3"),
    "sweep": ("--rtol", "1e-2"),
    "bands": ("--rtol", "1e-2"),
    "chart": ("--rtol", "1e-2"),
    "critical": ("--rtol", "1e-2"),
    "compare": ("--method", "rk4", "--steps", "64", "--rtol", "1e-2"),
}
NEEDED = {
    "bands": ("--speeds", "1:1.2:3 rad/s"),
    "sweep": ("--speeds", "30 40 rad/s"),
    "periodic": ("--speed", "30 rad/s"),
    "critical": ("--speeds", "30:31:2 rad/s"),
    "floquet": ("--speed", "30 rad/s"),
    "compare": ("--speed", "1 rad/s"),
}


def prepare(folder: Path) -> None:
    """The files that the command lines name."""
    for name, content in {**CASES, **MECHANISMS, "file.txt": ""}.items():
        (folder / name).write_text(content, encoding="utf-8", errors="surrogateescape")
    for name in ("folder.png", "folder.csv"):
        (folder / name).mkdir()
    for name in ("full.png", "full.csv"):
        (folder / name).symlink_to("/dev/full")


def line(chance: random.Random) -> tuple[str, list[str]]:
    """A program and its arguments."""
    program = chance.choices(("solve", "models.four_bar", "models.coupler", "derive"), (12, 3, 1, 3))[0]
    if program == "derive":
        models = chance.choices((*MECHANISMS, "cam", "mathieu", *ODD), k=chance.choice((0, 1, 1, 1, 2)))
        return program, [*models, *_flags(chance, DERIVE, 2)]
    if program == "models.coupler":
        return program, ["--plot", chance.choice(PICTURE), *_flags(chance, COUPLER, 2)]
    commands = SOLVE if program == "solve" else FOUR_BAR
    if chance.random() < 0.02:
        return program, [chance.choice(ODD), *_flags(chance, _MODEL, 2)]
    name = chance.choice(sorted(commands))
    given = _flags(chance, commands[name], chance.choice((0, 1, 1, 2, 3)))
    model = []
    if program == "solve":
        model = [
            chance.choices(
                (*LINEAR, "spring.py", "nothing.py", chance.choice(ODD)), (3, 3, 3, 6, 1, 1, 1, 1, 1, 1)
            )[0]
        ]
        for wanted in (CHEAP.get(name, ()), NEEDED.get(name, ())):
            if wanted and wanted[0] not in given and chance.random() < 0.95:
                model += wanted
        if name == "chart" and chance.random() < 0.9:
            model = ["mathieu", "--rtol", "1e-2"] if "--rtol" not in given else ["mathieu"]
            for flag, axis in (("--x", "delta=0.5:1.5:3"), ("--y", "epsilon=0.1:0.5:3")):
                model += [flag, axis] if flag not in given else []
    return program, [name, *model, *given]


def _flags(chance: random.Random, flags: dict[str, tuple[str, ...] | None], count: int) -> list[str]:
    given = []
    for flag in chance.choices(sorted(flags), k=count):
        values = flags[flag]
        given.append(flag)
        if values is not None:
            given.append(chance.choice(ODD) if chance.random() < 0.35 else chance.choice(values))
    return given
