"""Which engine solves: compiled lanes where the machine has a C compiler, NumPy elsewhere."""

from functools import lru_cache

from solve.batch.level import Engine, NumpyEngine
from solve.errors import SolveError, UnknownNameError
from solve.kernel.compiler import CompilerError

ENGINES = ("auto", "compiled", "numpy")


class EngineError(SolveError):
    """Compiled code was asked for, and cannot be had."""


def chosen_engine(name: str) -> tuple[Engine, list[str]]:
    """The engine of a name, and what the caller should know about the choice.

    Raises UnknownNameError, and EngineError where "compiled" is asked for in vain.
    """
    if name not in ENGINES:
        raise UnknownNameError("engine", name, ENGINES)
    if name == "numpy":
        return NumpyEngine(), []
    engine, trouble = _lanes()
    if engine is not None:
        return engine, []
    if name == "compiled":
        raise EngineError(f"{trouble}; leave the engine out to use NumPy")
    return NumpyEngine(), [] if trouble.startswith("no C compiler") else [f"{trouble}; NumPy is used"]


@lru_cache
def _lanes() -> tuple[Engine | None, str]:
    from solve.batch.lanes import LaneEngine

    try:
        return LaneEngine(), ""
    except CompilerError as error:
        return None, str(error)
