"""The mechanism in motion: as it would turn if it were rigid, and with its vibration magnified."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import BinaryIO

import numpy as np

from solve.arguments import first_is
from solve.arrays import Array, Plane
from solve.errors import NoLoadError, ReopenedError, ValueOutOfBoundsError
from solve.methods.choice import Rule
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.newton.transients import transient
from solve.results.files import PICTURES, checked, write_whole
from solve.results.orbit import Orbit
from solve.results.quantities import round_magnification
from solve.single import periodic
from solve.system import PeriodicSystem, require_load
from solve.views.moving_page import page_text
from solve.views.moving_picture import Drawn, Panel, gif, still
from solve.views.panels import shown, titled
from solve.views.style import Figure, drawn

ENDINGS = (".gif", ".html", *PICTURES)

FREE_TURNS = 8
"""Periods of the matrices over which a free vibration is shown."""

_FRAMES, _FREE_FRAMES, _POSITIONS = 90, 240, 6
MOST_FRAMES, MOST_POSITIONS = 720, 12

_PANELS = 4
"""Coordinates whose curves are shown where none are named."""

_SAMPLES = 721
_VISIBLE = 0.12
"""Part of the mechanism's size up to which an automatic magnification may move it."""


@dataclass(frozen=True, eq=False)
class Animation:
    """A vibration to be looked at, over phases from 0 to `span` (rad).

    vibration: q (n, k) at phases (k,); signals: what is drawn beside it by name; scale: the magnification;
    about: what kind of vibration it is; doubt: why it would not be seen, if so; warnings: that, and of its
    calculation.
    """

    system: PeriodicSystem
    speed: float
    span: float
    vibration: Callable[[Array], Array]
    signals: Mapping[str, Callable[[Array], Array]]
    scale: float
    frames: int | None
    about: str
    doubt: str
    warnings: Sequence[str]

    def lines(self, phase: Array, scale: float) -> Mapping[str, Plane]:
        """Places x + iy (points, k) of the mechanism's lines by name at phases (k,), its coordinates
        multiplied by a scale: 0 for the rigid motion."""
        return self.system.sketched(phase, self.speed, scale * self.vibration(phase))

    @property
    def title(self) -> str:
        """What is shown, with the magnification."""
        return f"{titled(self.system, self.speed)}: {self._shown}"

    @property
    def _shown(self) -> str:
        if not self.system.vibrates:
            return "rigid motion"
        if self.scale != 1:
            return f"{self.about} magnified {self.scale:g} times"
        return f"{self.about}, of any size" if self._free else f"{self.about} at its true size"

    @property
    def _free(self) -> bool:
        return self.span > self.system.period

    def drawn(self, still: bool) -> Drawn:
        """What a picture shows, at the phases of a still or of an animation."""
        count = frame_count(self.frames, self._free, still)
        phase = np.arange(count) * (self.span / count)
        caption = f"grey: rigid motion; blue: with the {self._shown}" if self.system.vibrates else ""
        fine = np.linspace(0.0, self.span, _SAMPLES)
        panels = [Panel(name, signal(fine), signal(phase)) for name, signal in self.signals.items()]
        rigid, moved = self.lines(phase, 0.0), self.lines(phase, self.scale)
        return Drawn(self.system, self.title, caption, self.doubt, phase, fine, rigid, moved, panels)

    def plot(self) -> Figure:
        """Some positions in one figure of matplotlib."""
        return still(self.drawn(still=True))

    @cached_property
    def html(self) -> str:
        """The animation as a page of HTML that needs no other file."""
        # The picture itself says why the vibration would not be seen.
        return page_text(self.drawn(still=False), [each for each in self.warnings if each != self.doubt])

    def save(self, path: str | Path) -> None:
        """Write the animation (.gif, .html) or some of its positions (.png, .pdf, .svg), whole or not at all.
        Raises FileError."""
        file = checked(path, ENDINGS, "animation")
        if file.suffix.lower() in PICTURES:
            write_whole(file, drawn(self.plot(), file))
        else:
            write_whole(file, partial(self._write, file.suffix.lower()))

    def _write(self, ending: str, stream: BinaryIO) -> None:
        stream.write(gif(self.drawn(still=False)) if ending == ".gif" else self.html.encode())

    def __repr__(self) -> str:
        return f"Animation of {self.title}; .save('{self.system.name}.gif') writes it"

    def _repr_html_(self) -> str:
        """The page, in a notebook."""
        return f'<iframe srcdoc="{escape(self.html)}" style="width: 100%; height: 40rem; border: 0"></iframe>'


@first_is(PeriodicSystem, Orbit, such_as="solve.load('cam')")
def animate(
    system: PeriodicSystem | Orbit,
    speed: float | str | None = None,
    scale: float | None = None,
    frames: int | None = None,
    show: Sequence[str] | None = None,
    nonlinear: bool = False,
    method: str | Rule = "auto",
    rtol: float = 1e-8,
) -> Animation:
    """The mechanism as it moves over a period, rigid and with its coordinates multiplied by `scale`; without
    one the vibration is magnified until it can be seen.

    speed: in rad/s or a text with unit, by default that of the case; an orbit that was calculated before has
    its own. Without a load the periodic vibration is zero; then the free one over eight periods is shown, the
    largest coordinate 1. frames: of the animation, 90 (240 of a free vibration), or positions in a still, 6.
    show: coordinates and outputs whose curves stand beside, by default the first four coordinates.

    `.save("cam.gif")` writes it. Raises NoSketchError where the model states no lines, NoMotionError where it
    does not move, and other SolveError subclasses for bad input.
    """
    require_magnification(scale)
    frame_count(frames, False, False)
    asked = system.system if isinstance(system, Orbit) else system
    if not asked.solvable:
        raise ReopenedError("a result that was read from a file knows no lines to draw; load the model again")
    if asked.vibrates:
        asked.require_motion()
    asked.sketched(np.zeros(1), 1.0, np.zeros((asked.n, 1)))
    names = shown(asked, show) if show else list((asked.coordinates or asked.outputs)[:_PANELS])
    if isinstance(system, Orbit):
        _require_nothing(speed is not None or nonlinear or method != "auto")
        return _scaled(_of_orbit(system, names, frames), scale)
    omega = asked.speed_or_usual(speed)
    asked.checked(omega)
    made = _calculated(asked.shown_in(omega), omega, names, frames, nonlinear, method, rtol)
    return _scaled(made, scale)


def _calculated(
    system: PeriodicSystem,
    omega: float,
    names: Sequence[str],
    frames: int | None,
    nonlinear: bool,
    method: str | Rule,
    rtol: float,
) -> Animation:
    """Of the orbit at this speed; without a load, which it needs, of the free vibration."""
    try:
        if system.vibrates:
            require_load(system, omega)
    except NoLoadError:
        if nonlinear:
            raise
        return _free(system, omega, names, frames, rtol)
    find = nonlinear_orbit if nonlinear else periodic
    return _of_orbit(find(system, omega, method=method, rtol=rtol), names, frames)


def _require_nothing(given: bool) -> None:
    """Raise ValueOutOfBoundsError where something is given beside an orbit that it cannot change."""
    if given:
        raise ValueOutOfBoundsError(
            "an orbit that was calculated before has its speed, method and equations; leave out speed, "
            "method and nonlinear, or give the model instead of the orbit"
        )


def _of_orbit(orbit: Orbit, names: Sequence[str], frames: int | None) -> Animation:
    """With the magnification 1."""
    signals = {name: orbit.signal(name) for name in names}
    unstable = "unstable: disturbances grow, a machine does not keep to this vibration"
    doubt = unstable if orbit.verdict == "unstable" else ""
    return Animation(
        orbit.system,
        orbit.speed,
        orbit.system.period,
        orbit.at,
        signals,
        1.0,
        frames,
        "vibration",
        doubt,
        [*filter(None, [doubt]), *orbit.warnings],
    )


def _free(
    system: PeriodicSystem, omega: float, names: Sequence[str], frames: int | None, rtol: float
) -> Animation:
    """The free vibration from q = 1 at rest, scaled so that its largest coordinate is 1."""
    from scipy.interpolate import CubicHermiteSpline

    system.known_quantities(names)
    outputs = [name for name in names if name not in system.coordinates]
    if outputs:
        raise ValueOutOfBoundsError(
            f"a free vibration shows coordinates, {', '.join(system.coordinates)}; given: {outputs[0]}"
        )
    found = transient(system, omega, FREE_TURNS, (np.ones(system.n), np.zeros(system.n)), rtol=rtol)
    size = np.abs(found.q).max()
    curve = CubicHermiteSpline(found.phase, found.q / size, found.qd / size / omega, axis=1)

    def signal(name: str) -> Callable[[Array], Array]:
        row = system.coordinates.index(name)
        return lambda phase: curve(phase)[row]

    doubt = "unstable: it grows" if found.orbit and found.orbit.verdict == "unstable" else ""
    return Animation(
        system,
        omega,
        FREE_TURNS * system.period,
        curve,
        {name: signal(name) for name in names},
        1.0,
        frames,
        "free vibration",
        doubt,
        [*filter(None, [doubt]), *(found.orbit.warnings if found.orbit else [])],
    )


def _scaled(made: Animation, scale: float | None) -> Animation:
    """With this magnification, or with the largest of 1, 2, 5, 10, … that moves no point by more than 12 % of
    the mechanism's size."""
    if scale is None:
        phase = np.linspace(0.0, made.span, _SAMPLES // 4)
        rigid, moved = made.lines(phase, 0.0), made.lines(phase, 1.0)
        everywhere = np.concatenate([places.ravel() for places in rigid.values()])
        size = max(np.ptp(everywhere.real), np.ptp(everywhere.imag))
        largest = max(float(np.abs(moved[name] - places).max()) for name, places in rigid.items())
        scale = round_magnification(_VISIBLE * size / largest) if largest > 0 else 1.0
    return replace(made, scale=float(scale))


def require_magnification(scale: float | None) -> None:
    """Raise ValueOutOfBoundsError for what is no magnification."""
    if scale is None:
        return
    try:
        good = 0 <= float(scale) < math.inf and not isinstance(scale, bool | str)
    except (TypeError, ValueError):
        good = False
    if not good:
        raise ValueOutOfBoundsError(f"scale is {scale}; allowed: a number >= 0, such as 50, or leave it out")


def frame_count(frames: int | None, free: bool, still: bool) -> int:
    """How many frames or positions, the number given or the usual one. Raises ValueOutOfBoundsError."""
    if frames is None:
        return _POSITIONS if still else _FREE_FRAMES if free else _FRAMES
    most = MOST_POSITIONS if still else MOST_FRAMES
    if isinstance(frames, bool) or not (isinstance(frames, int | np.integer) and 1 <= frames <= most):
        what = "positions in a still" if still else "frames"
        raise ValueOutOfBoundsError(f"frames is {frames!r}; allowed: 1 … {most} {what}, such as {most // 2}")
    return int(frames)
