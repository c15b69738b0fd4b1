"""Animations of a mechanism: its rigid motion, and its motion with magnified vibration."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import BinaryIO

import numpy as np

from solve.arguments import first_is, matches_annotations, number_or_nan
from solve.arrays import Array, Plane, uniform_phases
from solve.certify.coefficients import require_load
from solve.equations import sketched
from solve.errors import NoLoadError, ReopenedError, ValueOutOfBoundsError
from solve.labels import known_quantities, require_motion, speed_or_usual
from solve.methods.choice import Rule
from solve.newton.orbits import nonlinear as nonlinear_orbit
from solve.newton.transients import transient
from solve.results.contents import HALF_DEGREES
from solve.results.files import PICTURES, checked, write_atomic
from solve.results.formatting import round_magnification
from solve.results.orbit import Orbit
from solve.single import periodic
from solve.system import PeriodicSystem, check, shown_in
from solve.views.moving_picture import Drawn, Panel, gif, page_text, still
from solve.views.panels import shown, titled
from solve.views.style import Figure, drawn

ENDINGS = (".gif", ".html", *PICTURES)

FREE_TURNS = 8
"""Number of periods over which a free vibration is shown. Chosen by judgement."""

_FRAMES, _FREE_FRAMES, _POSITIONS = 90, 240, 6
MOST_FRAMES, MOST_POSITIONS = 720, 12

_PANELS = 4
"""Number of coordinates whose curves are shown by default. Chosen by judgement."""

VISIBLE = 0.12
"""Largest displacement with automatic magnification, relative to the size of the mechanism. Chosen by
judgement: the vibration is clearly visible, and the mechanism is not distorted."""


@dataclass(frozen=True, eq=False)
class Animation:
    """Animation of a vibration, from `solve.animate`.

    Attributes
    ----------
    system, speed : PeriodicSystem, float
        System, and speed in rad/s.
    span : float
        Last phase in rad; the first is 0.
    vibration : callable
        Function from phases (k,) to coordinates (n, k).
    signals : mapping of str to callable
        Mapping from names of quantities drawn as curves to functions of the phase.
    scale : float
        Magnification of the vibration.
    frames : int or None
        Number of frames; None for the default.
    about : str
        Kind of vibration.
    doubt : str
        Reason why the vibration would not be observed, or an empty string.
    warnings : sequence of str
        Sentences on what is doubtful.
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
        """Return a mapping from the names of the mechanism's lines to their points x + iy (points, k) at
        phases (k,). The coordinates are multiplied by `scale`; 0 gives the rigid motion."""
        return sketched(self.system, phase, self.speed, scale * self.vibration(phase))

    @property
    def title(self) -> str:
        """Title that states the magnification."""
        return f"{titled(self.system, self.speed)}: {self._shown}"

    @property
    def _shown(self) -> str:
        if not self.system.labels.vibrates:
            return "rigid motion"
        if self.scale != 1:
            return f"{self.about} magnified {self.scale:g} times"
        return f"{self.about}, amplitude arbitrary" if self._free else f"{self.about} at its true size"

    @property
    def _free(self) -> bool:
        return self.span > self.system.period

    def drawn(self, still: bool) -> Drawn:
        """Content of a picture of several positions if `still` is True, otherwise of an animation."""
        count = frame_count(self.frames, self._free, still)
        phase = uniform_phases(count, self.span)
        caption = f"grey: rigid motion; blue: with the {self._shown}" if self.system.labels.vibrates else ""
        fine = np.linspace(0.0, self.span, HALF_DEGREES)
        panels = [Panel(name, signal(fine), signal(phase)) for name, signal in self.signals.items()]
        rigid, moved = self.lines(phase, 0.0), self.lines(phase, self.scale)
        return Drawn(self.system, self.title, caption, self.doubt, phase, fine, rigid, moved, panels)

    def plot(self) -> Figure:
        """Figure (matplotlib) of the mechanism at several positions."""
        return still(self.drawn(still=True))

    @cached_property
    def html(self) -> str:
        """Animation as a self-contained HTML page."""
        # The caption of the picture contains `doubt`.
        warnings = [warning for warning in self.warnings if warning != self.doubt]
        return page_text(self.drawn(still=False), warnings)

    @matches_annotations
    def save(self, path: str | Path) -> None:
        """Write the animation (.gif, .html), or a picture of several positions (.png, .pdf, .svg), completely
        or not at all. Raises FileError."""
        file = checked(path, ENDINGS, "animation")
        if file.suffix.lower() in PICTURES:
            write_atomic(file, drawn(self.plot(), file))
        else:
            write_atomic(file, partial(self._write, file.suffix.lower()))

    def _write(self, ending: str, stream: BinaryIO) -> None:
        stream.write(gif(self.drawn(still=False)) if ending == ".gif" else self.html.encode())

    def __repr__(self) -> str:
        return f"Animation of {self.title}; .save('{self.system.labels.name}.gif') writes it"

    def _repr_html_(self) -> str:
        """HTML frame that contains the page, for notebooks."""
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
    """Animate a mechanism over a period: its rigid motion, and its motion with magnified vibration.

    If there is no load, the free vibration over eight periods is shown, scaled so that the largest coordinate
    is 1.

    Parameters
    ----------
    system : PeriodicSystem or Orbit
        System, or an orbit of a system.
    speed : float or str, optional
        Speed in rad/s, or a string with a unit; by default the speed of the case.
    scale : float, optional
        Magnification; by default chosen so that the vibration is visible.
    frames : int, optional
        Number of frames, by default 90 (240 for a free vibration); or number of positions in a picture, by
        default 6.
    show : sequence of str, optional
        Coordinates and outputs drawn as curves, by default the first four coordinates.
    nonlinear : bool
        Whether to use the nonlinear orbit.
    method, rtol : optional
        Method and relative tolerance of the orbit, as in `periodic`.

    Returns
    -------
    Animation
        Animation. Its method `save` writes the animation or a picture.

    Raises
    ------
    NoSketchError
        If the model defines no lines.
    NoMotionError
        If the model does not move.
    SolveError
        For other bad input.
    """
    require_magnification(scale)
    frame_count(frames, False, False)
    model = system.system if isinstance(system, Orbit) else system
    if not model.labels.solvable:
        raise ReopenedError("a result that was read from a file has no lines to draw; load the model again")
    if model.labels.vibrates:
        require_motion(model)
    sketched(model, np.zeros(1), 1.0, np.zeros((model.n, 1)))
    names = shown(model, show) if show else list((model.coordinates or model.outputs)[:_PANELS])
    if isinstance(system, Orbit):
        _require_nothing(speed is not None or nonlinear or method != "auto")
        return _scaled(_of_orbit(system, names, frames), scale)
    omega = speed_or_usual(model, speed)
    check(model, omega)
    animation = _calculated(shown_in(model, omega), omega, names, frames, nonlinear, method, rtol)
    return _scaled(animation, scale)


def _calculated(
    system: PeriodicSystem,
    omega: float,
    names: Sequence[str],
    frames: int | None,
    nonlinear: bool,
    method: str | Rule,
    rtol: float,
) -> Animation:
    """Return the animation of the orbit or, if there is no load, of the free vibration."""
    try:
        if system.labels.vibrates:
            require_load(system, omega)
    except NoLoadError:
        if nonlinear:
            raise
        return _free(system, omega, names, frames, rtol)
    find = nonlinear_orbit if nonlinear else periodic
    return _of_orbit(find(system, omega, method=method, rtol=rtol), names, frames)


def _require_nothing(is_given: bool) -> None:
    """Raise ValueOutOfBoundsError if an argument is given that does not apply to an existing orbit."""
    if is_given:
        raise ValueOutOfBoundsError(
            "an orbit already has a speed, a method and equations; omit speed, method and nonlinear, "
            "or give the model instead of the orbit"
        )


def _of_orbit(orbit: Orbit, names: Sequence[str], frames: int | None) -> Animation:
    """Return the animation of an orbit, before its magnification is chosen."""
    signals = {name: orbit.signal(name) for name in names}
    unstable = "unstable: perturbations grow, so that the periodic vibration does not persist"
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
    """Return the animation of the free vibration from the initial state q = 1, q̇ = 0, scaled so that the
    largest coordinate is 1."""
    from scipy.interpolate import CubicHermiteSpline

    known_quantities(system, names)
    outputs = [name for name in names if name not in system.coordinates]
    if outputs:
        raise ValueOutOfBoundsError(
            f"an animated free vibration shows coordinates only ({', '.join(system.coordinates)}); "
            f"given: {outputs[0]}"
        )
    motion = transient(system, omega, FREE_TURNS, (np.ones(system.n), np.zeros(system.n)), rtol=rtol)
    size = np.abs(motion.q).max()
    curve = CubicHermiteSpline(motion.phase, motion.q / size, motion.qd / size / omega, axis=1)

    def signal(name: str) -> Callable[[Array], Array]:
        row = system.coordinates.index(name)
        return lambda phase: curve(phase)[row]

    doubt = "unstable: it grows" if motion.orbit and motion.orbit.verdict == "unstable" else ""
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
        [*filter(None, [doubt]), *(motion.orbit.warnings if motion.orbit else [])],
    )


def _scaled(animation: Animation, scale: float | None) -> Animation:
    """Return the animation with the magnification `scale`. If `scale` is None, the magnification is the
    largest of 1, 2, 5, 10, … that displaces no point by more than 12 % of the mechanism's size."""
    if scale is None:
        phase = np.linspace(0.0, animation.span, HALF_DEGREES // 4)
        rigid, moved = animation.lines(phase, 0.0), animation.lines(phase, 1.0)
        points = np.concatenate([line.ravel() for line in rigid.values()])
        size = max(np.ptp(points.real), np.ptp(points.imag))
        largest = max(float(np.abs(moved[name] - line).max()) for name, line in rigid.items())
        scale = round_magnification(VISIBLE * size / largest) if largest > 0 else 1.0
    return replace(animation, scale=float(scale))


def require_magnification(scale: float | None) -> None:
    """Raise ValueOutOfBoundsError unless the scale is a number >= 0 or None."""
    if scale is None:
        return
    if isinstance(scale, bool | str) or not 0 <= number_or_nan(scale) < math.inf:
        raise ValueOutOfBoundsError(f"scale is {scale}; allowed: a number >= 0, such as 50, or omit it")


def frame_count(frames: int | None, free: bool, still: bool) -> int:
    """Return the number of frames or, if `still` is True, of positions; None selects the default. Raises
    ValueOutOfBoundsError."""
    if frames is None:
        return _POSITIONS if still else _FREE_FRAMES if free else _FRAMES
    most = MOST_POSITIONS if still else MOST_FRAMES
    if isinstance(frames, bool) or not (isinstance(frames, int | np.integer) and 1 <= frames <= most):
        what = "positions in a still" if still else "frames"
        raise ValueOutOfBoundsError(f"frames is {frames!r}; allowed: 1 … {most} {what}, such as {most // 2}")
    return int(frames)
