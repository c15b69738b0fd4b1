"""Cache of compiled code: libraries are loaded only if no other user can have changed them."""

import os
import stat
from pathlib import Path

import pytest

import solve
from solve.kernel import compiler, library
from solve.kernel.engines import EngineError
from solve.kernel.library import Size, trouble

SMALL = Size(1, 2, 2, True, False)
needs_compiler = pytest.mark.skipif(bool(trouble()), reason=trouble() or "there is a compiler")


@pytest.fixture(autouse=True)
def short_source(tmp_path, monkeypatch):
    """Source that compiles quickly, in place of the kernel."""
    source = tmp_path / "short.c"
    source.write_text("int lanes = 1;\n")
    monkeypatch.setattr(library, "_SOURCE", source)


def forget_library():
    """Make this process load the library again, as another process would."""
    library.library.cache_clear()
    library.library(SMALL)


def note_of_sweep(own_cache):
    """Note of a sweep that is solved by NumPy."""
    sweep = solve.sweep(solve.load("mathieu"), [1.0, 1.5])
    assert sweep.engine == "numpy"
    assert sweep.points[0].error is None
    (note,) = sweep.notes
    assert note.endswith("; NumPy is used, several times slower")
    assert "\n" not in note
    return note


def files(own_cache):
    return {file.suffix: file for file in own_cache.iterdir()}


def script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@needs_compiler
def test_compiled_libraries_are_reused(own_cache):
    library.library(SMALL)
    made = {file: file.stat().st_mtime_ns for file in own_cache.iterdir()}
    assert sorted(file.suffix for file in made) == [".sha256", ".so"]
    forget_library()
    assert {file: file.stat().st_mtime_ns for file in own_cache.iterdir()} == made


def test_broken_compiler_is_reported_in_one_line(own_cache, tmp_path, monkeypatch):
    monkeypatch.setenv(
        "CC", script(tmp_path / "cc", 'case "$*" in *-dM*) exit 0;; esac; echo no luck >&2; exit 1')
    )
    sweep = solve.sweep(solve.load("mathieu"), [1.0, 1.5])
    assert sweep.engine == "numpy"
    assert sweep.points[0].error is None
    (note,) = sweep.notes
    assert "no luck" in note
    assert "NumPy is used" in note
    assert "\n" not in note
    assert list(own_cache.iterdir()) == [], "something half-written is left"


@needs_compiler
@pytest.mark.parametrize("known", ["-mcpu=*", ""])
def test_compiler_may_lack_processor_flags(own_cache, tmp_path, monkeypatch, known):
    """Clang for ARM, for example, rejects some flags. Here, the compiler receives none of them."""
    refusal = 'echo "the compiler does not support $each" >&2; exit 1'
    kept = f"{known}) ;; -m*) {refusal};;" if known else f"-m*) {refusal};;"
    command = f'for each; do case "$each" in {kept} *) set -- "$@" "$each";; esac; shift; done; exec cc "$@"'
    monkeypatch.setenv("CC", script(tmp_path / "other", command))
    library.library(SMALL)
    assert sorted(files(own_cache)) == [".sha256", ".so"]


def test_missing_compiler_is_reported_in_one_line(own_cache, tmp_path, monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(compiler, "zig", lambda: ())
    assert note_of_sweep(own_cache).startswith("no C compiler (cc, gcc, clang) on this machine; ")


def test_compiled_engine_without_a_compiler_is_refused(own_cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(EngineError, match=r"no C compiler \(no-such-compiler\).*omit the engine"):
        solve.sweep(solve.load("mathieu"), [1.0], engine="compiled")


def replace(file: Path, content: bytes) -> None:
    """Replace a file by a new one. The old one remains intact for this process, which has loaded it."""
    file.unlink()
    file.write_bytes(content)


@needs_compiler
@pytest.mark.parametrize("suffix", [".so", ".sha256"])
@pytest.mark.parametrize("cut", [0, 10])
def test_damaged_cache_files_are_recompiled(own_cache, suffix, cut):
    library.library(SMALL)
    made = files(own_cache)
    whole = made[".so"].read_bytes()
    replace(made[suffix], made[suffix].read_bytes()[:cut])
    forget_library()
    assert made[".so"].read_bytes() == whole


@needs_compiler
def test_library_without_its_hash_is_not_loaded(own_cache):
    library.library(SMALL)
    made = files(own_cache)
    planted = made[".so"].read_bytes() + b"planted"
    replace(made[".so"], planted)
    forget_library()
    assert made[".so"].read_bytes() != planted


@needs_compiler
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
def test_folder_writable_by_others_is_not_used(own_cache, mode):
    own_cache.mkdir(parents=True)
    own_cache.chmod(mode)
    assert "is a symbolic link, belongs to another user or is writable by others; remove it" in note_of_sweep(
        own_cache
    )
    assert list(own_cache.iterdir()) == []


@needs_compiler
def test_library_writable_by_others_is_not_loaded(own_cache):
    library.trouble()
    for file in own_cache.iterdir():
        file.chmod(0o777)
    library.library.cache_clear()
    library.trouble.cache_clear()
    assert "is a symbolic link, belongs to another user or is writable by others; remove it" in note_of_sweep(
        own_cache
    )


@needs_compiler
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize("which", ["folder", ".so", ".sha256"])
def test_cache_of_another_user_is_not_used(own_cache, which):
    library.trouble()
    os.chown(own_cache if which == "folder" else files(own_cache)[which], 65534, 65534)
    library.library.cache_clear()
    library.trouble.cache_clear()
    assert "belongs to another user" in note_of_sweep(own_cache)


@needs_compiler
def test_symbolic_link_in_place_of_a_library_is_not_followed(own_cache, tmp_path):
    library.trouble()
    made = files(own_cache)[".so"]
    made.rename(tmp_path / "elsewhere.so")
    made.symlink_to(tmp_path / "elsewhere.so")
    library.library.cache_clear()
    library.trouble.cache_clear()
    assert "belongs to another user" in note_of_sweep(own_cache)


def test_file_in_place_of_the_folder_selects_numpy(own_cache):
    own_cache.parent.mkdir()
    own_cache.touch()
    assert "File exists" in note_of_sweep(own_cache)


@needs_compiler
def test_folder_in_place_of_a_library_selects_numpy(own_cache, caplog):
    library.trouble()
    library.library(SMALL)
    for file in own_cache.iterdir():
        file.unlink()
        file.mkdir()
    library.library.cache_clear()
    assert not library.available(SMALL)
    assert "Is a directory" in caplog.text
    assert caplog.text.count("NumPy is used") == 1


@needs_compiler
def test_relative_cache_path_is_ignored(own_cache, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    library.library(SMALL)
    assert not (tmp_path / "here").exists()
    assert len(list((tmp_path / "home" / ".cache" / "parametric-vibration").iterdir())) == 2


def test_user_without_a_home_folder_selects_numpy(own_cache, monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr("solve.kernel.compiler.Path.home", homeless)
    assert "Could not determine home directory.; set XDG_CACHE_HOME" in note_of_sweep(own_cache)


@needs_compiler
def test_inaccessible_cache_selects_numpy(tmp_path, as_ordinary_user):
    for mode in (0o500, 0o000):
        cache = tmp_path / f"{mode:o}"
        cache.mkdir(mode=mode)
        os.chown(cache, tmp_path.stat().st_uid, tmp_path.stat().st_gid)
        done = as_ordinary_user("sweep", "mathieu", "--speeds", "1 2 rad/s", XDG_CACHE_HOME=str(cache))
        assert done.returncode == 0, done.stderr
        assert done.stderr.count("\n") == 1
        assert "Permission denied" in done.stderr
        assert "NumPy is used" in done.stderr
