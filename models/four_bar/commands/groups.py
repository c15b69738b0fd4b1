"""Flags that commands on the elastic four-bar share."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from solve.commands.groups import Numbers

if TYPE_CHECKING:
    from solve.beams.structure import StructureModel


@dataclass(frozen=True)
class FourBar(Numbers):
    """The four-bar with its numbers."""

    def loaded(self) -> "StructureModel":
        """The model. Raises SolveError subclasses for bad input."""
        from solve.beams.structure import StructureModel

        model = self.of("four_bar")
        assert isinstance(model, StructureModel)
        return model
