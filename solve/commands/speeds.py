"""Flags of the commands that go over many speeds, and the progress that a person sees meanwhile."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

import typer

from solve.errors import MissingValueError


@dataclass(frozen=True)
class Speeds:
    """Many speeds of rotation."""

    speeds: Annotated[
        str | None,
        typer.Option(metavar='"A:B:N unit"', help='N speeds from A to B, or a list: "600 900 1200 rpm".'),
    ] = None

    def omegas(self) -> list[float]:
        """Speeds in rad/s. Raises MissingValueError, UnitError, ValueOutOfBoundsError."""
        from solve.units import speeds_in_si

        if self.speeds is None:
            raise MissingValueError('no speeds given; add a range, such as --speeds "100:900:81 rpm"')
        return speeds_in_si(self.speeds)


@contextmanager
def progressing(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """A bar on standard error with the remaining time, where a person looks at it; told the number of
    points done and, if it changes, what they are."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total)
        yield lambda done, what=what: bar.update(task, completed=done, description=what)
