"""Orbits on which motions from random initial states settle."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from solve.arrays import Array
from solve.errors import counted
from solve.results.contents import Column, Columns, HeaderRows, columns_by_name, digits, peak_columns
from solve.results.result import Result
from solve.results.serialization import stored_property
from solve.results.special_orbits import NonlinearOrbit
from solve.system import PeriodicSystem


@dataclass(frozen=True)
class Scatter(Result):
    """Orbits on which motions from N random initial states settle, from `solve.scatter`.

    Attributes
    ----------
    speed : float
        Speed in rad/s.
    starts : (N, 2n) array
        Initial q and q̇ at phase 0, derivatives with respect to time.
    leads : (N,) array of int
        Index in `orbits` of the orbit on which the motion from each initial state settles; -1 if it does not
        settle.
    orbits : sequence of NonlinearOrbit
        Orbits in descending order of their `shares`.
    seed : int
        Seed of the random initial states.
    turns : int
        Number of periods after which a motion counts as not settled.
    """

    _rows: ClassVar[str] = "orbits_found"
    _title: ClassVar[str] = "Orbits reached from the initial states"

    system: PeriodicSystem
    speed: float
    starts: Array
    leads: Array
    orbits: Sequence[NonlinearOrbit]
    seed: int
    turns: int

    @property
    def shares(self) -> Array:
        """For each orbit: fraction of the initial states from which motions settle on it."""
        return np.array([float((self.leads == number).mean()) for number in range(len(self.orbits))])

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about the result, one sentence each."""
        lost = int((self.leads < 0).sum())
        sentences = [text for orbit in self.orbits for text in orbit.warnings]
        if lost:
            of = f"of {len(self.leads)} motions"
            sentences.append(
                f"{counted(lost, f'{of} does', f'{of} do')} not settle within {counted(self.turns, 'period')}"
            )
        return list(dict.fromkeys(sentences))

    @property
    def summary_values(self) -> dict[str, Any]:
        return {
            "speed": self.speed,
            "starts": len(self.leads),
            "seed": self.seed,
            "not_settled": int((self.leads < 0).sum()),
        }

    def header_rows(self) -> HeaderRows:
        return [("starts", f"{len(self.leads)}, seed {self.seed}")]

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per orbit."""
        shares, orbits = self.shares, self.orbits
        columns = [
            ("share", Column(shares, "1", "fraction of the starts", "share (%)", digits(".3g", 100.0))),
            ("periods", Column([o.periods for o in orbits], "", "periods of the orbit", "periods")),
        ]
        names = self.system.coordinates
        peaks = np.array([[orbit.statistics(name).max_abs for name in names] for orbit in orbits])
        columns += peak_columns(self.system, peaks.reshape(len(orbits), len(names)), len(columns))
        radii = [orbit.spectral_radius for orbit in orbits]
        columns += [
            ("spectral_radius", Column(radii, "1", "spectral radius", "radius", digits(".5g"))),
            ("verdict", Column([orbit.verdict for orbit in orbits], "", "stability", "verdict")),
        ]
        return columns_by_name(columns)
