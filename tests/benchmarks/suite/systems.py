"""The systems of `systems.json`: matrices as Fourier series in the phase, and the exact results.

M q̈ + C q̇ + K q = d over the phase φ = Ωt with period 2π; each of M, C, K, d is the sum of
A cos kφ + B sin kφ over its rows [k, A, B]. All numbers are the doubles nearest to the printed decimals, and
the results belong to exactly these doubles.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solve.arrays import Array

FILE = Path(__file__).parent / "systems.json"
NAMES = ("M", "C", "K", "d")


@dataclass(frozen=True)
class FourierSystem:
    """One system with its results: `speed` Ω in rad/s, `multipliers` (2n,) in descending order of modulus,
    and `state` (2n,), q and q̇ at φ = 0."""

    name: str
    about: str
    speed: float
    series: dict[str, list[tuple[int, Array, Array]]]
    multipliers: Array
    state: Array

    @property
    def n(self) -> int:
        return len(self.series["M"][0][1])

    def matrices(self, phase: Array, speed: float) -> tuple[Array, ...]:
        """Return M, C, K (m, n, n) and d (m, n) at phases (m,) for `solve.PeriodicSystem`."""
        return tuple(_sum(self.series[name], np.asarray(phase)) for name in NAMES)

    def rate(self, phase: float, states: Array) -> Array:
        """dx/dφ (2n, c) of states x = (q, q̇), all but the last column without the load d."""
        M, C, K, d = (values[0] for values in self.matrices(np.array([phase]), self.speed))
        q, v = states[: self.n], states[self.n :]
        force = -C @ v - K @ q
        force[:, -1] += d
        return np.concatenate((v, np.linalg.solve(M, force))) / self.speed


def _sum(series: list[tuple[int, Array, Array]], phase: Array) -> Array:
    return sum(
        np.multiply.outer(np.cos(k * phase), A) + np.multiply.outer(np.sin(k * phase), B)
        for k, A, B in series
    )


def load(path: Path = FILE) -> list[FourierSystem]:
    """Return all systems of a file in this format."""
    systems = []
    for record in json.loads(path.read_text(encoding="utf-8"))["systems"]:
        series = {
            name: [(k, np.array(A, dtype=float), np.array(B, dtype=float)) for k, A, B in record[name]]
            for name in NAMES
        }
        multipliers = np.array([complex(float(re), float(im)) for re, im in record["multipliers"]])
        state = np.array([float(number) for number in record["state"]])
        systems.append(
            FourierSystem(record["name"], record["about"], record["speed"], series, multipliers, state)
        )
    return systems
