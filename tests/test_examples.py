"""Python examples on the pages print the output shown on the pages."""

import doctest

import pytest

from tests.pages import DOCS, EVERY

_EXAMPLE = ">>> "
PAGES = [page for page in EVERY if _EXAMPLE in page.read_text("utf-8")]
ELSEWHERE = DOCS / "interfaces.md"
"""It needs further libraries; tests/solve/exports runs it where these are."""


@pytest.mark.parametrize("page", [page for page in PAGES if page != ELSEWHERE], ids=lambda page: page.stem)
def test_examples_print_the_output_on_the_page(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = doctest.testfile(str(page), module_relative=False)
    assert (found.failed, found.attempted) == (0, page.read_text("utf-8").count(_EXAMPLE))
    assert all(written.stat().st_size > 10_000 for written in tmp_path.iterdir())
