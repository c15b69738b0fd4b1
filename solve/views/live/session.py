"""Session of one window of the live page: the state of its sliders, and responses to its messages."""

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from typing import Any

from solve.equations import is_nonlinear
from solve.errors import SolveError, ValueOutOfBoundsError
from solve.labels import SPEED, known_quantities
from solve.model.model import Model
from solve.results.contents import MOST_SHOWN
from solve.terminal import progress
from solve.units import GivenSpeed, ShownUnit, speed_in_si, unit_given
from solve.views.animation import require_magnification
from solve.views.live import controls, picture
from solve.views.live.background import INTERVAL
from solve.views.live.motion import COARSE, motion
from solve.views.live.picture import Solution
from solve.views.live.survey import Survey, choices
from solve.views.live.texts import Origin, State, default_file, save_case

_FIRST_SHOWN = 3

_MOTION_DELAY, _DETAILS_DELAY = 0.04, 0.25
"""Delays in seconds after a solution until the motion of the mechanism is computed, and until the
linearisation error and the notes are computed, unless the sliders have moved. Chosen by judgement: each of
these computations takes as long as the solution."""

_DELAY = 0.4
"""Time in seconds until the progress of a solution is first shown. Chosen by judgement."""

Send = Callable[[dict[str, Any], bytes | None], object]
"""Type of the function that sends a message to the page, with the points that belong to the message, if there
are any."""

Later = Callable[[float, Callable[[], None]], object]
"""Type of the function that runs a computation after a delay in seconds, in the thread of the session."""


class Replaced(BaseException):
    """Raised when a newer request replaces the current one. It is derived from BaseException, because
    numerical code may catch every Exception and raise another one."""


class Session:
    """Session of one browser window of the live page.

    Parameters
    ----------
    base : Model
        Model with the initial values of the sliders.
    origin : Origin
        Files of the model.
    speed : GivenSpeed
        Initial speed in rad/s, with its unit.
    send : callable
        Function that sends a message to the page, from any thread.
    later : callable
        Function that runs a computation after a delay, in the thread of the session.

    Notes
    -----
    All methods run in one thread, except `replace`.
    """

    def __init__(self, base: Model, origin: Origin, speed: GivenSpeed, send: Send, later: Later):
        self.base, self.origin, self.send, self.later = base, origin, send, later
        self.unit: ShownUnit = unit_given(speed, base.labels.speed_unit)
        self.first = controls.controls_of(base, speed)
        self.stated = origin.stated(base)
        self.state = State(
            origin, self.stated, base, {}, f"{controls.number(self.first[0].value)} {self.unit.name}"
        )
        self._newest, self._lock = 0, threading.Lock()

    def replace(self, number: int) -> None:
        """Announce a newer request, which cancels the current one."""
        with self._lock:
            self._newest = max(self._newest, number)

    def hello(self) -> None:
        """Send the description of the model: its sliders, its quantities, and the quantities that sweeps and
        charts offer."""
        model = self.base
        quantities = [
            {
                "name": name,
                "unit": model.labels.units.get(name, ""),
                "meaning": model.labels.meanings.get(name, ""),
            }
            for name in known_quantities(model)
        ]
        self.send(
            {
                "is": "model",
                "name": model.labels.name,
                "title": model.labels.title,
                "case": model.labels.case or "",
                "controls": [control.record() for control in self.first],
                "quantities": quantities,
                "shown": [row["name"] for row in quantities[:_FIRST_SHOWN]],
                "most_shown": MOST_SHOWN,
                "of": choices(model),
                "vibrates": model.labels.vibrates,
                "nonlinear": is_nonlinear(model) and model.labels.vibrates,
                "file": default_file(self.origin, model),
            },
            None,
        )

    def check(self, message: Mapping[str, Any]) -> None:
        """Check a typed value. Send it in the unit of its slider, or send the reason why it is invalid."""
        name, text = str(message.get("name")), str(message.get("text"))
        try:
            value = controls.typed(self.base, name, text, self.unit)
        except SolveError as error:
            self.send({"is": "refused", "name": name, "message": str(error)}, None)
            return
        if name == SPEED:
            text = controls.with_speed_unit(text, self.unit)
        self.send({"is": "checked", "name": name, "value": value, "text": text}, None)

    def solve(self, message: Mapping[str, Any]) -> None:
        """Solve for the positions of the sliders, and send curves, verdict and errors. The motion of the
        mechanism and the details are sent later, unless a newer request arrives."""
        number, started = int(message.get("number", 0)), time.perf_counter()
        with self._answering(number):
            self._require_newest(number)
            with progress.listen(partial(self._report, number, [time.monotonic() + _DELAY])):
                speed, shown = self._moved(message), self._shown(message)
                solution = picture.solved(
                    self.state.model, speed, _rtol(message), bool(message.get("nonlinear"))
                )
                values = picture.record(solution, shown)
            seconds = time.perf_counter() - started
            texts = {"command": self._command(message), "python": self._python(message)}
            self.send({"is": "solution", "number": number, "seconds": seconds, **values, **texts}, None)
            scale = message.get("scale")
            require_magnification(scale)
            move = partial(self._send_motion, number, solution, None if scale is None else float(scale))
            steps = (
                (_MOTION_DELAY, partial(move, COARSE)),
                (_DETAILS_DELAY, partial(self._detail, number, solution)),
                (_DETAILS_DELAY, partial(move, 1.0)),
            )
            for delay, step in steps:
                self.later(delay, partial(self._follow_up, number, step))

    @contextmanager
    def _answering(self, number: int) -> Iterator[None]:
        """Context manager for a response. If an exception prevents the response, the text of the exception is
        sent to the page."""
        try:
            yield
        except Replaced:
            self.send({"is": "replaced", "number": number}, None)
        except SolveError as error:
            self.send({"is": "fault", "number": number, "message": str(error)}, None)

    def _follow_up(self, number: int, step: Callable[[], None]) -> None:
        """Perform another step of a solution, unless a newer request has arrived."""
        if number == self._newest:
            with self._answering(number):
                step()

    def _detail(self, number: int, solution: Solution) -> None:
        with progress.listen(partial(self._report, number, [math.inf])):
            self.send({"is": "details", "number": number, **picture.details(solution)}, None)

    def _send_motion(self, number: int, solution: Solution, scale: float | None, fineness: float) -> None:
        moving = motion(solution, scale, fineness)
        if moving is not None:
            self.send({"is": "motion", "number": number, **moving[0]}, moving[1])

    def _require_newest(self, number: int) -> None:
        if number < self._newest:
            raise Replaced

    def _report(self, number: int, next_time: list[float], tracker: progress.Tracker | None = None) -> None:
        """Send the progress at intervals. Raise Replaced if a newer request has arrived."""
        self._require_newest(number)
        now = time.monotonic()
        status = tracker.status(now) if tracker is not None and now >= next_time[0] else None
        if status is not None:
            next_time[0] = now + INTERVAL
            self.send({"is": "progress", "of": "solution", "number": number, **status._asdict()}, None)

    def _moved(self, message: Mapping[str, Any]) -> float:
        """Set the state to the positions of the sliders. Return the speed in rad/s. Raises SolveError
        subclasses."""
        texts = {str(name): str(text) for name, text in (message.get("values") or {}).items()}
        text = controls.with_speed_unit(str(message.get("speed") or self.state.speed), self.unit)
        speed, model = speed_in_si(text), self.state.model
        values = controls.changed_parameters(self.base, texts)
        if {**self.base.parameters, **values} != dict(model.parameters):
            model = self.base.varied(values)
        self.state = State(self.origin, self.stated, model, texts, text)
        return speed

    def _shown(self, message: Mapping[str, Any]) -> list[str]:
        names = [str(name) for name in message.get("shown") or []]
        if len(names) > MOST_SHOWN:
            raise ValueOutOfBoundsError(
                f"{len(names)} quantities are chosen; allowed: up to {MOST_SHOWN} at a time"
            )
        return list(known_quantities(self.base, names))

    def _command(self, message: Mapping[str, Any]) -> str:
        flags = [" --nonlinear"] if message.get("nonlinear") else []
        flags += [f" --rtol {_rtol(message):g}"] if message.get("rtol") else []
        return self.state.command + "".join(flags) if self.state.command else ""

    def _python(self, message: Mapping[str, Any]) -> str:
        text = self.state.python
        if message.get("rtol"):
            text = text.replace('")\n', f'", rtol={_rtol(message):g})\n')
        return text.replace("solve.periodic(", "solve.nonlinear(") if message.get("nonlinear") else text

    def survey(self, message: Mapping[str, Any]) -> Survey:
        """Compute a sweep or chart requested by the page. Raises SolveError subclasses."""
        speed = self._moved(message)
        return Survey.of_page(self.state.model, speed, self.unit, message)

    def save(self, message: Mapping[str, Any]) -> None:
        """Save the state as a case. Send a confirmation, or the reason why it cannot be saved."""
        try:
            self._moved(message)
            text = save_case(self.state, str(message.get("case")), str(message.get("file")))
            self.send({"is": "saved", "message": text}, None)
        except SolveError as error:
            self.send({"is": "not saved", "message": str(error)}, None)


def _rtol(message: Mapping[str, Any]) -> float:
    """Return the relative tolerance of a request, 1e-8 by default. Raises ValueOutOfBoundsError."""
    text = message.get("rtol") or 1e-8
    try:
        return float(text)
    except (TypeError, ValueError):
        raise ValueOutOfBoundsError(f"rtol is '{text}'; give a number, such as 1e-6") from None
