"""System of a functional mock-up unit (FMU). The motion of the unit is computed at each speed at which the
system is used."""

from collections.abc import Callable, Sequence

from solve.arrays import Array
from solve.capabilities import Validity
from solve.first_order import FirstOrderSystem
from solve.readers.sampled import OfSource, SampledStates, Source

_MOST_SPEEDS = 256
"""Largest number of speeds whose matrices are cached. Chosen by judgement: for ten states, they require a few
hundred MB."""


class UnitSystem(OfSource, FirstOrderSystem, Validity):
    """Equations of small deviations of an FMU from its periodic motion, at any speed.

    Parameters
    ----------
    linearised : callable
        Function of a speed in rad/s that returns the linearisation, and whether its azimuths resolve the
        matrices.
    states : sequence of str
        Names of the states.
    signals : tuple
        Names of the inputs, and names of the outputs.
    period : float
        Period in phase.
    source : Source
        Name, title and speed of the FMU.
    """

    def __init__(
        self,
        linearised: Callable[[float], tuple[SampledStates, bool]],
        states: Sequence[str],
        signals: tuple[Sequence[str], Sequence[str]],
        period: float,
        source: Source,
    ):
        super().__init__(self._matrices_at, states, period, (), *signals)
        self.linearised = linearised
        self._kept: dict[float, tuple[SampledStates, bool]] = {}
        self.of_source(source)

    def at_speed(self, speed: float) -> SampledStates:
        """Linearisation at a speed in rad/s. Raises FileError if no periodic motion is found."""
        return self._at(speed)[0]

    def _at(self, speed: float) -> tuple[SampledStates, bool]:
        if speed not in self._kept:
            while len(self._kept) >= _MOST_SPEEDS:
                del self._kept[next(iter(self._kept))]
            self._kept[speed] = self.linearised(speed)
        return self._kept[speed]

    def _matrices_at(self, phase: Array, speed: float) -> list[Array]:
        return self.at_speed(float(speed)).equations_at(phase, speed)

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        found = super().warnings(speed, linear)
        frequency_range, is_resolved = self._at(speed)
        if not is_resolved:
            count = len(frequency_range.source.operating_points[frequency_range.states[0]])
            found.append(f"{count} azimuths do not resolve the harmonics of the matrices along the motion")
        return found
