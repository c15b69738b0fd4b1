"""Settings of all tests. Property tests use the same examples in every run, and have no time limit because
other programs may slow the machine.

`--hypothesis-profile=search` uses new examples, to search for further failures.
"""

import atexit
import ctypes
import gc
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.load_profile("repeatable")

# Threads of BLAS that wait take the processors from the tests beside them. The variable is read where NumPy
# is imported, which a plugin may have done before.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
threadpool_limits(1, "blas")

# Where Python may keep no bytecode, and packages have none, every process would compile all modules anew.
if sys.dont_write_bytecode and not os.path.exists(pytest.__spec__.cached):
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = tempfile.mkdtemp(prefix="bytecode-")
    sys.dont_write_bytecode = False
    os.chmod(sys.pycache_prefix, 0o755)
    atexit.register(shutil.rmtree, sys.pycache_prefix, ignore_errors=True)

# The layout takes most of the time of drawing. Tests that look at it use the fixture `laid_out`.
_SET_LAYOUT = Figure.set_layout_engine
Figure.set_layout_engine = lambda figure, layout=None, **_: None

# A job in the background is started deaf to interruptions, and so would be the commands under test.
signal.signal(signal.SIGINT, signal.default_int_handler)

_NOBODY = {"user": 65534, "group": 65534, "extra_groups": []}
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_CHECKOUT = Path(__file__).resolve().parents[1]
_DROP_CAPABILITY, _PASS_OVER_RIGHTS = 24, (1, 2)


def _without_privileges():
    """Leave root the rights of an owner alone, after the next program is started."""
    for capability in _PASS_OVER_RIGHTS:
        ctypes.CDLL(None).prctl(_DROP_CAPABILITY, capability, 0, 0, 0)


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Exclude collected tests from garbage collection, which otherwise takes a fifth of the time of
    collection. With the default thresholds, 700 objects and ten times ten such collections, it would then
    take 6 % of the time of tests; with these, it takes 2 %."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(10_000, 20, 20)
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Let every other process read folders in reverse order, so that in a fresh clone no two processes
    compile the same modules at the same time: each finds modules that the others have compiled."""
    report = yield
    if isinstance(collector, pytest.Directory) and _WORKER % 2:
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items):
    """Restore the same order in all processes, which pytest-xdist requires."""
    items.sort(key=lambda item: item.path.parts)


@pytest.fixture
def laid_out(monkeypatch):
    """Lay out figures as users see them."""
    monkeypatch.setattr(Figure, "set_layout_engine", _SET_LAYOUT)


@pytest.fixture
def as_ordinary_user(tmp_path):
    """Run `python -m solve` as a user without special rights: this one; where that is root, nobody, or root
    without the privilege to pass over rights where nobody may not even start this Python."""

    def ran(*arguments, module="solve", cwd=_CHECKOUT, user=None, **environment):
        usual = {
            "PATH": os.environ.get("PATH", os.defpath),
            "PYTHONPATH": str(_CHECKOUT),
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPYCACHEPREFIX": sys.pycache_prefix or "",
        }
        command = [sys.executable, "-m", module, *arguments]
        streams = {"capture_output": True, "text": True, "timeout": 120}
        return subprocess.run(command, cwd=cwd, env={**usual, **environment}, **streams, **(user or users))

    users = {}
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        try:
            able = ran("--help", user=_NOBODY).returncode == 0
        except PermissionError:
            able = False
        users = _NOBODY if able else {"preexec_fn": _without_privileges}
        if able:
            os.chown(tmp_path, _NOBODY["user"], _NOBODY["group"])
            for folder in tmp_path.parents[:2]:
                folder.chmod(folder.stat().st_mode | 0o011)
    return ran
