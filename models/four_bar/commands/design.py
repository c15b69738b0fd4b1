"""`python -m models.four_bar design`: limiting speeds, quiet bands and the run-up plan under a stress."""

import re
from dataclasses import replace
from typing import Annotated

import numpy as np
import typer

from models.four_bar.commands.groups import FourBar
from models.four_bar.design import designed
from models.four_bar.design_map import allowed_lengths, checked_allowable, design_map
from models.four_bar.linkage import Linkage
from models.four_bar.results.design import carry_out, require_target
from models.four_bar.run_up.stress_map import spaced
from solve.beams.motion import lowest_frequencies
from solve.beams.structure import StructureModel
from solve.commands.deliver import deliver_result
from solve.commands.groups import Flag, Results
from solve.errors import MissingValueError, UnitError, ValueOutOfBoundsError
from solve.units import RAD_PER_S, GivenSpeed, conversion, speed_in_si, speeds_in_si, with_unit

_FIRST, _LAST, _RATIO = 1 / 32, 2 / 7, 1.04
"""Speeds of the map by default, as parts of the mean lowest frequency, and the ratio of neighbours."""

_FEWEST, _LENGTHS, _MOST_LENGTHS = 5, 48, 200
_RANGE = re.compile(r"(?P<low>[^:\s]+):(?P<high>[^:\s]+)(:(?P<count>\d+))?\s+(?P<unit>\S.*)")


def design(
    four_bar: FourBar,
    results: Results,
    allowable: Annotated[
        str | None,
        Flag('For all links, or for each: "crank=99 MPa,coupler=80 MPa,follower=90 MPa".', '"100 MPa"'),
    ] = None,
    target: Annotated[
        str | None, Flag("Speed to run up to; by default the method chooses.", '"30 rad/s"')
    ] = None,
    speeds: Annotated[
        str | None, Flag("Speeds of the map at first; narrow peaks are refined.", '"A:B:N unit"')
    ] = None,
    L4: Annotated[
        str | None,
        typer.Option(
            "--L4",
            metavar='"A:B:N m"',
            help="Range and number of ground links; by default all with a transmission angle of 40° to 140°.",
        ),
    ] = None,
    time: Annotated[str, Flag("Duration of the slowest simulated run-up.", '"60 s"')] = "60 s",
) -> None:
    """Design for high speed: limiting critical speeds, quiet bands, run-up with a moving ground pivot."""
    model = four_bar.loaded()
    stresses = _allowable(model, allowable)
    goal = None if target is None else speed_in_si(target)
    duration = _duration(time)
    lengths, count = _lengths(model, L4)
    given = _speeds(model, speeds)
    model, start = model.shown_in(given[0] if goal is None or speeds else goal), np.array(given)
    if goal is not None:
        require_target(goal, start, model.speed_unit)
    stress_map = design_map(model, stresses, start, lengths, count)
    result = carry_out(designed(stress_map), goal, duration)
    deliver_result(results, result, four_bar.choices)


def _allowable(model: StructureModel, text: str | None) -> dict[str, float]:
    """Allowable stress (Pa) of each link."""
    links = [link.name for link in model.beams.freedoms.links]
    if text is None:
        raise MissingValueError('no allowable stress given; add one, such as --allowable "100 MPa"')
    if "=" not in text:
        return checked_allowable(links, dict.fromkeys(links, _quantity("--allowable", text, "Pa", "100 MPa")))
    given = {}
    for part in text.split(","):
        name, _, value = (each.strip() for each in part.partition("="))
        if name in given:
            raise ValueOutOfBoundsError(f"--allowable gives {name} twice; give it once")
        given[name] = _quantity("--allowable", value, "Pa", "crank=100 MPa")
    return checked_allowable(links, given)


def _quantity(flag: str, text: str, unit: str, example: str) -> float:
    """A number with unit. Raises UnitError."""
    try:
        return with_unit(text, unit)
    except UnitError as error:
        raise UnitError(f'{flag}: {error}; such as {flag} "{example}"') from None


def _duration(text: str) -> float:
    duration = _quantity("--time", text, "s", "60 s")
    if not 0 < duration <= 3600:
        raise ValueOutOfBoundsError(f"--time is {text}; allowed: above 0 and up to 3600 s, such as '60 s'")
    return duration


def _speeds(model: StructureModel, text: str | None) -> list[GivenSpeed]:
    """Speeds (rad/s) of the map at first, rising."""
    if text is None:
        phase = np.linspace(0.0, model.period, 36, endpoint=False)
        mean = float(lowest_frequencies(*model.at_positions(phase).matrices(), 1).mean())
        return [GivenSpeed(omega, RAD_PER_S) for omega in spaced(_FIRST * mean, _LAST * mean, _RATIO)]
    chosen = sorted(set(speeds_in_si(text)))
    if len(chosen) < _FEWEST:
        raise ValueOutOfBoundsError(
            f"--speeds is '{text}'; a map needs {_FEWEST} different speeds at least, "
            'such as --speeds "5:45:60 rad/s"'
        )
    return chosen


def _lengths(model: StructureModel, text: str | None) -> tuple[tuple[float, float], int]:
    """Least and greatest L4 (m), and how many between. Raises LinkageError where the crank cannot turn."""
    linkage = Linkage.of(model.parameters, str(model.options["branch"]))
    if text is None:
        return allowed_lengths(linkage), _LENGTHS
    usage = f'--L4 is \'{text}\'; write "A:B:N unit", N lengths from A to B, such as --L4 "0.52:0.63:48 m"'
    match = _RANGE.fullmatch(text.strip())
    if not match:
        raise UnitError(usage)
    try:
        low, high = (float(match[name]) * conversion(match["unit"], "m") for name in ("low", "high"))
    except ValueError:
        raise UnitError(usage) from None
    count = int(match["count"] or _LENGTHS)
    if not 0 < low < high or not 2 <= count <= _MOST_LENGTHS:
        raise ValueOutOfBoundsError(usage + f", A below B, N from 2 to {_MOST_LENGTHS}")
    for length in (low, high):
        replace(linkage, L4=length).require_full_turn()
    return (low, high), count
