"""Zig's C compiler, used if there is neither GCC nor Clang: results, and libraries for other systems."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest

import solve
from solve.kernel import compiler, library

TARGETS = {
    "x86_64-windows-gnu": b"MZ",
    "aarch64-macos": struct.pack("<II", 0xFEEDFACF, 0x0100000C),
    "x86_64-macos": struct.pack("<II", 0xFEEDFACF, 0x01000007),
    "aarch64-linux-gnu": b"\x7fELF",
}
"""First bytes of a library: PE, Mach-O with the type of the processor, and ELF."""


@pytest.fixture
def without_compilers(own_cache, monkeypatch):
    """Search path without GCC and Clang, and an empty cache."""
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    return own_cache


@pytest.fixture
def zig(without_compilers):
    """Search path with Zig only, and an empty cache."""
    if not compiler.zig():
        pytest.skip("ziglang is not installed; it is in the extra `compiler`")
    return without_compilers


def test_message_about_a_missing_compiler_names_the_extra(without_compilers, monkeypatch):
    monkeypatch.setattr(compiler, "zig", lambda: ())
    remedy = r'pip install "parametric-vibration\[compiler\]" installs one'
    with pytest.raises(compiler.CompilerError, match=rf"no C compiler \(cc, gcc, clang\).*{remedy}"):
        compiler.c_compiler()


def test_other_compilers_come_first(own_cache, monkeypatch):
    monkeypatch.setattr(compiler, "zig", lambda: ("zig", "cc"))
    if library.trouble():
        pytest.skip(library.trouble())
    assert "zig" not in compiler.c_compiler().command


def test_named_compiler_is_never_replaced(without_compilers, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(compiler.CompilerError, match=r"no C compiler \(no-such-compiler\) on this machine$"):
        compiler.c_compiler()


@pytest.mark.parametrize(
    ("macros", "wide"),
    [("__clang__ __AVX512F__", True), ("__GNUC__ __AVX512F__", False), ("__clang__ __ARM_NEON", False)],
)
def test_only_clang_gets_the_vector_width_flag(macros, wide, own_cache, monkeypatch):
    monkeypatch.setenv("CC", "python")
    monkeypatch.setattr(compiler, "_run", lambda command: macros)
    assert ("-mprefer-vector-width=512" in compiler.c_compiler().machine) == wide


@pytest.mark.slow
def test_sweep_compiled_by_zig_matches_numpy(zig):
    assert compiler.c_compiler().command[:1] == compiler.zig()[:1]
    model = solve.load("cam")
    speeds = [31.0, 32.0, 33.0]
    ours, numpy = (solve.sweep(model, speeds, engine=engine) for engine in ("compiled", "numpy"))
    assert (ours.engine, ours.notes) == ("compiled", [])
    for name in model.coordinates:
        np.testing.assert_allclose(ours.figures(name), numpy.figures(name), rtol=1e-7)
    np.testing.assert_allclose(ours.spectral_radius, numpy.spectral_radius, rtol=1e-6)
    assert {file.suffix for file in zig.iterdir()} == {".so", ".sha256"}


@pytest.fixture
def builds(monkeypatch, nothing_remembered):
    """Arguments of every library that a sweep and an orbit of the cam load."""
    used = []

    def recorded(*arguments):
        used.append(arguments)
        return load(*arguments)

    load = compiler.compiled
    monkeypatch.setattr(library, "compiled", recorded)
    if library.trouble():
        pytest.skip(library.trouble())
    cam = solve.load("cam")
    solve.sweep(cam, [31.0, 32.0])
    solve.periodic(cam, 31.0).multipliers  # noqa: B018 - computed on first use
    return used


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_libraries_are_built_for_other_systems(target, builds, zig, monkeypatch):
    # Run-time libraries of other systems take minutes to build: Zig keeps them for the user.
    monkeypatch.setenv("ZIG_GLOBAL_CACHE_DIR", str(Path.home() / ".cache" / "zig"))
    monkeypatch.setattr(compiler, "_SECONDS", 900.0)
    monkeypatch.setattr(compiler, "_NATIVE", (("-target", target),))
    compiler.c_compiler.cache_clear()
    assert len({Path(source).name for source, *_ in builds}) >= 4
    for arguments in builds:
        content = compiler.library_file(*arguments).read_bytes()
        assert content.startswith(TARGETS[target])
        names = exported(content) if content.startswith(b"MZ") else content
        assert functions(arguments[0]) != set()
        for name in functions(arguments[0]):
            assert name in names, (arguments[0], name)


def functions(source):
    """Names of the functions of a C file that are not static, as bytes."""
    text = Path(source).read_text("utf-8")
    return {name.encode() for name in re.findall(r"^(?:int|void|long) (\w+)\(", text, flags=re.MULTILINE)}


def exported(content):
    """Names that a library for Windows exports, from its table in the PE format."""
    (header,) = struct.unpack_from("<I", content, 0x3C)
    count, optional = struct.unpack_from("<H", content, header + 6)[0], header + 24
    size = struct.unpack_from("<H", content, header + 20)[0]
    sections = [
        struct.unpack_from("<8sIIII", content, optional + size + 40 * number) for number in range(count)
    ]

    def place(address):
        """Position in the file of an address in memory."""
        for _, length, start, stored, position in sections:
            if start <= address < start + max(length, stored):
                return address - start + position
        raise LookupError(address)

    # The first data directory of the 64-bit optional header is the table of exports.
    table = place(struct.unpack_from("<I", content, optional + 112)[0])
    number, _, names = struct.unpack_from("<III", content, table + 24)
    pointers = struct.unpack_from(f"<{number}I", content, place(names))
    return {content[place(at) :].split(b"\0", 1)[0] for at in pointers}
