"""Local server of the live window, based on Tornado. It provides pages and messages at an address with a
secret token."""

import asyncio
import json
import pickle
import secrets
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from tornado import httpserver, netutil, web, websocket

from solve.errors import SolveError, ValueOutOfBoundsError
from solve.model.model import Model
from solve.units import GivenSpeed
from solve.views.live.background import Background, internal_error
from solve.views.live.session import Later, Send, Session
from solve.views.live.texts import Origin, State

HOST = "127.0.0.1"

_PAGE = Path(__file__).with_name("page")
_KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_FILES = {file.name: file for file in sorted(_PAGE.iterdir()) if file.suffix in _KINDS}

_MOST_BYTES = 100_000
"""Maximum size, in bytes, of a message from a page: several thousand values of parameters."""

_LAST = 1 << 53
"""Number that exceeds the numbers of all requests: the largest integer up to which JavaScript represents all
integers exactly."""

_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; connect-src 'self' ws://127.0.0.1:{port} ws://localhost:{port}; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self' http://localhost:* http://127.0.0.1:*",
}
"""Headers of every response. They prevent the page from loading anything from elsewhere, and permit only
local pages, such as notebooks, to embed it in a frame."""


class LiveServer:
    """Server of the live windows of one model.

    Parameters
    ----------
    model : Model
        Model with the initial values of the sliders.
    origin : Origin
        Files of the model.
    speed : GivenSpeed
        Initial speed in rad/s, with its unit.
    port : int
        Port of the server; 0 selects a free one.

    Raises
    ------
    ValueOutOfBoundsError
        If the port cannot be used.
    """

    def __init__(self, model: Model, origin: Origin, speed: GivenSpeed, port: int = 0):
        self._sockets = _bound(port)
        self.port: int = self._sockets[0].getsockname()[1]
        self.token = secrets.token_urlsafe(16)
        self.model, self._origin, self._speed = model, origin, speed
        # CasADi functions may be evaluated by one thread at a time. This thread therefore computes the
        # solutions of all windows, with a copy of the model.
        self.numerics = ThreadPoolExecutor(1, thread_name_prefix="numerics")
        self.calculating = threading.Lock()
        self._base: Model | None = None
        self.last: Session | None = None
        self.loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._is_stopped = False
        self.pages: set[Page] = set()

    @property
    def address(self) -> str:
        """Address of the page, with the token."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    def session(self, send: Send, later: Later) -> Session:
        """Return the session of a new window. The session runs in the numerical thread."""
        base = self._base or pickle.loads(pickle.dumps(self.model))
        self._base = base
        self.last = Session(base, self._origin, self._speed, send, later)
        return self.last

    @property
    def state(self) -> State:
        """State of the window that was opened last; if there is no window, the initial state."""
        if self.last is not None:
            return self.last.state
        return Session(self.model, self._origin, self._speed, *2 * [lambda *_: None]).state

    async def serve(self, ready: Callable[[], object]) -> None:
        """Serve until `stop` is called; return immediately if it has already been called. `ready` is called
        when the page can be opened."""
        self.loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        if self._is_stopped:
            self._stop.set()
        settings: dict[str, Any] = {
            "log_function": lambda handler: None,
            "websocket_max_message_size": _MOST_BYTES,
        }
        routes = [
            (r"/([^/]*)/messages", Page, {"server": self}),
            (r"/([^/]*)/(.*)", File, {"server": self}),
            (r"/().*", File, {"server": self}),
        ]
        server = httpserver.HTTPServer(web.Application(routes, **settings))
        server.add_sockets(self._sockets)
        ready()
        try:
            await self._stop.wait()
        finally:
            server.stop()
            for page in [*self.pages]:
                page.end()
            await server.close_all_connections()
            self.numerics.shutdown(wait=False, cancel_futures=True)

    def stop(self) -> None:
        """End `serve`. May be called from any thread."""
        self._is_stopped = True
        if self.loop is not None and self._stop is not None and not self.loop.is_closed():
            self.loop.call_soon_threadsafe(self._stop.set)

    def allows(self, token: str, host: str) -> bool:
        """Return whether a request contains the token and is addressed to a host name of this machine."""
        hosts = {f"{name}:{self.port}" for name in (HOST, "localhost")}
        return secrets.compare_digest(token.encode(), self.token.encode()) and host in hosts


def _whole(number: object) -> int:
    """Return the number of a message; 0 if it is not an integer."""
    return number if isinstance(number, int) else 0


def _bound(port: int) -> list[Any]:
    if not (isinstance(port, int) and 0 <= port <= 65535):
        raise ValueOutOfBoundsError(f"port is {port}; allowed: 1 … 65535, or omit it for a free one")
    try:
        return netutil.bind_sockets(port, HOST)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ValueOutOfBoundsError(
            f"port {port} cannot be used ({reason}); give another port, or omit the port to use a free one"
        ) from None


class File(web.RequestHandler):
    """Handler of requests for files of the page."""

    def initialize(self, server: LiveServer) -> None:
        self._server = server

    def set_default_headers(self) -> None:
        for name, value in _HEADERS.items():
            self.set_header(name, value.replace("{port}", self.request.host.rpartition(":")[2]))

    def get(self, token: str, name: str = "") -> None:
        """Send a file, or refuse a request without the token."""
        file = _FILES.get(name or "index.html")
        if not self._server.allows(token, self.request.host):
            self.set_status(403)
            self.finish("The address lacks the token; open the address that solve explore printed.\n")
        elif file is None:
            self.set_status(404)
            self.finish("No such page.\n")
        else:
            self.set_header("Content-Type", f"{_KINDS[file.suffix]}; charset=utf-8")
            self.finish(file.read_bytes())


class Page(websocket.WebSocketHandler):
    """Connection of one window. Solutions are computed in the numerical thread, sweeps and charts in a
    separate process per window."""

    def initialize(self, server: LiveServer) -> None:
        self._server = server
        self._session: Session | None = None
        self._newest = 0
        self._background = Background()

    def prepare(self) -> None:
        if not self._server.allows(self.path_args[0], self.request.host):
            self.set_status(403)
            self.finish()

    def check_origin(self, origin: str) -> bool:
        return origin.partition("://")[2] == self.request.host

    def open(self, *args: str, **kwargs: str) -> None:
        self.set_nodelay(True)
        self._server.pages.add(self)
        self._run(self._begin)

    def _begin(self) -> None:
        self._session = self._server.session(self.send, self._later)
        self._session.hello()

    def on_message(self, message: str | bytes) -> None:
        try:
            values = json.loads(message)
            action = str(values.get("do"))
        except (ValueError, AttributeError):
            return
        if action == "quit":
            self._server.stop()
        elif action == "cancel":
            self._background.cancel()
        elif action in ("stop", "solve"):
            self._newest = max(self._newest, _whole(values.get("number")))
            if self._session is not None:
                self._session.replace(self._newest)
        if action in ("solve", "check", "save", "survey"):
            self._run(partial(self._answer, action, values))

    def _answer(self, action: str, values: Mapping[str, Any]) -> None:
        """Respond to a message. This method runs in the numerical thread, in which `_begin` has run before
        any message."""
        session = self._session
        if session is None:
            return
        session.replace(self._newest)
        if action == "survey":
            self._begin_survey(session, values)
        else:
            getattr(session, action)(values)

    def _run(self, work: Callable[[], object]) -> None:
        """Run a computation in the numerical thread. The page shows internal errors."""

        def run() -> None:
            try:
                with self._server.calculating:
                    work()
            except Exception as error:
                self.send({"is": "failed", "message": internal_error(error)}, None)

        # The executor accepts no computation after the server has ended.
        with suppress(RuntimeError):
            self._server.numerics.submit(run)

    def _later(self, delay: float, work: Callable[[], None]) -> None:
        """Run a computation after a delay in seconds. May be called from any thread."""
        loop = self._server.loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(loop.call_later, delay, self._run, work)

    def _begin_survey(self, session: Session, values: Mapping[str, Any]) -> None:
        report = partial(self._report, values.get("number"))
        try:
            survey = session.survey(values)
        except SolveError as error:
            report("refused", {"message": str(error)})
            return
        self._background.start(survey, report)

    def _report(self, number: object, kind: str, values: Mapping[str, Any]) -> None:
        self.send({"is": "survey", "number": number, "outcome": kind, **values}, None)

    def send(self, values: Mapping[str, Any], points: bytes | None) -> None:
        """Send a message with its points. May be called from any thread."""
        text = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        if self._server.loop is not None and not self._server.loop.is_closed():
            self._server.loop.call_soon_threadsafe(self._write, text, points)

    def _write(self, text: str, points: bytes | None) -> None:
        if self.ws_connection is None or self.ws_connection.is_closing():
            return
        self.write_message(text)
        if points is not None:
            self.write_message(points, binary=True)

    def on_close(self) -> None:
        self.end()

    def end(self) -> None:
        """Unregister this browser window and stop its computations."""
        self._server.pages.discard(self)
        self._newest = _LAST
        if self._session is not None:
            self._session.replace(_LAST)
        # When the event loop ends, it waits for this call, so that no computation outlives the program.
        asyncio.get_running_loop().run_in_executor(None, self._background.close)
