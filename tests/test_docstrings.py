"""Docstrings of the public names and of the classes that they return: all sections, in numpydoc's order."""

import dataclasses
import functools
import inspect
import typing
from collections.abc import Iterator

import pytest

import derive
import solve

validation = pytest.importorskip("numpydoc.validate")
ClassDoc = pytest.importorskip("numpydoc.docscrape").ClassDoc

CHECKED = {
    *("GL06", "GL07", "GL08"),  # Unknown sections, their order, and missing docstrings.
    *("SS03", "SS04"),  # Form of the summary.
    *("PR01", "PR02", "PR03", "PR04", "PR05", "PR07", "PR10"),  # Parameters.
    *("RT01", "RT03", "YD01"),  # Returned values.
}
"""Codes of numpydoc's checks (numpydoc.readthedocs.io, "Validation"), without those of layout and of sections
that are not always needed (See Also, Examples, extended summary)."""


def public() -> Iterator[tuple[str, object]]:
    """Return the full names of the public functions and classes."""
    for package in (solve, derive):
        for name in sorted(set(package.__all__)):
            about = getattr(package, name)
            if (about.__module__ or "").split(".")[0] in ("derive", "solve"):
                yield f"{about.__module__}.{about.__qualname__}", about


NAMES = dict(public())
FUNCTIONS = {name: about for name, about in NAMES.items() if inspect.isfunction(about)}


def faults(name: str) -> list[tuple[str, str]]:
    return [(code, text) for code, text in validation.validate(name)["errors"] if code in CHECKED]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_document_every_parameter_and_the_result(name):
    assert not faults(name)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_name_their_errors_in_a_section(name):
    text = inspect.getdoc(FUNCTIONS[name])
    assert "Raises\n------\n" in text or "raise " not in inspect.getsource(FUNCTIONS[name])


def returned() -> dict[str, type]:
    """Return the classes of the results of public functions, and the public classes."""
    classes = {name: about for name, about in NAMES.items() if inspect.isclass(about)}
    for function in FUNCTIONS.values():
        result = typing.get_type_hints(function).get("return")
        for kind in (result, *typing.get_args(result)):
            if inspect.isclass(kind) and kind.__module__.startswith(("solve.", "derive.")):
                classes[f"{kind.__module__}.{kind.__qualname__}"] = kind
    return classes


CLASSES = returned()


def described(about: type) -> list[list[str]]:
    """Return the names of each entry in the sections Parameters and Attributes of a class."""
    document = ClassDoc(about)
    entries = [*document["Parameters"], *document["Attributes"]]
    return [[name.strip() for name in entry.name.split(",")] for entry in entries]


@pytest.mark.parametrize("name", CLASSES)
def test_classes_describe_their_fields_in_order(name):
    about = CLASSES[name]
    if not (dataclasses.is_dataclass(about) or issubclass(about, tuple)):
        # A constructor that is inherited is described where it is defined.
        inherited = ["PR01"] if "__init__" not in vars(about) else []
        assert not [fault for fault in faults(name) if fault[0] not in inherited]
        return
    assert not [fault for fault in faults(name) if fault[0] not in ("PR01", "PR03", "PR04")]
    bases = [kind for kind in about.__mro__ if kind.__module__.startswith(("solve.", "derive."))]
    names = {field for kind in bases for entry in described(kind) for field in entry}
    own = [field for field in vars(about).get("__annotations__", {}) if not field.startswith("_")]
    assert [field for field in own if field not in names] == []
    places = [own.index(first) for first, *_ in described(about) if first in own]
    assert places == sorted(places)


@pytest.mark.parametrize("name", CLASSES)
def test_members_of_classes_have_docstrings(name):
    """Members that override a member of a base class inherit its docstring."""
    bare = [
        member
        for member, value in vars(CLASSES[name]).items()
        if not member.startswith("_")
        and (inspect.isfunction(value) or isinstance(value, property | functools.cached_property))
        and not inspect.getdoc(getattr(CLASSES[name], member))
    ]
    assert not bare
