"""Points solved in other processes and on a cluster: identical results, and a one-line error if workers are
lost."""

import copy
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

import solve
from solve.batch.task import cluster, processes
from solve.errors import ValueOutOfBoundsError, WorkersError
from solve.terminal import progress
from tests.solve.batch import test_store

SPEEDS = np.linspace(12, 60, 64)


def same(one, other):
    """Compare two results except for the error estimates, whose round-off depends on the points in a
    batch."""
    errors = other.results.errors
    np.testing.assert_allclose(one.results.errors, errors, rtol=1e-6)
    one.results.errors[:] = errors
    test_store.same(one, other)


@pytest.mark.parametrize("count", [0, -1, 5000])
def test_invalid_number_of_workers_is_refused(count):
    with pytest.raises(ValueOutOfBoundsError, match=f"workers is {count}"), processes(count):
        pass


class Children(threading.Thread):
    """Thread that waits for child processes and ends one of them."""

    def run(self):
        while not multiprocessing.active_children():
            time.sleep(0.01)
        time.sleep(0.5)
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)


@pytest.mark.slow
def test_worker_processes_give_identical_results_and_end():
    model = solve.load("cam")
    with processes(2) as executor:
        same(solve.sweep(model, SPEEDS, executor=executor), solve.sweep(model, SPEEDS))
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_killed_worker_is_reported_and_the_store_resumes(tmp_path):
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
    """Return the `multiprocessing` processes that a process started."""
    listed = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(parent)], capture_output=True, text=True
    )
    return [int(line.split()[0]) for line in listed.stdout.splitlines() if "multiprocessing.spawn" in line]


def alive(process):
    computed = subprocess.run(
        ["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True
    ).stdout
    return bool(computed.strip()) and not computed.startswith("Z")


@pytest.mark.slow
def test_missing_scheduler_is_reported_in_one_line():
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "tcp://"):
        with pytest.raises(WorkersError, match="no scheduler answers"), cluster(address):
            pass


@pytest.fixture
def scheduler():
    """Yield the address of a scheduler on loopback and its two workers."""
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
def test_cluster_result_is_unchanged_by_a_killed_worker(tmp_path, scheduler):
    address, workers = scheduler
    model, speeds = solve.load("cam"), np.linspace(12, 60, 640)

    def kill(tracker):
        if tracker.tasks[0].done >= 100 and workers[0].poll() is None:
            workers[0].kill()

    with progress.listen(kill), cluster(address) as executor:
        sweep = solve.sweep(model, speeds, rtol=1e-6, executor=executor, store=tmp_path / "s")
    assert workers[0].poll() is not None
    same(sweep, solve.sweep(model, speeds, rtol=1e-6))


@pytest.mark.slow
def test_chart_in_chunks_is_identical(monkeypatch):
    """The chart has failed points and is divided into small chunks for other processes."""
    monkeypatch.setattr("solve.batch.task._MAX_CHUNK", 7)
    model = solve.load("coupler", alpha=0, cx=0, cy=0)
    axes = {"speed": np.linspace(400.0, 560.0, 6)}, {"l2": [0.05, 0.3, 0.59, 0.7]}
    alone, seen = solve.chart(model, *axes), []
    spawned = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(2, mp_context=spawned) as executor,
        progress.listen(lambda tracker: seen.append(tracker.tasks[-1].done)),
    ):
        parts = solve.chart(model, *axes, executor=executor)
    np.testing.assert_array_equal(parts.verdicts, alone.verdicts)
    np.testing.assert_allclose(parts.spectral_radius, alone.spectral_radius, rtol=1e-10)
    assert parts.failures == alone.failures
    assert len(parts.boundaries) == len(alone.boundaries)
    assert 24 in seen


def test_interruption_cancels_pending_chunks(monkeypatch):
    monkeypatch.setattr("solve.batch.task._MAX_CHUNK", 1)

    def interrupted(tracker):
        if tracker.tasks[-1].done:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(KeyboardInterrupt), progress.listen(interrupted):
            solve.sweep(solve.load("cam"), np.linspace(30, 60, 400), executor=executor)
        ended = executor.submit(time.perf_counter).result(timeout=30)
    assert ended


def test_executors_give_identical_results():
    model, speeds = solve.load("manipulator"), np.linspace(3, 30, 9)
    alone = solve.sweep(model, speeds)
    seen = []
    with (
        ThreadPoolExecutor(2) as executor,
        progress.listen(lambda tracker: seen.append(tracker.tasks[-1].done)),
    ):
        spread = solve.sweep(model, speeds, executor=executor)
    np.testing.assert_array_equal(spread.spectral_radius, alone.spectral_radius)
    np.testing.assert_array_equal(spread.figures("q1"), alone.figures("q1"))
    assert seen[-1] == len(speeds)


def test_models_are_sent_to_other_processes_and_threads():
    model = solve.load("cam", k1=7e4)
    for twin in (pickle.loads(pickle.dumps(model)), copy.copy(model)):
        assert twin.parameters == model.parameters
        assert twin.labels.options == model.labels.options
        phase = np.linspace(0, 6, 7)
        for ours, theirs in zip(model.at(phase, 50.0), twin.at(phase, 50.0), strict=True):
            np.testing.assert_array_equal(ours, theirs)
