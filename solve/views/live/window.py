"""Live window, opened from Python, in notebooks, or by a command."""

import asyncio
import os
import pickle
import signal
import sys
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from types import FrameType
from typing import TYPE_CHECKING

from solve.arguments import first_is
from solve.errors import MissingLibraryError, ValueOutOfBoundsError, WindowError
from solve.labels import require_motion
from solve.loading import load
from solve.model.model import Model
from solve.system import PeriodicSystem
from solve.units import GivenSpeed
from solve.views.live.controls import first_speed
from solve.views.live.texts import Origin

if TYPE_CHECKING:
    from solve.views.live.server import LiveServer

_START = 30.0
"""Time in seconds within which the server must start."""

_END = 0.5
"""Time in seconds to wait, at the end, for a running computation. Chosen by judgement."""

_HEIGHT = 900
"""Height of the window in a notebook, in pixels."""


class LiveWindow:
    """Live window of a model, from `solve.explore`.

    Parameters
    ----------
    server : LiveServer
        Server of the page.

    Attributes
    ----------
    address : str
        Address of the page, with its token.

    Raises
    ------
    WindowError
        If the server does not start.

    Notes
    -----
    In a notebook, the window is shown in a frame. The server runs in a thread until `close` is called, the
    page ends it, or Python ends. The notebook's browser must run on the same machine.
    """

    def __init__(self, server: "LiveServer"):
        self._server = server
        self._thread = threading.Thread(target=self._serve, name="live window", daemon=True)
        self._ready = threading.Event()
        self._failure: Exception | None = None
        self._thread.start()
        if not self._ready.wait(_START) or self._failure is not None:
            server.stop()
            error = self._failure
            reason = f"{type(error).__name__}: {error}" if error else f"not within {_START:g} s"
            raise WindowError(f"the server of the live window did not start ({reason}); open it again")
        self.address = server.address

    def _serve(self) -> None:
        try:
            asyncio.run(self._server.serve(self._ready.set))
        except Exception as error:
            if self._ready.is_set():
                raise
            self._failure = error
            self._ready.set()

    @property
    def is_open(self) -> bool:
        """Whether the server runs."""
        return self._thread.is_alive()

    @property
    def speed(self) -> str:
        """Speed in the window that was opened last, as a string with a unit."""
        return self._server.state.speed

    @property
    def model(self) -> Model:
        """Model with the values of the sliders in the window that was opened last."""
        return pickle.loads(pickle.dumps(self._server.state.model))

    def close(self) -> None:
        """End the server."""
        self._server.stop()
        self._thread.join()

    def __repr__(self) -> str:
        return (
            f"Live window of {self._server.model.labels.name}: {self.address if self.is_open else 'closed'}"
        )

    def _repr_html_(self) -> str:
        """HTML frame that contains the page, for a notebook."""
        if not self.is_open:
            return f"<p>{escape(repr(self))}</p>"
        style = f"width: 100%; height: {_HEIGHT}px; border: 0"
        return f'<iframe src="{escape(self.address)}" style="{style}" allow="clipboard-write"></iframe>'


@first_is(Model, str, such_as="solve.load('cam')")
def explore(
    model: Model | str,
    speed: float | str | None = None,
    port: int = 0,
) -> LiveWindow:
    """Open the live window of a model. The window shows the solution, and sliders for speed and parameters.

    Parameters
    ----------
    model : Model or str
        Model, the name of a model, or the path of a mechanism file. Its parameters are the initial values of
        the sliders.
    speed : float or str, optional
        Initial speed in rad/s, or a string with a unit; by default the speed of the case, or a speed well
        below resonance.
    port : int
        Port on this machine; 0 selects a free one.

    Returns
    -------
    LiveWindow
        Window, which a notebook displays as a page. Elsewhere, open its `address` in a browser.

    Raises
    ------
    MissingLibraryError
        If the extra `explore` (Tornado) is not installed.
    NoMotionError
        If the model does not move.
    WindowError
        If the server does not start.
    SolveError
        For other bad input.

    Examples
    --------
    >>> window = explore("mathieu")
    >>> window.is_open
    True
    >>> window.close()
    """
    if isinstance(model, str):
        return LiveWindow(server(load(model), Origin(model), speed, port))
    return LiveWindow(server(model, Origin.from_model(model), speed, port))


def server(
    model: PeriodicSystem, origin: Origin, speed: float | str | None = None, port: int = 0
) -> "LiveServer":
    """Return the server of a model, after a check that the initial solution exists. Raises the exceptions of
    `explore`."""
    try:
        from solve.views.live.server import LiveServer
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "tornado":
            raise
        raise MissingLibraryError.of_extra("the live window", "Tornado", "explore") from None
    if not isinstance(model, Model):
        raise ValueOutOfBoundsError(
            f"'{model.labels.name}' has no generated equations; the live window requires a mechanism, such "
            "as cam"
        )
    if model.labels.vibrates:
        require_motion(model)
    omega: GivenSpeed = first_speed(model, speed)
    return LiveServer(model, origin, omega, port)


def run(live: "LiveServer", opens_browser: bool) -> None:
    """Run the server until Ctrl-C, or until the page stops it. The address is printed on one line when the
    page is ready."""

    def ready() -> None:
        print(f"{live.model.labels.name}: {live.address} (Ctrl-C ends)", flush=True)
        if opens_browser and _has_screen():
            threading.Thread(target=webbrowser.open, args=(live.address,), daemon=True).start()

    with _ended_by_interruption(live.stop):
        asyncio.run(live.serve(ready))
    if not live.calculating.acquire(timeout=_END):
        # Otherwise, the interpreter would wait for the thread, whose result is no longer needed.
        os._exit(0)


@contextmanager
def _ended_by_interruption(stop: Callable[[], None]) -> Iterator[None]:
    """Context manager in which Ctrl-C and a termination signal stop the server properly."""

    def interrupt(_: int, __: FrameType | None) -> None:
        stop()

    before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _has_screen() -> bool:
    """Return whether a browser with a window can be opened. A text browser would occupy the terminal."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
