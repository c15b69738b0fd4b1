"""Conversion of command-line texts to values of flags."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, get_args

import typer

from solve.errors import MissingValueError, ValueOutOfBoundsError, require_name
from solve.results.files import checked
from solve.units import evenly, quantity, require_size_of_number


def integer(text: str) -> int:
    """Convert the text of a flag to an integer, for Typer."""
    return _read(int, text, "a whole number, such as 60")


def number(text: str) -> float:
    """Convert the text of a flag to a number, for Typer."""
    value = _read(float, text, "a number, such as 1e-6")
    require_size_of_number(f"'{text}'", value)
    return value


def fraction(text: str) -> float:
    """Convert the text of a flag, a number or a percentage, to a fraction, for Typer.

    >>> fraction("5%")
    0.05
    """
    # Typer also passes the default, which is a number.
    number, percent = str(text).removesuffix("%"), str(text).endswith("%")
    return _read(float, number, "a fraction, such as 5% or 0.05") / (100 if percent else 1)


def _read(kind: Callable[[str], Any], text: str, allowed: str) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise typer.BadParameter(f"'{text}' is not {allowed}.") from None


def assignments(flag: str, texts: Sequence[str], form: str = "NAME=VALUE") -> dict[str, str]:
    """Parse strings NAME=VALUE to a mapping. Raises ValueOutOfBoundsError for strings of another form.

    >>> assignments("--option", ["load=constant"])
    {'load': 'constant'}
    """
    values: dict[str, str] = {}
    for text in texts:
        name, equals, value = (piece.strip() for piece in text.partition("="))
        if not (name and equals and value):
            raise ValueOutOfBoundsError(f"{flag} is '{text}'; write {flag} {form}, without spaces")
        if name in values:
            raise ValueOutOfBoundsError(f"{flag} gives {name} twice; give it once")
        values[name] = value
    return values


def require_with(needed: str, is_given: bool, flags: Mapping[str, Any]) -> None:
    """Raise ValueOutOfBoundsError for a flag that has no effect without the flag `needed`.

    `is_given` is True if `needed` is given. `flags` maps each flag to its value, which is None, False or an
    empty list if the flag is absent.

    >>> require_with("--prove", False, {"--digits": None, "--rounded": False})
    """
    for flag, value in flags.items():
        if not is_given and value is not None and value is not False and value != []:
            text = "" if value is True else f" {value[0] if isinstance(value, list) else value}"
            raise ValueOutOfBoundsError(f"{flag}{text} requires {needed}; add it")


def listed(flag: str, text: str) -> list[str]:
    """Parse a string of names separated by commas. Raises ValueOutOfBoundsError for a repeated name.

    >>> listed("--free", "a1, a3")
    ['a1', 'a3']
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueOutOfBoundsError(f"{flag} {name} is given {count} times; give it once")
    return names


def quantities(flag: str, texts: Sequence[str]) -> dict[str, float | str]:
    """Parse strings NAME=NUMBER to a mapping. A value with a unit remains a string.

    >>> quantities("--set", ["k1=8e4", "r=30mm"])
    {'k1': 80000.0, 'r': '30mm'}
    """
    values = {}
    for name, text in assignments(flag, texts, "NAME=NUMBER").items():
        try:
            values[name] = quantity(text)
        except ValueError:
            raise ValueOutOfBoundsError(
                f"{flag} {name}={text}: '{text}' is not a number; write a number in the "
                f"model's unit, such as {flag} {name}=1.5e3, or with a unit after it"
            ) from None
    return values


def points(flag: str, text: str) -> tuple[str, list[float] | list[str]]:
    """Parse a string NAME=A:B:N to the name and N values from A to B, both included. Values with a unit are
    strings.

    >>> points("--over", "L2=0.2:0.6:3")
    ('L2', [0.2, 0.4, 0.6])
    """
    ((name, range_),) = assignments(flag, [text], "NAME=A:B:N").items()
    return name, evenly(range_, f"{flag} {name}")


def spread(ranges: Mapping[str, Sequence[Any]], most: int) -> Iterator[dict[str, Any]]:
    """Yield at most `most` combinations of the values in `ranges`. For one name, the values keep their order;
    for several names, the yielded combinations are spread over all combinations.

    >>> list(spread({"x": [0, 1], "y": [0, 1]}, 3))
    [{'x': 0, 'y': 0}, {'x': 1, 'y': 1}, {'x': 0, 'y': 1}]
    """
    total = math.prod(map(len, ranges.values())) if ranges else 0
    step = 1 if len(ranges) == 1 else round(total * (math.sqrt(5) - 1) / 2)
    while total > 1 and math.gcd(step, total) > 1:
        step += 1
    for k in range(min(total, most)):
        combination, place = {}, k * step % total
        for name, values in ranges.items():
            place, at = divmod(place, len(values))
            combination[name] = values[at]
        yield combination


def out_file(path: str | None, endings: Iterable[str], kind: str, example: str) -> Path:
    """Return the path from --out if it can be written. Raises MissingValueError, FileError."""
    if path is None:
        raise MissingValueError(f"no file given; add one, such as --out {example}")
    return checked(path, endings, kind)


def statistic_name(text: str) -> str:
    """Return the name of a statistic of the modulus over a period, from the string max or rms. Raises
    UnknownNameError."""
    figures = {"max": "max_abs", "rms": "rms"}
    require_name("figure", text, figures)
    return figures[text]


def harmonic_count(count: int | None) -> int:
    """Return the number of harmonics, by default 60. Raises ValueOutOfBoundsError if it is outside 1 …
    10000."""
    if count is None:
        return 60
    if not 1 <= count <= 10_000:
        raise ValueOutOfBoundsError(f"--harmonics is {count}; allowed: 1 … 10000, such as 60")
    return count


class Flag(NamedTuple):
    """Description of a flag for `--help`.

    `form` is the placeholder of the value; None for a Boolean flag. `default` describes a default that is
    chosen later. `read` converts the text of a value that is neither a number nor a string.
    """

    help: str
    form: str | None = None
    default: str | None = None
    read: Callable[[str], Any] | None = None

    def option(self, name: str, kind: Any) -> Any:
        """Return the Typer option for a parameter with this name and type."""
        names = [f"--{name.strip('_').replace('_', '-')}"] if kind is bool else []
        readers = (int, integer), (float, number)
        parser = next((read for number_type, read in readers if _contains(kind, number_type)), None)
        parser = self.read or parser
        shown = self.default or True
        return typer.Option(*names, help=self.help, metavar=self.form, parser=parser, show_default=shown)


def _contains(kind: Any, wanted: type) -> bool:
    """Return whether a type equals `wanted`, or contains it among its arguments."""
    return kind is wanted or any(_contains(argument, wanted) for argument in get_args(kind))
