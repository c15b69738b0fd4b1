"""Command `control`: regulators and Kalman filters from named weights."""

from typing import Annotated

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Problem, Results, Speed
from solve.commands.parse import Flag, listed, require_with
from solve.errors import MissingValueError, ValueOutOfBoundsError


def control(
    problem: Problem,
    speed: Speed,
    results: Results,
    lqr: Annotated[
        str | None,
        Flag("Design a regulator with these weights of states, outputs and inputs.", '"q3=1e6, u=1"'),
    ] = None,
    kalman: Annotated[
        str | None,
        Flag(
            "Design a filter for this noise of inputs, and of measured states and outputs.", '"u=1, q1=1e-9"'
        ),
    ] = None,
    feedforward: Annotated[
        bool, Flag("Add the periodic feedforward that is optimal under the load.")
    ] = False,
    vibration: Annotated[bool, Flag("Show the periodic vibration without and with feedback.")] = False,
    margin: Annotated[
        str | None,
        Flag("Compute the smallest change of these parameters that destabilises the loop.", '"k1, c1"'),
    ] = None,
    norms: Annotated[
        str | None, Flag("Compute the H2 and H∞ norms to these states and outputs.", '"q2, q3"')
    ] = None,
    samples: Annotated[
        int | None,
        Flag("Test a loop that samples N times per period and holds each input, one sample late.", "N"),
    ] = None,
    out: Annotated[
        str | None, Flag("Write the controller to a file: .c (with .h), .mat or .fmu.", "FILE")
    ] = None,
    rtol: Annotated[
        float, Flag("Relative tolerance of the Riccati equation and the multipliers.", "R")
    ] = 1e-8,
) -> None:
    """Periodic feedback: optimal regulator and Kalman filter, and the closed loop."""
    if lqr is None and kalman is None:
        raise MissingValueError(
            'a controller requires weights; add --lqr "q3=1e6, u=1" or --kalman "u=1, q1=1e-9"'
        )
    of_loop = {"--feedforward": feedforward, "--vibration": vibration, "--margin": margin}
    of_loop |= {"--norms": norms, "--samples": samples}
    require_with("--lqr WEIGHTS", lqr is not None, of_loop)
    weights = None if lqr is None else _numbers("--lqr", lqr)
    noise = None if kalman is None else _numbers("--kalman", kalman)
    model = problem.loaded()
    names = listed("--margin", margin or ""), listed("--norms", norms or "")
    omega = speed.omega(model)
    result = solve.control(model, omega, weights, noise, rtol, feedforward, vibration, *names, samples)
    if out is not None:
        solve.export(result, out)
    deliver_result(results, result, problem.choices)


def _numbers(flag: str, text: str) -> dict[str, float]:
    """Parse a string "NAME=NUMBER, NAME=NUMBER" to a mapping. Raises ValueOutOfBoundsError."""
    numbers = {}
    for piece in filter(None, (piece.strip() for piece in text.split(","))):
        name, equals, value = (part.strip() for part in piece.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = None
        if not (name and equals) or number is None or name in numbers:
            raise ValueOutOfBoundsError(
                f"{flag} is '{text}'; write each name once with a number, in SI units, such as "
                f'{flag} "q3=1e6, u=1"'
            )
        numbers[name] = number
    return numbers
