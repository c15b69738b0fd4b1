"""Template of a mechanism file and its case file, to be edited: `derive --new FILE`."""

import os
import re
from pathlib import Path

from derive.errors import MechanismFileError, UnwritableError
from derive.loader import require_own_name

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

_MECHANISM = '''\
"""A table moved by an eccentric through a spring: replace it by your mechanism.

Equations:                python -m derive FILE
Vibration and stability:  python -m solve periodic FILE --plot NAME.png
Sliders in the browser:   python -m solve explore FILE
"""

from derive import Mechanism, cos, rate, sin


def mechanism():
    mine = Mechanism("NAME", "Table moved by an eccentric through a spring")

    # Coordinates are deviations from the motion of the rigid machine: name=(unit, meaning).
    twist, stretch = mine.coordinates(
        twist=("rad", "twist of the shaft"),
        stretch=("m", "table against the eccentric"),
    )
    # Parameters have a unit, a meaning and a bound; their numbers are in NAME.toml.
    J, m, r = mine.parameters(
        J=("kg m^2", "eccentric with its flywheel", "> 0"),
        m=("kg", "table", "> 0"),
        r=("m", "eccentricity", "> 0"),
    )
    k1, k2, c1, c2, F = mine.parameters(
        k1=("N m/rad", "shaft", "> 0"),
        k2=("N/m", "spring between eccentric and table", "> 0"),
        c1=("N m s/rad", "shaft", ">= 0"),
        c2=("N s/m", "spring", ">= 0"),
        F=("N", "load against the table, largest at phase 0"),
    )

    # mine.phase is the angle φ = Ωt of the drive; rate(…) is the derivative by time.
    phi = mine.phase + twist
    x = r * cos(phi) + stretch
    mine.kinetic = (J * rate(phi) ** 2 + m * rate(x) ** 2) / 2
    mine.potential = (k1 * twist**2 + k2 * stretch**2) / 2
    mine.dissipation = (c1 * rate(twist) ** 2 + c2 * rate(stretch) ** 2) / 2
    mine.force(-F * (1 + cos(mine.phase)) / 2, along=x)

    # Further results, and the range in which the linear equations are trusted.
    spring_force = k2 * stretch + c2 * rate(stretch)
    mine.output("spring_force", spring_force, "N", "force in the spring, tension positive")
    mine.trust(twist=0.05)

    # Lines of the animation; mine.metre is a length that only the picture needs.
    size = 0.02 * mine.metre
    left, right = x + size, x + 4 * size
    mine.sketch("eccentric", [(r * cos(mine.around), r * sin(mine.around))])
    mine.sketch("crank", [(0, 0), (r * cos(phi), r * sin(phi))])
    mine.sketch("table", [(left, -size), (right, -size), (right, size), (left, size), (left, -size)])
    return mine
'''

_CASES = """\
# Numbers of NAME.py: each with its unit, which may differ from that of the mechanism, and its source.
# The first case is the default; a case may state its speed.

[common.parameters]
J = { value = 0.02, unit = "kg m^2", source = "example" }
m = { value = 3, unit = "kg", source = "example" }
r = { value = 20, unit = "mm", source = "example" }
k1 = { value = 5e3, unit = "N m/rad", source = "example" }
k2 = { value = 400, unit = "N/mm", source = "example" }
c1 = { value = 0.5, unit = "N m s/rad", source = "example" }
c2 = { value = 60, unit = "N s/m", source = "example" }

[case.loaded]
speed = "600 rpm"
[case.loaded.parameters]
F = { value = 200, unit = "N", source = "example" }

[case.idle]
speed = "600 rpm"
[case.idle.parameters]
F = { value = 0, unit = "N", source = "example" }
"""


def new_mechanism(file: str) -> tuple[Path, Path]:
    """Write a complete example mechanism, which can be derived and solved unchanged, and its case file.

    Parameters
    ----------
    file : str
        Path that ends in .py; the case file has the same name with the ending .toml.

    Returns
    -------
    mechanism, cases : Path

    Raises
    ------
    MechanismFileError
        If the name is no name of a module, or if one of the files exists: nothing is replaced.
    UnwritableError
        If the folder does not exist or cannot be written.
    """
    path = Path(file)
    if path.suffix != ".py" or not _NAME.fullmatch(path.stem):
        raise MechanismFileError(
            f"--new is '{file}'; give a name of letters, digits and _ that ends in .py, such as mine.py"
        )
    require_own_name(path)
    cases = path.with_suffix(".toml")
    for existing in (path, cases):
        if os.path.lexists(existing):
            raise MechanismFileError(f"{existing} exists, and --new replaces no file; give another name")
    texts = {cases: _CASES, path: _MECHANISM}
    try:
        for target, text in texts.items():
            with target.open("x", encoding="utf-8", newline="\n") as stream:
                stream.write(text.replace("NAME", path.stem).replace("FILE", path.name))
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise UnwritableError(
            f"{path} cannot be written ({reason}); give a path in an existing, writable folder"
        ) from error
    return path, cases
