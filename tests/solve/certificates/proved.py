"""Stored proofs of the population, from `python -m tests.benchmarks.proved_population`."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_name("proved.jsonl")

MOST_COORDINATES = 3


@dataclass(frozen=True)
class Proved:
    """Proof of a member: its verdict, centers (2n,) and radii (2n,) of discs that contain its multipliers,
    whether each disc contains only one, and lower and upper bounds of max|q|."""

    verdict: str
    centers: np.ndarray
    radii: np.ndarray
    isolated: np.ndarray
    max_abs: dict[str, tuple[float, float]]


@cache
def proofs() -> dict[int, Proved]:
    """Return the stored proofs as a mapping from the index of a member."""
    made = {}
    for record in map(json.loads, FILE.read_text().splitlines()):
        real, imaginary, radii = np.array(record["multipliers"]).T
        bounds = {name: (low, high) for name, (low, high) in record["max_abs"].items()}
        made[record["index"]] = Proved(
            record["verdict"], real + 1j * imaginary, radii, np.array(record["isolated"]), bounds
        )
    return made
