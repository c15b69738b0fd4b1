"""Fixtures: an empty cache of compiled code, and other vector widths."""

import platform

import pytest

from solve.kernel import compiler, library

LACKING = {8: (), 4: ("-mno-avx512f",), 2: ("-mno-avx512f", "-mno-avx")}
"""Flags of the compiler under which registers hold so many numbers, or less."""


@pytest.fixture
def nothing_remembered():
    """Forget the compilers and libraries of this process, before and after the test."""

    def forget():
        libraries = library.library, library.trouble, library.available, library.loaded
        for remembered in (compiler.c_compiler, *libraries):
            remembered.cache_clear()

    forget()
    yield
    forget()


@pytest.fixture
def own_cache(tmp_path, nothing_remembered, monkeypatch):
    """Empty cache of compiled code; earlier compilers are forgotten."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "parametric-vibration"


@pytest.fixture(params=LACKING)
def width(request, nothing_remembered, monkeypatch):
    """Largest number of values in a vector register. Code is compiled as for a processor with such
    registers."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("flags are those of x86")
    monkeypatch.setattr(compiler, "MACHINE", (*compiler.MACHINE, *LACKING[request.param]))
    return request.param
