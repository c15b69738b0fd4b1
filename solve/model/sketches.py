"""The lines that a mechanism states of its picture, at many phases."""

import numpy as np

from solve.arrays import Array, Plane
from solve.errors import ValueOutOfBoundsError
from solve.model.setup import Setup

SAMPLES = {"points": 1, "curve": 361, "beam": 33}
"""Points to be drawn, by the kind of a line, for each that is stated."""


def stated_lines(setup: Setup, phase: Array, speed: float, q: Array) -> dict[str, Plane]:
    """Places x + iy (points, k) of the lines by name, in coherent units, for q (n, k) at phases (k,).

    Raises ValueOutOfBoundsError where a line has no place.
    """
    found: dict[str, Plane] = {}
    if not getattr(setup.module, "SKETCH", ()):
        return found
    function = setup.function("sketch")
    for number, (name, _, kind) in enumerate(setup.module.SKETCH):
        samples = SAMPLES[kind]
        running = np.tile(np.linspace(0.0, 1.0, samples), len(phase))
        many = np.repeat(np.vstack((phase, np.full(len(phase), speed), q)), samples, axis=1)
        values = function.call([many[:1], many[1:2], many[2:], running[None], setup.p])
        columns = values[number].full()
        places = columns[::2] + 1j * columns[1::2]
        if not np.isfinite(places).all():
            raise ValueOutOfBoundsError(
                f"sketch {name} of {setup.module.NAME} has no place at some phase; look at its parameters"
            )
        found[name] = places if samples == 1 else places.reshape(len(phase), samples).T
    return found
