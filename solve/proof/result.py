"""Results of `prove`."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from solve.arguments import matches_annotations
from solve.arrays import Array
from solve.errors import require_name
from solve.period.multipliers import KNOWN_ON_CIRCLE, UNDETERMINED, VERDICTS
from solve.results.contents import FileContents, to_json
from solve.results.files import write_atomic
from solve.results.save import checked_data, writer
from solve.results.serialization import Serializable
from solve.results.stability import Stability


@dataclass(frozen=True)
class ProvedOrbit(Serializable):
    """Region in which nonlinear equations are proved to have exactly one orbit. It surrounds q̄(φ) = Re Σ_k
    c_k exp(2πikφ/T).

    Attributes
    ----------
    harmonics : (n, K+1) complex array
        Coefficients c_k, exact numbers.
    radius : mapping of str to tuple of float
        Mapping from coordinates to bounds on |q − q̄| and on the moduli of its first and second time
        derivatives.
    unique : mapping of str to tuple of float
        Mapping from coordinates to the same quantities for the larger region in which no other orbit exists.
    """

    harmonics: Array
    radius: Mapping[str, tuple[float, ...]]
    unique: Mapping[str, tuple[float, ...]]


@dataclass(frozen=True)
class Proof(Serializable):
    """Enclosures of multipliers and orbit, and the true error of the numerical result.

    Attributes
    ----------
    verdict : str
        "asymptotically stable", "stable", "unstable" or "undetermined".
    multipliers : (2n,) complex array
        Centers of discs that contain the multipliers, in order of decreasing modulus.
    radii : (2n,) array
        Radii of the discs.
    isolated : (2n,) array of bool
        Whether the disc contains only one multiplier. Multipliers that share a disc are listed with the same
        disc.
    spectral_radius : tuple of str
        Lower and upper bound, as decimal numbers.
    max_abs : mapping of str to tuple of float
        Mapping from coordinates to a lower and an upper bound on max|q| over a period; empty without an
        orbit.
    result : Stability
        Numerical result, which is not proved.
    true_error : mapping of str to float
        Bounds on the errors of the numerical result. Errors of multipliers are relative to the spectral
        radius; errors of the orbit, at the steps of the proof, are relative to max|q| and NaN without an
        orbit.
    assumed : str
        Assumptions on the numbers and functions of the model.
    steps : int
        Number of steps of the period.
    seconds : float
        Processor time in s; the time of an executor is not included.
    warnings : tuple of str
        Reasons why statements were not proved, one sentence each.
    orbit : ProvedOrbit or None
        Region in which the nonlinear equations have exactly one orbit.
    """

    verdict: str
    multipliers: Array
    radii: Array
    isolated: Array
    spectral_radius: tuple[str, str]
    max_abs: Mapping[str, tuple[float, float]]
    result: Stability
    true_error: Mapping[str, float]
    assumed: str
    steps: int
    seconds: float
    warnings: tuple[str, ...] = ()
    orbit: ProvedOrbit | None = None

    @property
    def proved(self) -> bool:
        """Whether the verdict is proved."""
        return self.verdict != VERDICTS[UNDETERMINED]

    @property
    def contradicted(self) -> bool:
        """Whether the numerical verdict contradicts the proved one."""
        ordinary, low = self.result.verdict, float(self.spectral_radius[0])
        asymptotically, stable, unstable, _ = VERDICTS
        excluded = {
            asymptotically: (unstable,),
            stable: (asymptotically, unstable),
            # A numerical verdict "stable" permits moduli above 1 by up to the error of the multipliers.
            unstable: (asymptotically, stable) if low > 1 + KNOWN_ON_CIRCLE else (asymptotically,),
        }
        return ordinary in excluded.get(self.verdict, ())

    def file_contents(self) -> FileContents:
        """Contents of the file of the numerical result, with the proof in the metadata."""
        contents = self.result.file_contents()
        return replace(contents, metadata={**contents.metadata, "proof": to_json(self.record)})

    @matches_annotations
    def save(self, path: str | Path) -> None:
        """Write the numerical result with its proof to a file; see `Result.save`. `solve.open` reads .npz and
        .nc."""
        file = checked_data(path)
        write_atomic(file, writer(self, file))

    @matches_annotations
    def statistics(self, name: str) -> tuple[float, float]:
        """Lower and upper bound on max|q| of a coordinate."""
        require_name("coordinate", name, self.max_abs)
        return self.max_abs[name]

    @property
    def record(self) -> dict[str, Any]:
        """Value of the JSON key `proof`."""
        place = self.orbit
        located = {} if place is None else {"radius": _listed(place.radius), "unique": _listed(place.unique)}
        discs = zip(self.multipliers.tolist(), self.radii.tolist(), strict=True)
        return {
            "proved": self.proved,
            "verdict": self.verdict,
            "multipliers": [[center.real, center.imag, radius] for center, radius in discs],
            "isolated": self.isolated.tolist(),
            "spectral_radius": list(self.spectral_radius),
            "assumed": self.assumed,
            "max_abs": {name: list(bounds) for name, bounds in self.max_abs.items()},
            "true_error": dict(self.true_error),
            "seconds": self.seconds,
            **({"orbit": located} if located else {}),
        }


def _listed(bounds: Mapping[str, tuple[float, ...]]) -> dict[str, list[float]]:
    return {name: list(values) for name, values in bounds.items()}
