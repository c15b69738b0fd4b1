"""An empty cache of compiled code."""

import pytest

from solve.kernel import compiler, library


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """An empty cache, and nothing remembered of earlier compilers."""

    def forget():
        for remembered in (compiler._compiler, library.library, library.trouble, library.available):
            remembered.cache_clear()

    forget()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    yield tmp_path / "cache" / "parametric-vibration"
    monkeypatch.undo()
    forget()
