"""Chromium pages controlled through the DevTools protocol, if Chromium is installed."""

import asyncio
import base64
import json
import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.browser import CHROMIUM

_SECONDS = 60.0
_POLL = 0.02
_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run"),
    *("--disable-background-networking", "--disable-extensions", "--disable-dev-shm-usage"),
)


class PageError(AssertionError):
    """Exception in a page, or a condition that is not met in time."""


class Tab:
    """Page under test. Its methods return after their effect."""

    def __init__(self, loop: asyncio.AbstractEventLoop, connection: Any, session: str):
        self._loop, self._connection, self._session, self._number = loop, connection, session, 0
        self.requests: list[str] = []
        self.errors: list[str] = []

    def command(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the result of a protocol command."""
        return self._loop.run_until_complete(self._command(method, parameters))

    async def _command(self, method: str, parameters: dict[str, Any]) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters, "sessionId": self._session}
        await self._connection.write_message(json.dumps(message))
        while True:
            text = await asyncio.wait_for(self._connection.read_message(), _SECONDS)
            answer = json.loads(text)
            self._note(answer)
            if answer.get("id") == self._number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]

    def _note(self, event: dict[str, Any]) -> None:
        if event.get("method") == "Network.requestWillBeSent":
            self.requests.append(event["params"]["request"]["url"])
        if event.get("method") == "Runtime.exceptionThrown":
            details = event["params"]["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))

    def evaluate(self, expression: str) -> Any:
        """Return the value of a JavaScript expression, or the result of its promise."""
        result = self.command(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True, userGesture=True
        )
        if "exceptionDetails" in result:
            raise PageError(result["exceptionDetails"]["exception"].get("description"))
        return result["result"].get("value")

    def wait(self, expression: str, seconds: float = _SECONDS) -> Any:
        """Return the value of an expression as soon as it is true."""
        end = time.monotonic() + seconds
        reason = ""
        while time.monotonic() < end:
            try:
                if value := self.evaluate(expression):
                    return value
            except PageError as error:  # A page that is still loading.
                reason = f" ({error})"
            time.sleep(_POLL)
        raise PageError(f"not within {seconds:g} s: {expression}{reason}")

    def resize(self, width: int, height: int) -> None:
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Send a mouse event with the left button: Pressed, Moved or Released."""
        buttons = 0 if kind == "Released" else 1
        self.command(
            "Input.dispatchMouseEvent",
            type=f"mouse{kind}",
            x=x,
            y=y,
            button="left",
            buttons=buttons,
            clickCount=1,
        )

    def click(self, selector: str) -> None:
        self.evaluate(f"document.querySelector({json.dumps(selector)}).click()")

    def type(self, selector: str, text: str) -> None:
        """Replace the text of a field and leave the field."""
        field = f"document.querySelector({json.dumps(selector)})"
        self.evaluate(f"{field}.focus(); {field}.select?.()")
        self.command("Input.insertText", text=text)
        self.evaluate(f"{field}.dispatchEvent(new Event('change', {{bubbles: true}})); {field}.blur()")

    def text(self, selector: str) -> str:
        return self.evaluate(f"document.querySelector({json.dumps(selector)}).textContent")

    def picture(self) -> bytes:
        """Return an image of the window as PNG."""
        return base64.b64decode(self.command("Page.captureScreenshot")["data"])

    def screenshot(self, file: Path) -> None:
        file.write_bytes(self.picture())


class Browser:
    """Running browser."""

    def __init__(self, address: str):
        from tornado.websocket import websocket_connect

        self._loop = asyncio.new_event_loop()
        self._connection: Any = self._loop.run_until_complete(
            self._within(websocket_connect, address, max_message_size=1 << 28)
        )
        self._root = Tab(self._loop, self._connection, "")
        self._targets: list[str] = []

    async def _within(self, connect: Any, *arguments: Any, **keywords: Any) -> Any:
        return await connect(*arguments, **keywords)

    def open(self, url: str, width: int = 1280, height: int = 900) -> Tab:
        """Open a page in a new window. Hidden pages are not painted."""
        target = self._plain("Target.createTarget", url="about:blank", newWindow=True)["targetId"]
        self._targets.append(target)
        session = self._plain("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = Tab(self._loop, self._connection, session)
        tab._number = 1000 * (1 + int(time.monotonic() * 1000) % 1_000_000)
        for domain in ("Page", "Runtime", "Network"):
            tab.command(f"{domain}.enable")
        tab.resize(width, height)
        tab.command("Page.navigate", url=url)
        return tab

    def close_pages(self) -> None:
        """Close all pages. Hidden pages with animations take as much time as visible ones."""
        while self._targets:
            self._plain("Target.closeTarget", targetId=self._targets.pop())

    def _plain(self, method: str, **parameters: Any) -> dict[str, Any]:
        async def ask() -> dict[str, Any]:
            self._root._number += 1
            number = self._root._number
            message = {"id": number, "method": method, "params": parameters}
            await self._connection.write_message(json.dumps(message))
            while True:
                answer = json.loads(await self._connection.read_message())
                if answer.get("id") == number:
                    assert "error" not in answer, (method, answer["error"])
                    return answer["result"]

        return self._loop.run_until_complete(ask())

    def close(self) -> None:
        self._connection.close()
        self._loop.run_until_complete(asyncio.sleep(0))
        self._loop.close()


@contextmanager
def browser(*flags: str) -> Iterator[Browser]:
    """Yield a browser for tests with additional flags. Raises LookupError if there is none."""
    if CHROMIUM is None:
        raise LookupError("no Chromium is installed")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as own:
        command = [CHROMIUM, *_FLAGS, *flags, f"--user-data-dir={own}", "about:blank"]
        log = Path(own) / "log.txt"
        with log.open("w") as stream:
            process = subprocess.Popen(command, stderr=stream, stdout=subprocess.DEVNULL)
        try:
            yield (running := Browser(_address(log)))
            running.close()
        finally:
            process.terminate()
            process.wait(_SECONDS)


def _address(said: Path) -> str:
    """Return the protocol address that the browser prints."""
    end = time.monotonic() + _SECONDS
    while time.monotonic() < end:
        if found := re.search(r"DevTools listening on (ws://\S+)", said.read_text(errors="replace")):
            return found[1]
        time.sleep(_POLL)
    raise PageError(f"the browser gives no address: {said.read_text(errors='replace')[-500:]}")
