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
    """Unknown name of a model, case, parameter, option, method, coordinate or output."""

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
    """Value (possibly NaN or infinite) outside the bounds of its parameter, option or setting."""


class UnitError(SolveError):
    """Missing unit, or unit of the wrong dimension."""


class MissingValueError(SolveError):
    """Missing value of a parameter or of the speed, given neither directly nor in the case."""


class CaseFileError(SolveError):
    """Case file that is not valid TOML, or has an invalid key or entry."""


class ModelFileError(SolveError):
    """Model or generated code that is missing, out of date or edited."""


class MatricesError(SolveError):
    """Matrices of wrong shape, with NaN or infinity, not periodic, or with a singular M."""


class DesiredMotionError(SolveError):
    """Fundamental motion, or expression evaluated along it, that is not real and finite at some phases."""


class StructureError(SolveError):
    """Links that do not meet at their joints, or a structure without degrees of freedom."""


class NoMotionError(SolveError):
    """Equations of motion requested of a model that has none."""


class NoVibrationError(SolveError):
    """Vibration requested of a mechanism without coordinates."""


class NoLoadError(SolveError):
    """Vibration requested of a system without load; the vibration is zero."""


class NoSketchError(SolveError):
    """Drawing requested of a system without a sketch."""


class StepsError(SolveError):
    """Invalid number of steps: too few, or beyond the stability limit of the method."""


class ResonanceError(SolveError):
    """Singular I - Φ because of a multiplier +1: a periodic solution does not exist or is not unique."""


class UnbalancedLoadError(SolveError):
    """Load with a nonzero mean along an undamped rigid-body mode; a periodic vibration does not exist."""


class LinearModelError(SolveError):
    """Nonlinear equations requested of a linear system."""


class NoDerivativeError(SolveError):
    """Quantity or system for which the requested derivative does not exist."""


class NoOrbitError(SolveError):
    """Newton's method, continuation or transients did not converge to a periodic solution."""


class ChatterError(SolveError):
    """Motion that passes switches of the equations so often that the events cannot be located."""


class ControlError(SolveError):
    """Feedback that does not exist, because of missing inputs or because the Riccati equation has no
    stabilising solution."""


class TransientError(SolveError):
    """Failure of the time integration."""


class NoResultError(SolveError):
    """Study in which every point failed."""


class WorkersError(SolveError):
    """Workers that cannot be reached, or that ended before their work was done."""


class WindowError(SolveError):
    """The server of the live window does not start."""


class MissingLibraryError(SolveError):
    """Optional library that is not installed."""

    @classmethod
    def of_extra(cls, what: str, library: str, extra: str) -> Self:
        """Exception for a missing library that `what` requires. The library is installed by an extra of this
        package."""
        return cls(
            f'{what} requires {library}; install {library} with: pip install "parametric-vibration[{extra}]"'
        )


class FileError(SolveError):
    """File that cannot be read or written, or of unknown type."""


class ResultKindError(FileError):
    """File whose result class belongs to a module that is not imported."""

    def __init__(self, kind: str, what: str = "it"):
        super().__init__(
            f"{what} contains a result of class {kind}, which no imported module defines; import the "
            "module that defines it first"
        )
        self.kind = kind


class ReopenedError(SolveError):
    """Calculation requested of a result that was read from a file and has no equations."""


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
