"""An empty cache of compiled code, and other widths of the lanes."""

import pytest

from solve.kernel import compiler, library


@pytest.fixture
def nothing_remembered():
    """Of the compilers and libraries of this process, before and after."""

    def forget():
        libraries = library.library, library.trouble, library.available, library.loaded
        for remembered in (compiler.c_compiler, *libraries):
            remembered.cache_clear()

    forget()
    yield
    forget()


@pytest.fixture
def own_cache(tmp_path, nothing_remembered, monkeypatch):
    """An empty cache, and nothing remembered of earlier compilers."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "parametric-vibration"


@pytest.fixture
def compiled_for(nothing_remembered, monkeypatch):
    """Lets code be compiled as for a processor that lacks something."""
    return lambda *flags: monkeypatch.setattr(compiler, "MACHINE", (*compiler.MACHINE, *flags))
