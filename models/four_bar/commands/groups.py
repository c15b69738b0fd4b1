"""Flags that commands on the elastic four-bar share."""

from dataclasses import dataclass

from solve.beams.structure import StructureModel
from solve.commands.groups import Numbers


@dataclass(frozen=True)
class FourBar(Numbers):
    """The four-bar with its numbers."""

    def loaded(self) -> StructureModel:
        """The model. Raises SolveError subclasses for bad input."""
        model = StructureModel.of(self.setup("four_bar"))
        model.require_motion()
        return model
