"""Generated modules for the tests, executed in memory or from a file."""

import importlib.util
from pathlib import Path
from types import ModuleType

import casadi
import numpy as np

from derive import Mechanism
from derive.checks import check
from derive.emit import module_text


def module_of(mechanism: Mechanism) -> ModuleType:
    """Execute the generated module of a mechanism and return it."""
    check(mechanism)
    module = ModuleType(mechanism.name)
    exec(module_text(mechanism, "0" * 64, mechanism.name), module.__dict__)
    return module


def module_in(file: Path) -> ModuleType:
    """Execute the generated module in a file and return it."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def values(function: casadi.Function, *inputs) -> list[np.ndarray]:
    """All outputs of a CasADi function as arrays."""
    return [np.array(result) for result in function.call([casadi.DM(each) for each in inputs])]
