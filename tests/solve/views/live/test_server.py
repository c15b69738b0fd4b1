"""Server of the live window: address, token, end of the program, and several windows at once."""

import asyncio
import json
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest

import solve
from solve.commands.app import run
from solve.errors import WindowError
from tests.pages import DOCS

tornado = pytest.importorskip("tornado", reason="the live window needs the extra `explore`")

from tornado.httpclient import HTTPClientError, HTTPRequest  # noqa: E402
from tornado.websocket import websocket_connect  # noqa: E402

from solve.views.live.server import LiveServer  # noqa: E402

_SECONDS = 60
PRINTED = re.findall(
    r"python -m solve explore (\w+(?: --[^`\n]*)?)[`\n]",
    "".join((DOCS / f"{name}.md").read_text("utf-8") for name in ("live", "commands", "../README")),
)


@pytest.fixture(scope="module")
def live():
    """Yield a live window of the cam."""
    opened = solve.explore("cam", "300 rpm")
    yield opened
    opened.close()
    assert not opened.is_open


def fetched(address, **headers):
    """Return status, headers and text of a response."""
    try:
        with urllib.request.urlopen(
            urllib.request.Request(address, headers=headers), timeout=_SECONDS
        ) as got:
            return got.status, got.headers, got.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read().decode()


async def talk(address, *conversation, origin=None):
    """Answers of the kinds that a conversation of (message, kind of the answer) waits for."""
    headers = {"Origin": origin} if origin else {}
    request = HTTPRequest(address.replace("http", "ws", 1) + "messages", headers=headers)
    connection = await websocket_connect(request)
    found = []
    for message, kind in conversation:
        if message is not None:
            await connection.write_message(json.dumps(message))
        while True:
            text = await asyncio.wait_for(connection.read_message(), _SECONDS)
            assert text is not None, f"closed before {kind}"
            answer = json.loads(text) if isinstance(text, str) else {"is": "points"}
            if answer["is"] == kind or answer.get("outcome") == kind:
                found.append(answer)
                break
    connection.close()
    return found


def test_local_page_loads_no_external_resources(live):
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/[\w-]{22}/", live.address)
    status, headers, page = fetched(live.address)
    assert status == 200
    names = re.findall(r'(?:src|href)="(?!data:)([^"]+)"', page)
    assert set(names) == {"live.css", "live.js"}
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    texts = [
        fetched(live.address + name)
        for name in (*names, "plots.js", "controls.js", "mechanism.js", "survey.js")
    ]
    for status, headers, text in texts:
        assert status == 200
        assert headers["Content-Type"].startswith("text/")
        assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)


@pytest.mark.parametrize("path", ["", "x/", "x/live.js", "favicon.ico", "%00/", "../etc/passwd"])
def test_request_without_the_token_is_refused(live, path):
    root = live.address.split("/", 3)[:3]
    status, _, text = fetched("/".join([*root, path]))
    assert status == 403
    assert text == "The address lacks the token; open the address that solve explore printed.\n"


@pytest.mark.parametrize("name", ["../server.py", "..%2fserver.py", "session.py", "x.js"])
def test_only_files_of_the_page_are_served(live, name):
    assert fetched(live.address + name)[0] == 404


def test_other_host_names_are_refused(live):
    """A page of another site may resolve its own host name to the address of this machine."""
    assert fetched(live.address, Host="example.org")[0] == 403


@pytest.mark.parametrize("origin", ["http://example.org", "null", "http://127.0.0.1:1"])
def test_page_of_another_origin_cannot_connect(live, origin):
    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(talk(live.address, origin=origin))


def test_connection_without_the_token_is_refused(live):
    root = "/".join(live.address.split("/", 3)[:3])
    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(talk(f"{root}/x/"))


def test_two_windows_have_separate_sliders(live):
    async def both():
        ask = {"do": "solve", "number": 1, "shown": ["q1"], "speed": "300 rpm"}
        one = talk(live.address, (None, "model"), ({**ask, "values": {"k1": "9e4"}}, "solution"))
        other = talk(live.address, (None, "model"), ({**ask, "values": {"k1": "7e4"}}, "solution"))
        return await asyncio.gather(one, other)

    radii = [answers[-1]["radius"] for answers in asyncio.run(both())]
    expected = [solve.floquet(solve.load("cam", k1=k1), "300 rpm").spectral_radius for k1 in (9e4, 7e4)]
    assert radii == pytest.approx(expected, rel=1e-6)


def test_message_before_the_greeting_is_answered(live):
    """The test blocks the numerical thread until the message has arrived."""
    ask = {"do": "solve", "number": 1, "shown": ["q1"], "speed": "300 rpm", "values": {}}
    live._server.numerics.submit(time.sleep, 0.3)
    model, solution = asyncio.run(talk(live.address, (ask, "model"), (None, "solution")))
    assert (model["name"], solution["number"]) == ("cam", 1)


@pytest.mark.parametrize("text", ["", "[]", "null", "3", '{"do": "solve", "number": "x"}', '{"do": "stop"}'])
def test_malformed_message_does_not_close_the_window(live, text):
    async def send():
        connection = await websocket_connect(live.address.replace("http", "ws", 1) + "messages")
        await connection.read_message()
        await connection.write_message(text)
        await connection.write_message('{"do": "check", "name": "k1", "text": "90 kN m/rad"}')
        while json.loads(await asyncio.wait_for(connection.read_message(), _SECONDS))["is"] != "checked":
            pass
        connection.close()

    asyncio.run(send())


def test_python_window_exposes_the_model_at_the_slider_values():
    with_closing = solve.explore(solve.load("mathieu", delta=1.5))
    try:
        ask = {"do": "solve", "number": 1, "shown": ["q"], "values": {"epsilon": "0.25"}}
        asyncio.run(talk(with_closing.address, (None, "model"), (ask, "solution")))
        assert with_closing.model.parameters["delta"] == 1.5
        assert with_closing.model.parameters["epsilon"] == 0.25
        assert with_closing.speed == "1 rad/s"
        assert with_closing.address in with_closing._repr_html_()
    finally:
        with_closing.close()
    assert not with_closing.is_open
    assert with_closing._repr_html_() == "<p>Live window of mathieu: closed</p>"


@pytest.mark.parametrize(("seconds", "reason"), [(30.0, "OSError: too few files"), (0.0, "not within 0 s")])
def test_server_that_does_not_start_raises_an_error(monkeypatch, seconds, reason):
    """One server fails; the other one is slow and stops as soon as it has started."""
    ended, serve = threading.Event(), LiveServer.serve

    async def failing(server, ready):
        if seconds:
            raise OSError("too few files")
        await asyncio.sleep(0.2)
        await serve(server, ready)
        ended.set()

    monkeypatch.setattr(LiveServer, "serve", failing)
    monkeypatch.setattr("solve.views.live.window._START", seconds)
    with pytest.raises(WindowError) as raised:
        solve.explore("mathieu")
    assert str(raised.value) == f"the server of the live window did not start ({reason}); open it again"
    assert seconds or ended.wait(_SECONDS)


@pytest.mark.slow
def test_sweep_reports_progress_and_can_be_cancelled(live):
    sweep = {
        "do": "survey",
        "number": 1,
        "of": "q1.max_abs",
        "x": {"name": "speed", "low": 20, "high": 900, "count": 2000},
        "speed": "300 rpm",
    }
    small = {**sweep, "number": 2, "x": {"name": "speed", "low": 300, "high": 320, "count": 3}}
    answers = asyncio.run(
        talk(
            live.address,
            (None, "model"),
            (sweep, "progress"),
            ({"do": "cancel"}, "cancelled"),
            (small, "done"),
        )
    )
    assert "points" in answers[1]["text"]
    assert [answer.get("number") for answer in answers[1:]] == [1, 1, 2]
    orbit = solve.periodic(solve.load("cam"), "310 rpm")
    assert answers[-1]["values"][1] == pytest.approx(1e3 * orbit.statistics("q1").max_abs, rel=1e-3)


def started(*arguments):
    """Return the process of the command and the address that it prints."""
    return opened([sys.executable, "-m", "solve", "explore", *arguments, "--no-browser"])


def opened(command):
    """Return a process that opens a window and the address that it prints."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    line = process.stdout.readline()
    found = re.fullmatch(r"\w+: (http://127\.0\.0\.1:\d+/[\w-]+/) \(Ctrl-C ends\)\n", line)
    assert found, (line, process.stderr.read())
    return process, found[1]


def ended(process):
    """Return the exit status, standard output and standard error of a process that ends by itself."""
    out, err = process.communicate(timeout=_SECONDS)
    return process.returncode, out, err


@pytest.mark.slow
def test_interruption_ends_the_command_cleanly():
    process, address = started("mathieu")
    assert fetched(address)[0] == 200
    process.send_signal(signal.SIGINT)
    assert ended(process) == (0, "", "")


ENDLESS = """import time
import solve
from solve.views.live.session import Session
from solve.views.live.texts import Origin
from solve.views.live.window import run, server

Session.check = lambda *_: time.sleep(1000)
run(server(solve.load("cam"), Origin("cam"), "300 rpm"), False)
"""


@pytest.mark.slow
def test_interruption_ends_long_calculations():
    """One calculation runs in the numerical thread, and a sweep of minutes in another process."""
    process, address = opened([sys.executable, "-c", ENDLESS])
    speeds = {"name": "speed", "low": 20, "high": 900, "count": 2000}
    survey = {"do": "survey", "number": 1, "of": "q1.max_abs", "x": speeds}
    asyncio.run(talk(address, (survey, "progress"), ({"do": "check"}, "progress")))
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    others = children.read_text().split() if children.exists() else []
    process.send_signal(signal.SIGINT)
    assert ended(process) == (0, "", "")
    assert not [child for child in others if Path(f"/proc/{child}").exists()]


@pytest.mark.slow
@pytest.mark.parametrize("command", sorted({shlex.join(shlex.split(text)) for text in PRINTED}))
def test_documented_command_opens_a_window(command):
    process, address = started(*shlex.split(command))
    assert fetched(address)[0] == 200
    process.send_signal(signal.SIGTERM)
    assert ended(process) == (0, "", "")


@pytest.mark.slow
def test_closing_the_program_from_the_page_ends_the_command():
    process, address = started("cam", "--set", "k1=90kN m/rad", "--speed", "300 rpm")

    async def leave():
        await talk(address, (None, "model"))
        connection = await websocket_connect(address.replace("http", "ws", 1) + "messages")
        await connection.read_message()
        await connection.write_message('{"do": "quit"}')
        while await connection.read_message() is not None:
            pass

    asyncio.run(leave())
    assert ended(process) == (0, "", "")


def test_used_port_is_refused_in_one_line(capsys):
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        port = busy.getsockname()[1]
        assert run(["explore", "mathieu", "--port", str(port), "--no-browser"]) == 2
    refusal = f"solve: port {port} cannot be used (address already in use); give another port, or omit"
    assert capsys.readouterr().err == f"{refusal} the port to use a free one\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["mathieu", "--port", "70000"], "port is 70000; allowed: 1 … 65535"),
        (["portal_frame"], "portal_frame"),
        (["cam", "--set", "k1=-1"], "k1 (torsional stiffness of the shaft) is -1 N m/rad; allowed: > 0"),
        (["cam", "--speed", "3 kg"], "unit 'kg' does not convert to 'rad/s'"),
    ],
)
def test_unsupported_model_is_refused_before_a_window_opens(capsys, arguments, message):
    assert run(["explore", *arguments, "--no-browser"]) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1


def test_missing_library_is_reported(capsys, monkeypatch):
    for name in [
        name for name in sys.modules if name.split(".")[0] == "tornado" or name.endswith("live.server")
    ]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tornado", None)
    assert run(["explore", "mathieu", "--no-browser"]) == 2
    assert capsys.readouterr().err == (
        "solve: the live window requires Tornado; install Tornado with: "
        'pip install "parametric-vibration[explore]"\n'
    )


UNGUARDED = """import time
import solve
from solve.views.live.background import Background
from solve.views.live.survey import Axis, Survey
from solve.units import RPM

print("begins", flush=True)
survey = Survey(solve.load("mathieu"), 1.0, RPM, Axis("delta", 1.5, 2.0, 2), None, "spectral_radius")
work, ended = Background(), []
work.start(survey, lambda kind, values: ended.append(kind) if kind != "progress" else None)
while not ended:
    time.sleep(0.05)
work.close()
print(*ended)
"""


@pytest.mark.slow
def test_sweep_does_not_run_the_script_of_the_window_again(folder):
    """Scripts often have no `if __name__ == "__main__"`, which processes of `multiprocessing` require."""
    (folder / "script.py").write_text(UNGUARDED, encoding="utf-8")
    ran = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, timeout=_SECONDS)
    assert (ran.stdout, ran.stderr) == ("begins\ndone\n", "")
