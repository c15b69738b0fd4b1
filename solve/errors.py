"""Exceptions, one class per cause. Each message states what was given, what is allowed and the remedy."""

import difflib
from collections.abc import Collection, Iterable, Sequence
from typing import Self

MOST_NAMED = 4
"""Maximum number of items that a sentence lists."""

_MOST_NAMES = 12
"""Largest number of known names that a message lists. Chosen by judgement."""


class SolveError(Exception):
    """Base class of all exceptions of this package. Commands print the message in one line and exit with
    status 2."""


class UnknownNameError(SolveError):
    """Raised for an unknown name of a model, case, parameter, option, method, coordinate or output."""

    def __init__(self, kind: str, given: str, allowed: Iterable[str]):
        names = sorted(allowed, key=_natural)
        near = difflib.get_close_matches(given, names, n=1, cutoff=0.5)
        hint = f"did you mean '{near[0]}'?" if near else f"known: {listed(names, _MOST_NAMES) or 'none'}"
        super().__init__(f"unknown {kind} '{given}'; {hint}")


def require_name(kind: str, given: str, allowed: Collection[str]) -> None:
    """Raise UnknownNameError unless `given` is among the allowed names."""
    if given not in allowed:
        raise UnknownNameError(kind, given, allowed)


class ValueOutOfBoundsError(SolveError):
    """Raised for a value outside the bounds of its parameter, option or setting, such as NaN."""


class UnitError(SolveError):
    """Raised if a unit is missing or has the wrong dimension."""


class MissingValueError(SolveError):
    """Raised if neither the user nor the case states the value of a parameter or the speed."""


class CaseFileError(SolveError):
    """Raised if a case file is not valid TOML, or has an invalid key or entry."""


class ModelFileError(SolveError):
    """Raised if a model or its generated code is missing, or if the code is out of date or has been
    edited."""


class MatricesError(SolveError):
    """Raised if matrices have a wrong shape, contain NaN or infinity, or are not periodic, or if M is
    singular."""


class DesiredMotionError(SolveError):
    """Raised if the fundamental motion, or an expression evaluated along it, is not real and finite at some
    phases."""


class StructureError(SolveError):
    """Raised if links do not meet at their joints, or if a structure has no degrees of freedom."""


class NoMotionError(SolveError):
    """Raised if a calculation requires equations of motion, and the model has none."""


class NoVibrationError(SolveError):
    """Raised if a calculation requires vibration, and the mechanism has no coordinates."""


class NoLoadError(SolveError):
    """Raised if a calculation requires forced vibration, which is zero because the system has no load."""


class NoSketchError(SolveError):
    """Raised if a drawing of a system without a sketch is requested."""


class StepsError(SolveError):
    """Raised for an invalid number of steps, and if the steps of a method do not permit a calculation or a
    proof."""


class ResonanceError(SolveError):
    """Raised if a multiplier is +1, so that I - Φ is singular: a periodic solution does not exist or is not
    unique."""


class UnbalancedLoadError(SolveError):
    """Raised if the load has a nonzero mean along an undamped rigid-body mode, so that there is no periodic
    vibration."""


class LinearModelError(SolveError):
    """Raised if a system does not have the equations that a calculation requires, such as nonlinear
    equations."""


class NoDerivativeError(SolveError):
    """Raised if the requested derivative does not exist or is not available."""


class NoOrbitError(SolveError):
    """Raised if Newton's method, continuation and transients do not converge to a periodic solution."""


class ChatterError(SolveError):
    """Raised if a motion passes switches of the equations so often that the events cannot be located."""


class ControlError(SolveError):
    """Raised if a feedback does not exist, because inputs are missing or the Riccati equation has no
    stabilising solution."""


class TransientError(SolveError):
    """Raised if the time integration fails."""


class NoResultError(SolveError):
    """Raised if every point of a study has failed."""


class WorkersError(SolveError):
    """Raised if workers cannot be reached, or end before their work is done."""


class WindowError(SolveError):
    """Raised if the server of the live window does not start."""


class MissingLibraryError(SolveError):
    """Raised if an optional library is required but not installed."""

    @classmethod
    def of_extra(cls, what: str, library: str, extra: str) -> Self:
        """Exception for a missing library that `what` requires. The library is installed by an extra of this
        package."""
        return cls(
            f'{what} requires {library}; install {library} with: pip install "parametric-vibration[{extra}]"'
        )


class FileError(SolveError):
    """Raised if a file cannot be read or written, or if its type is unknown."""


class ResultKindError(FileError):
    """Raised if a file contains a result of a class whose module is not imported."""

    def __init__(self, kind: str, what: str = "it"):
        super().__init__(
            f"{what} contains a result of class {kind}, which no imported module defines; import the "
            "module that defines it first"
        )
        self.kind = kind


class ReopenedError(SolveError):
    """Raised if a calculation requires the equations of a result that was read from a file. Files do not
    contain equations."""


def cause(error: Exception) -> str:
    """Short reason why a file cannot be read.

    >>> cause(FileNotFoundError(2, "No such file or directory"))
    'no such file or directory'
    """
    if isinstance(error, OSError):
        return (error.strerror or "no access").lower()
    if isinstance(error, UnicodeDecodeError):
        return "it is not text in UTF-8"
    return "it is damaged or has another format"


def counted(count: object, one: str, more: str = "") -> str:
    """Number followed by a noun or phrase in the singular or plural. By default, the plural is formed with an
    s.

    >>> counted(1, "point"), counted(0, "point"), counted(1, "mode has", "modes have")
    ('1 point', '0 points', '1 mode has')
    """
    return f"{count} {one if count == 1 else more or one + 's'}"


def _natural(name: str) -> tuple[str, int]:
    digits = name[len(name.rstrip("0123456789")) :]
    return name.removesuffix(digits), int(digits or 0)


def listed(texts: Sequence[str], most: int = MOST_NAMED) -> str:
    """Return a string that lists the first `most` texts, separated by commas, and states the number of the
    remaining ones.

    >>> listed(["a", "b", "c", "d", "e"])
    'a, b, c, d and 1 more'
    """
    more = len(texts) - most
    return ", ".join(texts[:most]) + (f" and {more} more" if more > 0 else "")
