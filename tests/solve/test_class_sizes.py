"""Limits on the number of public members of the classes of `solve`."""

import ast
from pathlib import Path

import solve

MOST = 20
"""Largest number of public members that a class defines itself: a choice of the project."""

EXCEPTIONS = {
    "BranchPoints": "columns of a branch, one per quantity",
    "Controller": "results of regulator, filter and closed loop, most of them promised",
    "Labels": "data that describe a system",
    "Method": "properties of a discretisation, most of which a method does not override",
    "Model": "capabilities of a generated system",
    "StructureModel": "capabilities of a structure of beams",
}
"""Classes above this number."""


def members(definition: ast.ClassDef) -> set[str]:
    """Return the public names that a class defines."""
    names: set[str] = set()
    for statement in definition.body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            names.add(statement.name)
        elif isinstance(statement, ast.Assign):
            names |= {target.id for target in statement.targets if isinstance(target, ast.Name)}
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            names.add(statement.target.id)
    return {name for name in names if not name.startswith("_")}


def test_periodic_system_has_at_most_twelve_public_members():
    """Inherited data and methods are included."""
    system = solve.PeriodicSystem(lambda phase, speed: None, ["q"])
    assert len([name for name in dir(system) if not name.startswith("_")]) <= 12


def test_classes_define_few_members():
    sizes = {
        definition.name: len(members(definition))
        for file in Path(solve.__file__).parent.rglob("*.py")
        for definition in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(definition, ast.ClassDef)
    }
    assert len(sizes) > 100
    large = {name: size for name, size in sizes.items() if size > MOST and name not in EXCEPTIONS}
    assert not large, f"classes with more than {MOST} public members of their own: {large}"
