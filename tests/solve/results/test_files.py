"""Files of results are written completely and together, or not at all, and keep existing modes and links."""

import os
import stat
import subprocess
import sys

import pytest

from solve.commands.app import run
from solve.errors import FileError
from solve.results import files as module
from solve.results.files import PICTURES, AtomicFiles, checked, write_atomic

CSV = (".csv",)


def text(words):
    return lambda stream: stream.write(words.encode())


def write_together(folder, writers):
    with AtomicFiles() as files:
        for name, write in writers.items():
            files.write(folder / name, write)


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


def test_two_files_appear_together(tmp_path):
    with AtomicFiles() as files:
        files.write(tmp_path / "a.csv", text("one"))
        files.write(tmp_path / "b.csv", text("two"))
        assert contents(tmp_path) == {}
    assert contents(tmp_path) == {"a.csv": "one", "b.csv": "two"}


def test_exception_between_two_files_leaves_neither(tmp_path):

    def fail(stream):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_together(tmp_path, {"a.csv": text("one"), "b.csv": fail})
    assert contents(tmp_path) == {}


def test_failed_joint_write_restores_earlier_files(tmp_path):
    """A folder that has been created with the name of a file cannot be replaced."""
    (tmp_path / "old.csv").write_text("before")
    (tmp_path / "c.csv").mkdir()
    writers = {"new.csv": text("one"), "old.csv": text("two"), "c.csv": text("three")}
    with pytest.raises(FileError, match=r"c\.csv' cannot be written \(Is a directory\)"):
        write_together(tmp_path, writers)
    assert contents(tmp_path) == {"old.csv": "before"}


def test_replaced_file_keeps_its_mode_and_new_files_follow_umask(tmp_path):
    old, new = tmp_path / "old.csv", tmp_path / "new.csv"
    old.write_text("before")
    old.chmod(0o640)
    mask = os.umask(0o027)
    try:
        write_atomic(old, text("after"))
        write_atomic(new, text("after"))
    finally:
        os.umask(mask)
    assert [stat.S_IMODE(file.stat().st_mode) for file in (old, new)] == [0o640, 0o640]


def test_target_of_a_link_is_written(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "real.csv").write_text("before")
    link = tmp_path / "link.csv"
    link.symlink_to(tmp_path / "there" / "real.csv")
    write_atomic(checked(link, CSV, "data"), text("after"))
    assert link.is_symlink()
    assert contents(tmp_path / "there") == {"real.csv": "after"}


@pytest.mark.parametrize("device", ["/dev/null", "/dev/full"])
def test_device_is_not_replaced_by_a_file(tmp_path, device):
    (tmp_path / "link.csv").symlink_to(device)
    with pytest.raises(FileError, match="is a device or a pipe; give the name of a file"):
        checked(tmp_path / "link.csv", CSV, "data")
    assert not os.path.isfile(device)


@pytest.mark.parametrize("name", ["x" * 300 + ".csv", "loop.csv", "\0.csv"])
def test_impossible_file_names_are_refused(tmp_path, name):
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    with pytest.raises(FileError, match=r"cannot be written; give a path in a writable folder"):
        checked(tmp_path / name, CSV, "data")


def test_temporary_names_are_unpredictable(tmp_path, monkeypatch):
    seen, opened = [], module.Path.open

    def noting(path, *mode, **how):
        if "x" in "".join(mode):
            seen.append(path.name)
        return opened(path, *mode, **how)

    monkeypatch.setattr(module.Path, "open", noting)
    for _ in range(2):
        write_atomic(tmp_path / "a.csv", text("one"))
    assert len(set(seen)) == len(seen) == 2


def test_only_temporary_files_of_ended_processes_are_removed(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (tmp_path / f"{module._prefix(gone.pid)}abc").write_text("half")
    (tmp_path / f"{module._prefix(os.getppid())}abc").write_text("theirs")
    (tmp_path / ".mine-1-parametric").write_text("mine")
    write_atomic(tmp_path / "a.csv", text("one"))
    assert sorted(contents(tmp_path).values()) == ["mine", "one", "theirs"]


KILLED = """
import os, signal, sys
from pathlib import Path
from solve.results import files

def kill(*_):
    os.kill(os.getpid(), signal.SIGKILL)

setattr(files.Path, sys.argv[1], kill)
files.write_atomic(Path("a.csv"), lambda stream: stream.write(b"after" * 1000))
"""


@pytest.mark.parametrize("moment", ["chmod", "replace"])
def test_killed_process_leaves_the_file_unchanged(tmp_path, moment):
    (tmp_path / "a.csv").write_text("before")
    died = subprocess.run([sys.executable, "-c", KILLED, moment], cwd=tmp_path)
    assert died.returncode == -9
    assert (tmp_path / "a.csv").read_text() == "before"
    assert len(contents(tmp_path)) == 2
    write_atomic(tmp_path / "a.csv", text("after"))
    assert contents(tmp_path) == {"a.csv": "after"}


@pytest.fixture
def tiny(tmp_path):
    """Yield a file system of 64 kB."""
    place = tmp_path / "tiny"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(command, capture_output=True).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("name", ["orbit.npz", "orbit.csv", "orbit.mat", "orbit.nc", "orbit.png"])
def test_full_disk_is_reported_and_leaves_no_file(tiny, name, capsys):
    flag = "--plot" if name.endswith(PICTURES) else "--save"
    command = ["periodic", "gear_pair", "--method", "radau", "--steps", "3000"]
    assert run([*command, flag, str(tiny / name)]) == 2
    # Code is compiled once for a machine, which may be now.
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("compiling ")]
    assert lines == [
        f"solve: '{tiny / name}' cannot be written (No space left on device); no file was changed"
    ]
    assert list(tiny.iterdir()) == []


@pytest.mark.parametrize("mode", [0o500, 0o300, 0o000])
def test_write_without_permission_is_refused(tmp_path, as_ordinary_user, mode):
    """A folder with write permission but without list permission is accepted."""
    place = tmp_path / "place"
    place.mkdir(mode=mode)
    os.chown(place, tmp_path.stat().st_uid, tmp_path.stat().st_gid)
    file = place / "a.csv"
    ran = as_ordinary_user("floquet", "mathieu", "--speed", "1 rad/s", "--save", str(file))
    place.chmod(0o700)
    if mode == 0o300:
        assert (ran.returncode, ran.stderr.splitlines()[-1]) == (0, f"wrote {file}")
        return
    message = f"solve: data file '{file}' cannot be written; give a path in a writable folder\n"
    assert (ran.returncode, ran.stderr) == (2, message)
    assert list(place.iterdir()) == []
