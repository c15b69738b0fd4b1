"""What can go wrong, one class a cause. Each message says what was given, what is allowed and what to do."""

import difflib
from collections.abc import Collection, Iterable
from typing import Self

_MOST_NAMES = 12
"""Of those known that a message lists."""


class SolveError(Exception):
    """Any refusal of this package; the commands print it in one line and exit with status 2."""


class UnknownNameError(SolveError):
    """A model, case, parameter, option, method, coordinate or output that does not exist."""

    def __init__(self, kind: str, given: str, allowed: Iterable[str]):
        names = sorted(allowed, key=_natural)
        near = difflib.get_close_matches(given, names, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"known: {_shortened(names) or 'none'}"
        super().__init__(f"unknown {kind} '{given}'; {hint}")


def require_name(kind: str, given: str, allowed: Collection[str]) -> None:
    """Raise UnknownNameError unless the name is among those allowed."""
    if given not in allowed:
        raise UnknownNameError(kind, given, allowed)


class ValueOutOfBoundsError(SolveError):
    """A number outside what its parameter, option or setting allows, NaN and infinity included."""


class UnitError(SolveError):
    """A number without the unit it needs, or with a unit of another kind."""


class MissingValueError(SolveError):
    """A value that the case must give and does not, the speed among them."""


class CaseFileError(SolveError):
    """A case file that is not TOML, or has a key or a form that cases do not have."""


class ModelFileError(SolveError):
    """A model, or the code generated from it, that is missing, stale or not what its hash says."""


class MatricesError(SolveError):
    """Matrices of wrong shape, with NaN or infinity, not periodic, or with a singular M."""


class DesiredMotionError(SolveError):
    """The fundamental motion, or an expression evaluated along it, is not real and finite at some phases."""


class StructureError(SolveError):
    """Links that do not meet where they should, or that leave a structure nothing to vibrate with."""


class NoMotionError(SolveError):
    """A model that stands still, asked for what only motion has."""


class NoVibrationError(SolveError):
    """A vibration is requested of a mechanism without coordinates."""


class NoLoadError(SolveError):
    """A system that nothing drives, asked for a vibration that would be zero."""


class NoSketchError(SolveError):
    """A system that states nothing of what it looks like, asked for its picture."""


class StepsError(SolveError):
    """A number of steps that the method cannot use: too few, or beyond its stability limit."""


class ResonanceError(SolveError):
    """I - Φ is singular: a multiplier at +1, so that no or no unique periodic solution exists."""


class UnbalancedLoadError(SolveError):
    """The load has a nonzero mean along an undamped rigid-body mode: no periodic vibration exists."""


class LinearModelError(SolveError):
    """A system without nonlinear equations, asked for what needs them."""


class NoDerivativeError(SolveError):
    """A quantity, or a system, that has no derivative by what is asked for."""


class NoOrbitError(SolveError):
    """Newton's iteration, continuation and transients reached no periodic solution."""


class TransientError(SolveError):
    """A motion that the integrator cannot follow."""


class NoResultError(SolveError):
    """None of many points has a result."""


class WorkersError(SolveError):
    """Workers that cannot be reached, or that ended too early."""


class MissingLibraryError(SolveError):
    """A library that a part of the software needs and that is not installed."""

    @classmethod
    def of_extra(cls, what: str, library: str, extra: str) -> Self:
        """The error for a library that an extra of this package installs; `what` needs it."""
        return cls(f'{what} needs {library}; install it with: pip install "parametric-vibration[{extra}]"')


class FileError(SolveError):
    """A file that cannot be read or written, or whose type is unknown."""


class ResultKindError(FileError):
    """A file of a kind of result whose module is not imported."""

    def __init__(self, kind: str, what: str = "it"):
        super().__init__(
            f"{what} holds a {kind}, which no module in use knows; import the model's results first"
        )
        self.kind = kind


class ReopenedError(SolveError):
    """A result that was read from a file, asked for what needs the equations or the solver."""


def cause(error: Exception) -> str:
    """Reason why a file cannot be read.

    >>> cause(FileNotFoundError(2, "No such file or directory"))
    'no such file or directory'
    """
    if isinstance(error, OSError):
        return (error.strerror or "no access").lower()
    if isinstance(error, UnicodeDecodeError):
        return "it is not text in UTF-8"
    return "it is damaged or has another format"


def _natural(name: str) -> tuple[str, int]:
    digits = name[len(name.rstrip("0123456789")) :]
    return name.removesuffix(digits), int(digits or 0)


def _shortened(names: list[str]) -> str:
    more = len(names) - _MOST_NAMES
    return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
