"""Which engine solves: compiled code where the machine has a C compiler, NumPy elsewhere."""

from solve.errors import SolveError, UnknownNameError
from solve.kernel.library import INSTEAD, trouble

AUTO, COMPILED, NUMPY = ENGINES = ("auto", "compiled", "numpy")


class EngineError(SolveError):
    """Compiled code was asked for, and cannot be had."""


def chosen_engine(name: str) -> tuple[str, list[str]]:
    """COMPILED or NUMPY for the name of an engine, and what the caller should know about the choice.

    Raises UnknownNameError, and EngineError where "compiled" is asked for in vain.
    """
    if name not in ENGINES:
        raise UnknownNameError("engine", str(name), ENGINES)
    if name == NUMPY:
        return NUMPY, []
    obstacle = trouble()
    if not obstacle:
        return COMPILED, []
    if name == COMPILED:
        raise EngineError(f"{obstacle}; leave the engine out to use NumPy")
    return NUMPY, [f"{obstacle}; {INSTEAD}"]
