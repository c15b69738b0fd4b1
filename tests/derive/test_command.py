"""The command `derive`: writing, checking and printing."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from derive import declarations, freshness, loader

ROOT = Path(__file__).resolve().parents[2]
ROTOR = (Path(__file__).parent / "rotor.py").read_text(encoding="utf-8")


def test_generated_module_is_written_next_to_the_user_file(derive, rotor):
    target = rotor.parent / "generated" / "rotor.py"
    assert derive(rotor) == (0, "", f"wrote {target}\n")
    assert freshness.MARK in target.read_text(encoding="utf-8")
    assert sorted(path.name for path in target.parent.iterdir()) == ["rotor.py"]
    assert derive("--check", rotor) == (0, "", "")
    assert derive("--check", "--full", rotor) == (0, "", "")


def test_out_overrides_the_folder(derive, rotor, tmp_path):
    elsewhere = tmp_path / "a" / "b"
    assert derive(rotor, "--out", elsewhere) == (0, "", f"wrote {elsewhere / 'rotor.py'}\n")
    assert derive("--check", rotor, "--out", elsewhere)[0] == 0
    status, out, _ = derive("--check", rotor)
    assert status == 1
    assert "is stale: it is missing. Run: python -m derive" in out


def test_mechanisms_that_share_a_generated_module_are_refused(derive, rotor, tmp_path):
    other = tmp_path / "other" / rotor.name
    other.parent.mkdir()
    shutil.copy(rotor, other)
    detour = other.parent / ".." / rotor.name
    for given, words in [
        ((rotor, detour), "are the same file, for the generated module"),
        (("gear_pair", "cam", "gear_pair"), "'gear_pair' and 'gear_pair' are the same file"),
        ((rotor, other, "--out", tmp_path / "both"), "are two files, for the generated module"),
    ]:
        status, out, error = derive(*given)
        assert (status, out) == (2, "")
        assert words in error
    assert not list(tmp_path.glob("**/generated"))
    assert derive(rotor, other)[0] == 0


def test_generated_text_is_independent_of_the_folder(derive, rotor, tmp_path, monkeypatch):
    derive(rotor)
    first = (tmp_path / "generated" / "rotor.py").read_bytes()
    monkeypatch.chdir(tmp_path)
    derive("rotor.py", "--out", "other")
    assert (tmp_path / "other" / "rotor.py").read_bytes() == first
    assert str(tmp_path).encode() not in first


def test_check_detects_a_changed_mechanism(derive, rotor):
    derive(rotor)
    rotor.write_text(ROTOR.replace("k * q**2 / 2", "k * q**2"), encoding="utf-8")
    status, out, _ = derive("--check", rotor)
    assert status == 1
    assert f"is stale: the mechanism file has changed since. Run: python -m derive {rotor}" in out
    status, out, _ = derive("--check", "--full", rotor)
    assert status == 1
    assert "\n-            casadi.SX(k),\n+            casadi.SX(2*k),\n" in out


def test_line_endings_are_irrelevant(derive, rotor):
    derive(rotor)
    rotor.write_bytes(ROTOR.replace("\n", "\r\n").encode())
    assert derive("--check", rotor)[0] == 0


def test_full_check_shows_the_difference_of_an_edited_module(derive, rotor):
    derive(rotor)
    target = rotor.parent / "generated" / "rotor.py"
    target.write_text(target.read_text(encoding="utf-8").replace("casadi.SX(k)", "casadi.SX(k + 1)"), "utf-8")
    status, out, _ = derive("--check", rotor)
    assert status == 1
    assert "is stale: the generated text was edited. Run:" in out
    status, out, _ = derive("--check", "--full", rotor)
    assert status == 1
    assert f"--- {target} (present)\n+++ {target} (derived)\n" in out
    assert "\n-            casadi.SX(k + 1),\n+            casadi.SX(k),\n" in out
    assert f"Run: python -m derive {rotor}" in out


def test_full_check_detects_changes_not_covered_by_hashes(derive, rotor):
    """The module has a valid checksum but states another SymPy version."""
    derive(rotor)
    target = rotor.parent / "generated" / "rotor.py"
    text = target.read_text(encoding="utf-8").replace('SYMPY_VERSION = "', 'SYMPY_VERSION = "0.')
    unsealed = re.sub(r'FILE_SHA256 = "\w*"\n', "", text)
    checksum = f'FILE_SHA256 = "{freshness.sha256(unsealed)}"\n'
    target.write_text(re.sub(r'FILE_SHA256 = "\w*"\n', checksum, text), "utf-8")
    assert derive("--check", rotor)[0] == 0
    status, out, _ = derive("--check", "--full", rotor)
    assert status == 1
    assert "it differs from what derive would write" in out


@pytest.mark.parametrize("place", ["Rotor on", "do not edit.", "import math\n", 'NAME = "'])
def test_file_hash_covers_the_whole_file(derive, rotor, place):
    derive(rotor)
    target = rotor.parent / "generated" / "rotor.py"
    text = target.read_text(encoding="utf-8")
    assert place in text
    target.write_text(text.replace(place, f"{place} ", 1), "utf-8")
    status, out, _ = derive("--check", rotor)
    assert (status, "the generated text was edited" in out) == (1, True)


def test_comments_and_docstrings_do_not_change_the_hash():
    source = '"""What."""\n\nx = "# no comment"  # said\n# alone\ny = """kept"""\n"""A field."""\n'
    assert freshness.code(source) == '\nx = "# no comment"\ny = """kept"""\n'
    method = 'class A:\n    """Ω: what."""\n    def f(self):\n        "é"; return f"{1}#"\n'
    assert freshness.code(method) == 'class A:\n    def f(self):\n; return f"{1}#"\n'
    assert freshness.code(source.replace("said", "said so").replace("A field", "Another")) == freshness.code(
        source
    )
    assert freshness.code(source.replace("kept", "changed")) != freshness.code(source)


def test_changed_derive_makes_every_module_out_of_date(derive, rotor, monkeypatch):
    derive(rotor)
    monkeypatch.setattr(freshness, "derive_sha256", lambda: "0" * 64)
    status, out, _ = derive("--check", rotor)
    assert status == 1
    assert "derive itself has changed since" in out


def test_foreign_files_are_not_overwritten(derive, rotor):
    target = rotor.parent / "generated" / "rotor.py"
    target.parent.mkdir()
    target.write_text("precious = 1\n", encoding="utf-8")
    status, out, err = derive(rotor)
    assert (status, out) == (2, "")
    assert (
        err == f"derive: {target} was not generated by derive and is not overwritten; "
        "move it, or give --out DIR\n"
    )
    assert target.read_text(encoding="utf-8") == "precious = 1\n"
    status, out, _ = derive("--check", rotor)
    assert status == 1
    assert "it is not a generated module" in out


@pytest.mark.parametrize("broken", ["write", "replace"])
def test_interrupted_write_keeps_the_old_module(derive, rotor, monkeypatch, broken):
    derive(rotor)
    target = rotor.parent / "generated" / "rotor.py"
    before = target.read_bytes()
    rotor.write_text(ROTOR.replace("Rotor on", "Wheel on"), encoding="utf-8")
    write_text = Path.write_text

    def fails(*_, **__):
        raise OSError(28, "No space left on device")

    def fails_halfway(path, text, **kwargs):
        write_text(path, text[: len(text) // 2], **kwargs)
        fails()

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_text", fails_halfway) if broken == "write" else patch.setattr(
            os, "replace", fails
        )
        status, _, err = derive(rotor)
    assert status == 2
    assert err == f"derive: {target} cannot be written: No space left on device; give --out DIR\n"
    assert target.read_bytes() == before
    assert [path.name for path in target.parent.iterdir()] == ["rotor.py"]


def test_unwritable_folder_is_refused(derive, rotor, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    status, _, err = derive(rotor, "--out", tmp_path / "file")
    assert status == 2
    assert "cannot be written" in err
    assert err.count("\n") == 1


def test_show_prints_latex_and_writes_no_file(derive, rotor):
    status, out, err = derive("--show", rotor)
    assert (status, err) == (0, "")
    assert out.splitlines()[-4:] == ["M = J", "C = 0", "K = k", "d = 0"]
    assert not (rotor.parent / "generated").exists()


def test_equations_of_the_cam_are_printed_as_in_the_chapter(derive):
    _, out, _ = derive("--show", "cam")
    assert "M_{11} = I_1 + (m_2 + m_3) (U')^2\nM_{12} = M_{21} = (m_2 + m_3) U'\n" in out
    assert "C_{11} = c_1 + 2 \\Omega (m_2 + m_3) U' U''\n" in out
    assert "K_{33} = k_3\n" in out
    assert "K_{12}" not in out


def test_show_with_the_numbers_of_a_case(derive):
    """The masses of the chapter's Table 1: m2 + m3 = 28 kg + 50 kg."""
    _, out, _ = derive("--show", "--numbers", "1", "cam")
    assert "M_{11} = 78 (U')^2 + 0.12\nM_{12} = M_{21} = 78 U'\n" in out
    assert "K_{22} = 8.2 \\cdot 10^8\n" in out
    _, out, _ = derive("--show", "gear_pair", "--numbers", "1")
    assert "\\sigma" not in out
    assert "load" not in out


def test_installed_packages_are_not_overwritten(derive, tmp_path, monkeypatch):
    """In an installed package, which has no pyproject.toml, `derive cam` requires --out, but `--check` does
    not."""
    home = tmp_path / "site-packages"
    for folder in ("models/cam", "generated"):
        shutil.copytree(ROOT / folder, home / folder)
    monkeypatch.setattr(loader, "HOME", home)
    before = (home / "generated" / "cam.py").read_bytes()
    for arguments in (["cam"], ["--all"]):
        status, out, err = derive(*arguments)
        assert (status, out) == (2, "")
        assert "belongs to the installed package, whose files are not changed; give --out DIR" in err
    assert (home / "generated" / "cam.py").read_bytes() == before
    assert derive("--check", "cam")[0] == 0
    assert derive("cam", "--out", tmp_path / "mine")[0] == 0
    assert (tmp_path / "mine" / "cam.py").read_bytes() == before


def test_help_and_check_need_no_sympy():
    """SymPy is imported only for a derivation, because its import is slow."""
    code = (
        "import sys; from derive.command import app; "
        "[app(a, standalone_mode=False) for a in (['--help'], ['--check', 'cam'])]; "
        "sys.exit('sympy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True).returncode == 0


def test_folders_called_models_or_derive_are_ignored(rotor, tmp_path):
    """Mechanisms are found in the package, not in the current folder."""
    (tmp_path / "models" / "cam").mkdir(parents=True)
    (tmp_path / "models" / "cam" / "mechanism.py").write_text("raise SystemExit(9)\n", encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "derive", "--check", "cam"]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


def test_users_folder_may_begin_with_the_package_name():
    file, noted = f"{Path(declarations.__file__).parent}d/mine.py", {}
    exec(compile("\n\nnote(noted, 1)", file, "exec"), {"note": declarations.note, "noted": noted})
    assert noted == {1: 3}
