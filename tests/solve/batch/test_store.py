"""Stores: interrupted work resumes with bitwise identical results, and damaged chunks are detected."""

import json
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

import solve
from solve.batch import task
from solve.commands.app import run
from solve.errors import FileError
from solve.terminal import progress

SPEEDS = np.linspace(0.5, 3, 60)


def swept(folder=None, **chosen):
    return solve.sweep(solve.load("mathieu"), SPEEDS, store=folder, **{"rtol": 1e-6, **chosen})


def same(one, other):
    for name in ("figures", "multipliers", "errors", "verdicts", "steps", "methods"):
        np.testing.assert_array_equal(getattr(one.results, name), getattr(other.results, name))
    assert one.results.warnings == other.results.warnings
    assert one.results.failures == other.results.failures


@pytest.fixture
def solved_points(monkeypatch):
    """Return a list to which each call appends the number of points that it solves."""
    counts, gathered = [], task.gathered
    monkeypatch.setattr(
        task,
        "gathered",
        lambda batch, points, kept: counts.append(len(points)) or gathered(batch, points, kept),
    )
    return counts


def test_store_does_not_change_results_and_is_reused(tmp_path, solved_points):
    plain = swept()
    solved_points.clear()
    same(swept(tmp_path / "s"), plain)
    assert sum(solved_points) == 60
    same(swept(tmp_path / "s"), plain)
    assert sum(solved_points) == 60


@pytest.mark.parametrize(
    "arguments",
    [
        ("sweep", "mathieu", "--speeds", "1:2:5 rad/s"),
        ("sweep", "mathieu", "--speeds", "1:2:5 rad/s", "--over", "epsilon=0.1:0.2:2"),
        ("chart", "mathieu", "--x", "delta=1:2:3", "--y", "epsilon=1:2:3"),
    ],
)
def test_store_without_zarr_is_refused_in_one_line(tmp_path, monkeypatch, capsys, arguments):
    monkeypatch.setitem(sys.modules, "zarr", None)
    assert run([*arguments, "--store", str(tmp_path / "s")]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error == (
        'solve: a store requires zarr; install zarr with: pip install "parametric-vibration[store]"\n'
    )
    assert list(tmp_path.iterdir()) == []


def test_interrupted_work_resumes_without_solving_finished_chunks(tmp_path, solved_points):
    def interrupt(tracker):
        if tracker.tasks[0].done >= 24:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), progress.listen(interrupt):
        swept(tmp_path / "s")
    kept = xarray.open_dataset(tmp_path / "s", engine="zarr", consolidated=False)
    assert not kept.attrs["finished"]
    finished = 8 * int((kept["checksum"] != 0).sum())
    assert 16 <= finished < 60
    before = sum(solved_points)
    same(swept(tmp_path / "s"), swept())
    assert sum(solved_points) - before - 60 in (60 - finished, 0 - finished)


def test_failures_and_warnings_are_stored(tmp_path):
    model = solve.load("coupler", alpha=0, cx=0, cy=0)
    axes = {"speed": np.linspace(400.0, 560.0, 4)}, {"l2": [0.05, 0.3, 0.59, 0.7]}
    plain = solve.chart(model, *axes, boundaries=False)
    for _ in range(2):
        chart = solve.chart(model, *axes, boundaries=False, store=tmp_path / "s")
        same(chart, plain)
    assert chart.failures
    cam = solve.load("cam")
    first, second = (solve.sweep(cam, "400 600 rpm", store=tmp_path / "t") for _ in range(2))
    same(first, second)
    assert second.results.warnings


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return a folder with all chunks and their result."""
    folder = tmp_path_factory.mktemp("whole") / "s"
    return folder, swept(folder)


@pytest.mark.parametrize("damage", [b"", b"\x00" * 40, None])
@pytest.mark.parametrize("name", ["multipliers", "figures", "texts", "checksum"])
def test_damaged_chunk_is_solved_again(tmp_path, name, damage, solved_points, whole):
    folder, plain = whole
    shutil.copytree(folder, tmp_path / "s")
    (chunk, *_) = sorted(path for path in (tmp_path / "s" / name / "c").rglob("*") if path.is_file())
    if damage is None:
        chunk.unlink()
    else:
        chunk.write_bytes(damage)
    same(swept(tmp_path / "s"), plain)
    assert sum(solved_points) == 8


def test_store_of_another_calculation_is_refused(tmp_path):
    swept(tmp_path / "s")
    model = solve.load("mathieu")
    for given, pattern in (
        (lambda: swept(tmp_path / "s", rtol=1e-7), "with rtol 1e-06 instead of 1e-07"),
        (lambda: swept(tmp_path / "s", method="gauss"), "method auto instead of Gauss"),
        (lambda: swept(tmp_path / "s", quantities=[]), "quantities"),
        (lambda: solve.sweep(model, SPEEDS[:-1], store=tmp_path / "s", rtol=1e-6), "points"),
        (
            lambda: solve.sweep(solve.load("mathieu", delta=9), SPEEDS, store=tmp_path / "s"),
            "delta 2.0 instead of 9.0",
        ),
    ):
        with pytest.raises(FileError, match=pattern):
            given()
    same(swept(tmp_path / "s"), swept())


def test_user_systems_are_distinguished_by_their_matrices(tmp_path):
    def oscillator(k):
        one = np.ones(1)
        return solve.PeriodicSystem(
            lambda phase, speed: (
                np.broadcast_to(one, (len(phase), 1, 1)),
                np.full((len(phase), 1, 1), 0.1),
                np.full((len(phase), 1, 1), k),
                np.cos(phase)[:, None],
            ),
            ["q"],
        )

    solve.sweep(oscillator(4.0), SPEEDS, store=tmp_path / "s")
    with pytest.raises(FileError, match="matrices"):
        solve.sweep(oscillator(4.0 + 1e-12), SPEEDS, store=tmp_path / "s")


@pytest.mark.parametrize("there", [(2.7, 3.3), (3.0, 3.01)])
@pytest.mark.parametrize("here", [{"height": 0.0}, {"breaks": ()}])
def test_user_systems_that_differ_between_phases_are_distinguished(tmp_path, there, here):
    def pushed(height=5.0, breaks=there):
        def matrices(phase, speed):
            one = np.ones((len(phase), 1, 1))
            push = height * ((phase > there[0]) & (phase < there[1]))
            return one, 0.3 * one, 4 * one, (np.cos(phase) + push)[:, None]

        return solve.PeriodicSystem(matrices, ["q"], breaks=breaks)

    solve.sweep(pushed(), SPEEDS, store=tmp_path / "s", rtol=1e-4)
    with pytest.raises(FileError, match=r"matrices|breaks"):
        solve.sweep(pushed(**here), SPEEDS, store=tmp_path / "s", rtol=1e-4)


def test_two_writers_are_refused(tmp_path):
    def another(tracker):
        if tracker.tasks[0].done:
            swept(tmp_path / "s")

    with pytest.raises(FileError, match="in use by another"), progress.listen(another):
        swept(tmp_path / "s")
    same(swept(tmp_path / "s"), swept())


def test_two_writers_are_refused_with_windows_locks(tmp_path, monkeypatch):
    """The test replaces the locking module of Windows, which raises an OSError if another process holds the
    lock."""
    fcntl = pytest.importorskip("fcntl")

    def locking(descriptor, mode, count):
        assert (mode, count) == (2, 1)
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)

    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    test_two_writers_are_refused(tmp_path)
    assert not (tmp_path / "s" / ".lock").exists()
    (tmp_path / "s" / ".lock").touch()  # Of a process that was killed.
    same(swept(tmp_path / "s"), swept())
    with pytest.raises(FileError, match="cannot be written"):
        swept("/proc/s")


def test_folders_with_other_files_are_refused(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    (tmp_path / "file").write_text("")
    for place, pattern in (
        (tmp_path / "mine", "contains other files"),
        (tmp_path / "file", "is a file"),
        (tmp_path / "none" / "s", "No such file"),
        ("/proc/s", "cannot be written"),
        (tmp_path / ("n" * 300), "cannot be written \\(File name too long\\)"),
    ):
        with pytest.raises(FileError, match=pattern):
            swept(place)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_store_accepts_results_from_threads(tmp_path):
    with ThreadPoolExecutor(2) as executor:
        same(swept(tmp_path / "s", executor=executor), swept())
    same(swept(tmp_path / "s"), swept())


def test_xarray_reads_the_store(tmp_path):
    computed = swept(tmp_path / "s")
    kept = xarray.open_dataset(tmp_path / "s", engine="zarr", consolidated=False)
    np.testing.assert_array_equal(kept["speed"], SPEEDS)
    np.testing.assert_array_equal(kept["multipliers"], computed.results.multipliers)
    at = kept["figures"].attrs["figure"].index("max_abs")
    np.testing.assert_array_equal(kept["figures"][:, 0, at], computed.results.figures[:, 0, at])
    assert kept.attrs["finished"]
    assert kept.attrs["work"]["model"] == "mathieu"


CHART = ["chart", "mathieu", "--x", "delta=0:6:160", "--y", "epsilon=0:3:160", "--json"]


@pytest.mark.slow
@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGINT])
def test_chart_killed_twice_equals_an_uninterrupted_chart(tmp_path, blow):
    command = [sys.executable, "-m", "solve", *CHART]
    stored = [*command, "--store", str(tmp_path / "s")]
    sizes = []
    for _ in range(2):
        process = subprocess.Popen(stored, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        before = finished(tmp_path / "s")
        while finished(tmp_path / "s") < before + 3 and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(blow)
        message = process.communicate(timeout=30)[1].decode()
        sizes.append(finished(tmp_path / "s"))
        assert process.returncode == (130 if blow == signal.SIGINT else -signal.SIGKILL), message
        assert blow != signal.SIGINT or "finished points are stored" in message
    assert 0 < sizes[0] < sizes[1] < 32
    resumed = subprocess.run(stored, capture_output=True, check=True).stdout
    alone = subprocess.run(command, capture_output=True, check=True).stdout
    assert json.loads(resumed) == json.loads(alone)


def finished(folder):
    return len(list((folder / "checksum" / "c").glob("*"))) if folder.exists() else 0


def test_interrupted_creation_of_a_store_is_repeated(tmp_path):
    swept(tmp_path / "s")
    shutil.rmtree(tmp_path / "s" / "steps")
    group = json.loads((tmp_path / "s" / "zarr.json").read_text())
    del group["attributes"]["work"]
    (tmp_path / "s" / "zarr.json").write_text(json.dumps(group))
    same(swept(tmp_path / "s"), swept())
