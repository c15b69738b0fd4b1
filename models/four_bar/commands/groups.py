"""Flags that commands on the elastic four-bar share."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from solve.commands.groups import Problem

if TYPE_CHECKING:
    from solve.structure.model import StructureModel


@dataclass(frozen=True)
class FourBar:
    """The four-bar with its numbers."""

    case: Annotated[
        str | None, typer.Option(metavar="NAME", help="Case of the case file; the first by default.")
    ] = None
    cases: Annotated[str | None, typer.Option(metavar="FILE", help="Another case file (.toml).")] = None
    set: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=NUMBER", help="Set a parameter, in SI units; repeatable."),
    ] = None
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Choose an option of the model; repeatable."),
    ] = None

    def loaded(self) -> "StructureModel":
        """The model. Raises SolveError subclasses for bad input."""
        from solve.structure.model import StructureModel

        model, _ = self.problem.loaded()
        assert isinstance(model, StructureModel)
        return model

    @property
    def problem(self) -> Problem:
        """The same for any model's commands."""
        return Problem("four_bar", **vars(self))
