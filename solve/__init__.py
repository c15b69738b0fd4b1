"""Periodic solutions, stability, studies and figures of linear systems with periodic coefficients.

Public names are listed in `__init__.pyi`. Their modules are imported at the first use: a command imports
only what it runs.
"""

from lazy_loader import attach_stub

_imported, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    if name in __all__:
        return _imported(name)
    raise AttributeError(f"module 'solve' has no attribute '{name}'; it has {', '.join(__all__)}")
