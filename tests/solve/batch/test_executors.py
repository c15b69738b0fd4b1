"""Points in other processes and on a cluster: the same results, and one line where workers are lost."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import solve
from solve.batch.executors import cluster, processes
from solve.errors import ValueOutOfBoundsError, WorkersError
from tests.solve.batch import test_store

SPEEDS = np.linspace(12, 60, 64)


def same(one, other):
    """Estimates of errors alone know in their rounding with which points theirs was solved."""
    errors = other.results.errors
    np.testing.assert_allclose(one.results.errors, errors, rtol=1e-6)
    one.results.errors[:] = errors
    test_store.same(one, other)


@pytest.mark.parametrize("count", [0, -1, 5000])
def test_a_number_of_workers_that_cannot_be_is_refused(count):
    with pytest.raises(ValueOutOfBoundsError, match=f"workers is {count}"), processes(count):
        pass


class Children(threading.Thread):
    """Looks out for other processes of this one, and ends one of them."""

    def run(self):
        while not multiprocessing.active_children():
            time.sleep(0.01)
        time.sleep(0.5)
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)


@pytest.mark.slow
def test_processes_give_the_same_and_end_with_the_block():
    model = solve.load("cam")
    with processes(2) as executor:
        same(solve.sweep(model, SPEEDS, executor=executor), solve.sweep(model, SPEEDS))
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_worker_that_is_killed_is_said_and_the_store_goes_on(tmp_path):
    model, speeds = solve.load("cam"), np.linspace(12, 60, 640)
    with processes(2) as executor:
        Children().start()
        with pytest.raises(WorkersError, match="ended before their points were solved"):
            solve.sweep(model, speeds, rtol=1e-6, executor=executor, store=tmp_path / "s")
    assert not multiprocessing.active_children()
    same(solve.sweep(model, speeds, rtol=1e-6, store=tmp_path / "s"), solve.sweep(model, speeds, rtol=1e-6))


@pytest.mark.slow
def test_workers_end_with_the_process_that_started_them():
    command = [
        sys.executable,
        "-m",
        "solve",
        "sweep",
        "cam",
        "--speeds",
        "100:600:5000 rpm",
        "--workers",
        "2",
    ]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while len(workers := children(process.pid)) < 2:
        time.sleep(0.05)
        assert process.poll() is None
    time.sleep(1.0)
    process.kill()
    process.wait()
    deadline = time.monotonic() + 30
    while any(map(alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(alive, workers))


def children(parent):
    """Processes of multiprocessing that a process started."""
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(parent)], capture_output=True, text=True
    )
    return [int(line.split()[0]) for line in listed.stdout.splitlines() if "multiprocessing.spawn" in line]


def alive(process):
    found = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True).stdout
    return bool(found.strip()) and not found.startswith("Z")


@pytest.mark.slow
def test_no_scheduler_is_said_in_one_line():
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "tcp://"):
        with pytest.raises(WorkersError, match="no scheduler answers"), cluster(address):
            pass


@pytest.fixture
def scheduler():
    """Address of a scheduler on loopback with two workers, and these."""
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask, address = [sys.executable, "-m", "dask"], "tcp://127.0.0.1:18786"
    head = subprocess.Popen(
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", "18786", "--no-dashboard"], **quiet
    )
    options = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", "/tmp"]
    workers = [subprocess.Popen([*dask, "worker", address, *options], **quiet) for _ in range(2)]
    yield address, workers
    for process in (*workers, head):
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_cluster_gives_the_same_though_one_of_two_workers_is_killed_midway(tmp_path, scheduler):
    address, workers = scheduler
    model, speeds = solve.load("cam"), np.linspace(12, 60, 640)

    def kill(work):
        if work.stages[0].done >= 100 and workers[0].poll() is None:
            workers[0].kill()

    with solve.progress.heard(kill), cluster(address) as executor:
        found = solve.sweep(model, speeds, rtol=1e-6, executor=executor, store=tmp_path / "s")
    assert workers[0].poll() is not None
    same(found, solve.sweep(model, speeds, rtol=1e-6))
