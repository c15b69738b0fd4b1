"""`python -m models.four_bar corrected`: one element a link, corrected, beside others (thesis Fig. 7.9)."""

import math
from typing import TYPE_CHECKING, Annotated, Any

from models.four_bar.commands.groups import FourBar
from solve.commands.groups import Flag, Results
from solve.errors import ValueOutOfBoundsError
from solve.progress import part, stage

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import RenderableType

    from solve.beams.structure import StructureModel
    from solve.results.contents import Contents
    from solve.results.orbit import Orbit
    from solve.statistics import Statistics
    from solve.system import PeriodicSystem

_SAMPLES = 721
_REFERENCE = {"element": "internal", "elements": 2}
"""Quintic elements whose stresses are right to 0.2 % or so; what the others are held against."""


def corrected(
    four_bar: FourBar,
    results: Results,
    speed: Annotated[str, Flag("Speed with unit: rpm, rad/s or Hz.", '"30 rad/s"')] = "30 rad/s",
    of: Annotated[
        str, Flag("Coordinate or output to compare, or PLACE_stress on either surface.", "NAME")
    ] = "follower_midpoint_stress",
    elements: Annotated[str, Flag("Numbers of cubic elements a link to set beside it.", "A,B,C")] = "1,2,3,4",
    rtol: Annotated[float, Flag("Relative error of each solution.", "R")] = 1e-6,
) -> None:
    """One element a link corrected by dynamic stiffness, beside more elements, over one turn."""
    results.files()
    model = four_bar.loaded()

    import solve
    from solve.commands.deliver import deliver
    from solve.results.turn_plot import checked_turn, curves_figure
    from solve.units import speed_in_si

    omega, systems = speed_in_si(speed), _systems(model, elements)
    for system in systems.values():
        checked_turn(system, system.parts(of)[0], len(systems))
    orbits: dict[str, Orbit] = {}
    with stage("solutions", len(systems)):
        for label, system in systems.items():
            with part("solutions"):
                orbits[label] = solve.periodic(system, omega, rtol=rtol)
    deliver(
        results,
        list(dict.fromkeys(text for orbit in orbits.values() for text in orbit.warnings)),
        record=lambda: _record(model, orbits, of),
        report=lambda: _report(model, orbits, of, four_bar.choices),
        figure=lambda: curves_figure(orbits, _largest(orbits["reference"], of)[0], "elements a link"),
        contents=lambda: _contents(model, orbits, of),
    )


def _systems(model: "StructureModel", elements: str) -> "dict[str, PeriodicSystem]":
    """The reference, the numbers of elements asked for, and the corrected one with both loads."""
    from models.four_bar.dynamic_correction import LOADS, Corrected

    counts = [each.strip() for each in elements.split(",")]
    if not all(each.isdigit() for each in counts):
        raise ValueOutOfBoundsError(
            f"--elements is '{elements}'; write numbers of elements a link, such as --elements 1,2,3"
        )
    systems: dict[str, PeriodicSystem] = {"reference": model.varied(options=_REFERENCE)}
    systems |= {count: model.varied(options={"element": "cubic", "elements": count}) for count in counts}
    one = model.varied(options={"elements": 1})
    return systems | {f"corrected, {load}": Corrected(one, load) for load in LOADS}


def _largest(orbit: "Orbit", name: str) -> "tuple[str, Statistics]":
    """The output that is largest of those that a name stands for, and its figures."""
    found = {part: orbit.statistics(part) for part in orbit.system.parts(name)}
    return max(found.items(), key=lambda each: each[1].max_abs)


def _record(model: "StructureModel", orbits: "Mapping[str, Orbit]", name: str) -> dict[str, Any]:
    from solve.results.contents import model_record, plain

    first = orbits["reference"]
    reference = _largest(first, name)[1].max_abs
    return plain(
        {
            **model_record(model),
            "speed": first.speed,
            "quantity": name,
            "unit": first.system.units.get(name, ""),
            "models": [
                {
                    "name": label,
                    **figures._asdict(),
                    "excess": figures.max_abs / reference - 1,
                    "spectral_radius": orbit.spectral_radius,
                    "error_estimate": orbit.error_estimate._asdict(),
                }
                for label, orbit in orbits.items()
                for _, figures in (_largest(orbit, name),)
            ],
        }
    )


def _report(
    model: "StructureModel", orbits: "Mapping[str, Orbit]", name: str, choices: "list[str]"
) -> "RenderableType":
    from rich.console import Group

    from solve.results.quantities import fixed, prefixed
    from solve.results.report import heading, table

    first = orbits["reference"]
    reference = _largest(first, name)[1].max_abs
    factor, unit = prefixed(first.system.units.get(name, ""), reference)
    made = table(name, "elements a link", f"max|…| ({unit})", "at", "excess (%)", "|ρ|")
    for label, orbit in orbits.items():
        _, figures = _largest(orbit, name)
        at = figures.max_phase if figures.max >= -figures.min else figures.min_phase
        made.add_row(
            label,
            fixed(figures.max_abs * factor, reference * factor, 5),
            f"{math.degrees(at):.1f}°",
            f"{100 * (figures.max_abs / reference - 1):+.2f}",
            f"{orbit.spectral_radius:.6f}",
        )
    made.caption = "reference: 2 quintic elements with an inner node a link"
    return Group(heading(model, first.speed, choices), made)


def _contents(model: "StructureModel", orbits: "Mapping[str, Orbit]", name: str) -> "Contents":
    import numpy as np

    from solve.results.contents import model_record, table_contents

    first = orbits["reference"]
    phase = np.linspace(0.0, first.system.period, _SAMPLES)
    columns: dict[str, tuple[Any, str, str]] = {"phase": (phase, "rad", "phase of the drive")}
    drawn, _ = _largest(first, name)
    for label, orbit in orbits.items():
        unit = orbit.system.units.get(drawn, "")
        columns[label] = (orbit.signal(drawn)(phase), unit, f"{drawn}, {label}")
    return table_contents(columns, {**model_record(model), "speed": first.speed, "quantity": drawn})
