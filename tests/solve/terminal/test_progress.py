"""Progress of long computations: text, listeners, and output on standard error."""

import io
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import threading
from contextlib import redirect_stderr
from pathlib import Path

import pytest

from solve.terminal import progress

ROOT = Path(__file__).resolve().parents[3]


def status(tracker, seconds=10.0):
    """Return the status at a time (s) after the start of the outermost task."""
    return tracker.status(tracker.tasks[0].started + seconds)


def test_nested_tasks_give_the_remaining_time():
    with progress.listen() as tracker:
        assert tracker.status(0.0) is None
        with progress.task("curves", 4) as curves:
            curves.add()
            with progress.subtask("curves"), progress.task("points", 10) as points:
                points.add(5)
                estimate = status(tracker)
                assert estimate.fraction == 0.375
                assert estimate.text == "10 s so far, about 17 s to go: 1 of 4 curves, 5 of 10 points"
            assert curves.done == 2
        assert tracker.tasks == []


def test_dissimilar_steps_give_the_remaining_time_of_the_current_one():
    with progress.listen() as tracker, progress.steps(3) as step:
        step("the grid")
        assert status(tracker).text == "10 s so far: the grid (step 1 of 3)"
        step("edges")
        with progress.task("points", 10) as points:
            points.add(4)
            points.started = tracker.tasks[0].started + 6
            estimate = status(tracker)
        assert (
            estimate.text == "10 s so far, about 6 s to go in this step: edges (step 2 of 3), 4 of 10 points"
        )
        assert estimate.fraction == 0.4


def test_nested_tasks_of_one_unit_are_shown_once():
    with (
        progress.listen() as tracker,
        progress.task("points", 100),
        progress.subtask("points", 50),
        progress.task("points", 50) as some,
    ):
        some.add(10)
        assert status(tracker).text == "10 s so far, about 90 s to go: 10 of 100 points"


def test_subtask_of_another_unit_is_not_counted():
    with progress.listen() as tracker, progress.task("curves", 4) as curves:
        with progress.subtask("points", 3):
            progress.set_total("steps", 5, lambda: 10)
        assert (curves.done, curves.total) == (0, 4)
        assert tracker.reports == 1


def test_expected_total_can_be_changed():
    with progress.listen() as tracker, progress.task("steps"):
        assert status(tracker).text == "10 s so far: steps"
        progress.set_total("steps", 100, lambda: 400)
        assert status(tracker).text == "10 s so far, about 30 s to go: 100 of 400 steps"


def test_tasks_end_with_an_exception():
    with progress.listen() as tracker:
        with pytest.raises(ZeroDivisionError), progress.task("points", 3), progress.task("steps"):
            raise ZeroDivisionError
        assert tracker.tasks == []


def test_reports_of_other_threads_are_not_tracked():
    with progress.task("points", 3) as alone:
        alone.add()
    with progress.listen() as tracker, progress.task("points", 3) as points:
        other = threading.Thread(target=lambda: progress.task("others", 3).__enter__().add(3))
        other.start()
        other.join()
        assert [task.what for task in tracker.tasks] == ["points"]
        assert points.done == 0


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (99.4, "99 s"), (99.6, "2 min"), (5969, "99 min"), (5971, "1.7 h")]
)
def test_durations_in_words(seconds, words):
    assert progress.duration(seconds) == words


class Waits:
    """Event that advances the clock at each wait and is set after a number of waits."""

    def __init__(self, clock, pauses):
        self.clock, self.left, self.pauses = clock, pauses, []

    def wait(self, pause):
        self.pauses.append(pause)
        self.clock[0] += pause
        self.left -= 1
        return self.left < 0


def test_log_receives_lines_at_increasing_intervals(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    error, ended = io.StringIO(), Waits(clock, 6)
    with progress.listen() as tracker, progress.task("points", 1000) as points, redirect_stderr(error):
        points.add(100)
        progress._show("solve", tracker, progress._ProgressLine(), ended)
    assert ended.pauses == [10, 10, 20, 40, 60, 60, 60]
    lines = error.getvalue().splitlines()
    assert lines[0] == "solve: 10 s so far, about 90 s to go: 100 of 1000 points"
    assert len(lines) == 6
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", error.getvalue())


def test_short_task_shows_no_progress():
    error = io.StringIO()
    with redirect_stderr(error), progress.show_progress("solve"), progress.task("points", 3) as points:
        points.add()
    assert error.getvalue() == ""


def test_no_progress_is_shown_without_a_task(monkeypatch):
    clock, error = [0.0], io.StringIO()
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    with progress.listen() as tracker, redirect_stderr(error):
        progress._show("solve", tracker, progress._ProgressLine(), Waits(clock, 3))
    assert error.getvalue() == ""


def shown_on_a_terminal(command, until, then):
    """Run a command on a pseudo-terminal and call `then` with its process once `until` has appeared.

    Return the output, the exit status and the processor time (s) used after the call.
    """
    leader, follower = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "200", "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=follower, stdout=follower, stderr=follower, env=environment
    )
    os.close(follower)
    seen, spent = "", None
    while True:
        try:
            more = os.read(leader, 65536)
        except OSError:
            break
        if not more:
            break
        seen += more.decode(errors="replace")
        if spent is None and until in seen:
            spent = _spent(process.pid)
            then(process)
    os.close(leader)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert spent is not None, seen
    return seen, process.returncode, used.ru_utime + used.ru_stime - spent


def _spent(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


ON_A_TERMINAL = """
import sys
from solve.terminal import progress
progress.TERMINAL_DELAY = progress.TERMINAL_INTERVAL = 0.01
with progress.show_progress("solve"), progress.task("points", 4) as points:
    points.add()
    sys.stdin.readline()
print("result")
"""


def test_terminal_shows_one_line_that_disappears():
    read = []
    leader, follower = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    process = subprocess.Popen(
        [sys.executable, "-c", ON_A_TERMINAL],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=follower,
        stderr=follower,
        env=environment,
    )
    os.close(follower)
    while "1 of 4 points" not in "".join(read):
        read.append(os.read(leader, 65536).decode())
    assert process.stdin is not None
    process.stdin.write(b"\n")
    process.stdin.close()
    while "result" not in "".join(read):
        read.append(os.read(leader, 65536).decode())
    assert process.wait() == 0
    os.close(leader)
    seen = "".join(read)
    assert "0 s so far" in seen
    assert re.search(r"\x1b\[2Kresult", seen)
    assert seen.rindex("\x1b[?25h") > seen.rindex("\x1b[?25l")


LONG = [
    'solve sweep four_bar --speeds "20:60:4000 rad/s"',
    'solve bands four_bar --option terms=full --set zeta=0 --speeds "50:100:26 rad/s"',
    'solve chart cam --x "speed=300:900:90 rpm" --y k3=5e4:5e5:90',
    'solve critical four_bar --speeds "10:100:300 rad/s"',
    'solve compare manipulator --speed "10 rad/s"',
    'solve validity cam --speeds "100:600:2000 rpm"',
    'solve transient cam --speed "300 rpm" --turns 4000 --nonlinear',
    'solve floquet cam --speed "60 rpm" --method fourier',
    'solve floquet gear_pair --speed "0.01 rpm" --rtol 1e-3 --all-multipliers',
    'models.four_bar study --speeds "15:50:71 rad/s" --over L4=0.5,0.6',
    'models.four_bar design --allowable "100 MPa"',
    "models.four_bar corrected --elements 4,5,6",
    'solve report four_bar --speed "30 rad/s" --speeds "10:40:31 rad/s"',
]


@pytest.mark.slow
@pytest.mark.parametrize("line", LONG)
def test_long_command_shows_progress_and_can_be_interrupted(line, tmp_path):
    flag, file = ("--out", "page.html") if " report " in line else ("--save", "result.npz")
    command = [sys.executable, "-m", *shlex.split(line), flag, str(tmp_path / file)]
    interrupt = lambda process: process.send_signal(signal.SIGINT)  # noqa: E731
    seen, status, seconds = shown_on_a_terminal(command, " so far", interrupt)
    assert status == 130, seen
    assert seen.splitlines()[-1].endswith(": interrupted")
    assert seconds < 1.0
    assert list(tmp_path.iterdir()) == []
