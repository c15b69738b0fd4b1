"""Engines: compiled code (if the machine has a C compiler) and NumPy."""

from solve.errors import SolveError, UnknownNameError
from solve.kernel.library import INSTEAD, trouble

AUTO, COMPILED, NUMPY = ENGINES = ("auto", "compiled", "numpy")


class EngineError(SolveError):
    """Raised if the compiled engine is not available."""


def chosen_engine(name: str) -> tuple[str, list[str]]:
    """Return the engine for a name, COMPILED or NUMPY, and notes about the selection.

    Raises UnknownNameError, and EngineError if "compiled" is not available."""
    if name not in ENGINES:
        raise UnknownNameError("engine", str(name), ENGINES)
    if name == NUMPY:
        return NUMPY, []
    obstacle = trouble()
    if not obstacle:
        return COMPILED, []
    if name == COMPILED:
        raise EngineError(f"{obstacle}; omit the engine to use NumPy")
    return NUMPY, [f"{obstacle}; {INSTEAD}"]
