"""Displays are selected by the class of a result."""

import pkgutil
from importlib import import_module

import pytest

import solve.views
from solve.views import show


@pytest.mark.parametrize("name", ["figure", "waterfall", "tables", "brief"])
def test_module_of_every_display_is_imported_when_required(name):
    for module in pkgutil.iter_modules(solve.views.__path__, "solve.views."):
        import_module(module.name)
    modules = {
        kind.__module__: function.__module__
        for kind, function in getattr(show, name)._selected.registry.items()
        if kind.__module__.startswith("solve.results.") and kind.__name__ != "Result"
    }
    assert modules
    for results, views in modules.items():
        assert views == f"solve.views.{show._VIEWS[results.removeprefix('solve.results.')]}"


def test_notebook_shows_title_and_equations():
    page = solve.load("mathieu")._repr_html_()
    assert page.startswith("<p>Mathieu's equation".replace("'", "&#x27;"))
    assert page.count("<math>") == 4
