"""Systems whose matrices were sampled by another program at one speed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solve.arrays import Array
from solve.capabilities import Capabilities, Validity
from solve.errors import FileError
from solve.first_order import FirstOrderSystem, MixedSystem
from solve.labels import Labels
from solve.system import PeriodicSystem

_SAME_SPEED = 1e-3
"""Relative difference from the speed of the samples above which a warning is issued. Files state speeds with
at least four digits."""


@dataclass(frozen=True)
class Source:
    """Origin of samples: the file, its description and the speed.

    Attributes
    ----------
    name : str
        Name of the file, or common name of the files.
    title : str
        Description in the file.
    speed : float or None
        Speed in rad/s at which the matrices were sampled.
    units, meanings : mapping of str to str
        Mappings from coordinates, states and outputs to units and to descriptions.
    rotating : sequence of str
        Names of the states, inputs and outputs in the rotating frame.
    operating_points : mapping of str to (k,) array
        Mapping from states, inputs and outputs to the values at k azimuths about which the matrices were
        linearised.
    """

    name: str
    title: str = ""
    speed: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)
    rotating: Sequence[str] = ()
    operating_points: Mapping[str, Array] = field(default_factory=dict)


class OfSource:
    """Mixin for systems with a source. It adds the labels of the source, and a warning at speeds that differ
    from the speed of the source."""

    source: Source
    labels: Labels

    def of_source(self, source: Source) -> None:
        """Store the source, and set the labels of the system from the source. Raises FileError for an invalid
        speed."""
        if source.speed is not None and not (np.isfinite(source.speed) and source.speed > 0):
            raise FileError(f"{source.name}: speed is {source.speed:g} rad/s; allowed: a finite speed > 0")
        self.source = source
        self.labels = replace(
            self.labels,
            name=source.name,
            title=source.title,
            case_speed=None if source.speed is None else f"{source.speed!r} rad/s",
            units=dict(source.units),
            meanings=dict(source.meanings),
        )

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(validity=self)  # type: ignore[misc]

    def warnings(self, speed: float, linear: bool = True) -> list[str]:
        found = list(self.labels.equation_warnings)
        sampled = self.source.speed
        if sampled is not None and abs(speed - sampled) > _SAME_SPEED * sampled:
            found.append(f"the matrices were sampled at {sampled:.6g} rad/s, not at {speed:.6g} rad/s")
        return found


class SampledSystem(OfSource, PeriodicSystem, Validity):
    """Second-order system from a file."""


class SampledStates(OfSource, FirstOrderSystem, Validity):
    """First-order system from a file."""


class SampledMixed(OfSource, MixedSystem, Validity):
    """System with coordinates and first-order states from a file."""
