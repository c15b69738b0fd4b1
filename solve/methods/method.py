"""What every one-step method of this package offers to the period map."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from solve.arrays import Array
from solve.curve import Curve
from solve.methods.grid import Grid
from solve.methods.period_map import Steps
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Discretisation:
    """A method on a grid.

    steps: the affine maps of its state. curve: from the states at the nodes (m+1, N) to the
    continuous curve of q in the phase.
    """

    steps: Steps
    curve: Callable[[Array], Curve]


class Method(Protocol):
    """A one-step method in phase time: M q″ + C q′ + K q = d with derivatives by the phase."""

    @property
    def name(self) -> str: ...

    @property
    def order(self) -> int:
        """Order of convergence at the nodes."""
        ...

    @property
    def curve_order(self) -> int:
        """Order of convergence of the continuous curve."""
        ...

    @property
    def l_stable(self) -> bool:
        """Whether stiff modes that the steps do not resolve are damped out rather than kept."""
        ...

    def least_steps(self, frozen: Array, period: float) -> int:
        """Steps a period below which the method cannot be stable, from the frozen eigenvalues (k,)
        of the system by phase; 1 where it has no limit."""
        ...

    def concerns(self) -> list[str]:
        """Warnings that the method's own settings deserve."""
        ...

    def discretise(self, system: PeriodicSystem, speed: float, grid: Grid) -> Discretisation: ...
