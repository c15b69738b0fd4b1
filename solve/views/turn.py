"""Pictures over the turn: of one quantity a curve a speed or a system, and what each mode gives to it; of the
tables of a case what was fitted to them."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.beams.observations import Contributions
from solve.errors import NoResultError, ValueOutOfBoundsError
from solve.labels import SPEED
from solve.model.model import Model
from solve.results.orbit import Orbit
from solve.system import PeriodicSystem
from solve.views.panels import axis_label, label_phases, label_quantity, shades, title_of, told_apart
from solve.views.style import BLACK, GREY, VERMILION, Figure, page

_SAMPLES = 721

BEHIND = {"color": "#C8C8C8", "linewidth": 5.0, "solid_capstyle": "round"}
"""Style of a curve that the others approach."""

MOST_CURVES = 12
"""Speeds whose curves one picture can tell apart."""


def require_turn(system: PeriodicSystem, name: str, curves: int) -> None:
    """Raise UnknownNameError, and ValueOutOfBoundsError for more curves than one picture can tell apart."""
    system.known_quantities([name])
    if curves > MOST_CURVES:
        raise ValueOutOfBoundsError(
            f"{curves} curves to draw over the turn; allowed: up to {MOST_CURVES}, such as "
            '--speeds "600 900 1200 rpm"'
        )


def turn_figure(orbits: Sequence[Orbit], name: str) -> Figure:
    """A coordinate or output over one period, a curve a speed, the slowest darkest; the orbits are of one
    system. Raises UnknownNameError and ValueOutOfBoundsError."""
    require_turn(orbits[0].system, name, len(orbits))
    ordered = sorted(orbits, key=lambda orbit: orbit.speed)
    unit = orbits[0].system.speed_unit
    labels = told_apart([orbit.speed for orbit in ordered], lambda speed, form: f"{unit.of(speed):{form}}")
    by_speed = dict(zip(labels, ordered, strict=True))
    return turns_figure(by_speed, name, axis_label(orbits[0].system, SPEED), reverse=True)


def turns_figure(orbits: Mapping[str, Orbit], name: str, title: str, reverse: bool = False) -> Figure:
    """A coordinate or output over one period, a curve an orbit by its label."""
    system = next(iter(orbits.values())).system
    phase = np.linspace(0.0, system.period, max(orbit.samples for orbit in orbits.values()) + 1)
    curves = {label: orbit.signal(name)(phase) for label, orbit in orbits.items()}
    return curves_figure(system, phase, curves, name, title, reverse)


def curves_figure(
    system: PeriodicSystem,
    phase: Array,
    curves: Mapping[str, Array],
    name: str,
    title: str | None,
    reverse: bool = False,
    styles: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
    about: str = "",
) -> Figure:
    """A coordinate or output at phases (k,) of one period, curves (k,) by their labels, some in styles of
    their own. about: what is shown, by default the quantity."""
    shown = about or f"{name.replace('_', ' ')} over one turn"
    with page(3.3, f"{title_of(system)}: {shown}") as figure:
        axes = figure.subplots()
        factor = label_quantity(axes, system, name, np.array([*curves.values()]))
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        others = [label for label in curves if label not in styles]
        styled = {**styles, **dict(zip(others, shades(len(others)), strict=True))}
        for label, values in curves.items():
            axes.plot(np.degrees(phase), values * factor, label=label, **styled[label])
        label_phases(axes, system.period)
        figure.legend(title=title, loc="outside right center", handlelength=2.4, reverse=reverse)
    return figure


def contributions_figure(
    model: PeriodicSystem, found: Contributions, speed: float, uncoupled: Array | None = None
) -> Figure:
    """An output over the turn, and each mode's part of it, at a speed in rad/s; uncoupled: values (k,) of
    the output if modes did not couple."""
    curves = {"all modes": found.total}
    curves |= {f"mode {number}": values for number, values in enumerate(found.values, 1)}
    if uncoupled is not None:
        curves["uncoupled"] = uncoupled
    styles = {"all modes": {"color": BLACK, "linewidth": 2.0}, "uncoupled": {"color": VERMILION}}
    about = f"modes at {model.speed_unit.text(speed)}"
    return curves_figure(model, found.phase, curves, found.output, None, styles=styles, about=about)


def fits_figure(model: Model) -> Figure:
    """What was fitted to the tables of the model's case, a panel each. Raises NoResultError where there is
    none."""
    if not model.fits:
        raise NoResultError(f"{title_of(model)} has no series from a table; nothing to draw for --fits")
    turn = np.linspace(0.0, 2 * np.pi, _SAMPLES)
    with page(0.8 + 2.4 * len(model.fits), f"{title_of(model)}: series fitted to tables") as figure:
        panels = figure.subplots(len(model.fits), squeeze=False)[:, 0]
        for axes, fit in zip(panels, model.fits.values(), strict=True):
            angles = turn + fit.angles.min()
            axes.plot(np.degrees(fit.angles), fit.values, ".", color=GREY, label=fit.table)
            axes.plot(np.degrees(angles), fit.at(angles), color=VERMILION, label=f"{fit.harmonics} harmonics")
            axes.set_title(fit.sentence, loc="left", color=GREY, wrap=True)
            axes.set_ylabel(f"{fit.name} ({fit.unit})")
            axes.legend()
        panels[-1].set_xlabel("angle (deg)")
    return figure
