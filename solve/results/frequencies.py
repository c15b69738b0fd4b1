"""Natural frequencies at positions of the drive, and versus a parameter."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from solve.arguments import matches_annotations, require_index
from solve.arrays import Array
from solve.contracts import ModeShape
from solve.equations import freedoms_of, structure_of
from solve.errors import counted
from solve.labels import unit_of
from solve.model.bounds import measured
from solve.period.natural import NaturalFrequencies
from solve.results.contents import (
    MOST_SHOWN,
    Column,
    Columns,
    FileContents,
    HeaderRows,
    known,
    model_info,
    to_json,
)
from solve.results.formatting import fixed, headed
from solve.results.result import Result
from solve.results.rigid_body import RigidBodyMode
from solve.results.serialization import stored_property
from solve.system import PeriodicSystem

_MOST_LINKS = 3
"""Maximum number of links in a table that lists the frequencies of single links. Chosen by judgement."""


class Roots(Result):
    """Eigenvalues λ of K v = λ M v as two arrays of the same shape: frequencies, where λ > 0, and growth
    rates, where λ < 0."""

    @property
    def signed(self) -> Array:
        """Signed roots in ascending order of λ: frequencies or, where λ < 0, negated growth rates."""
        return self._roots.signed

    @property
    def _roots(self) -> NaturalFrequencies:
        raise NotImplementedError

    @property
    def _largest(self) -> float:
        """Largest modulus of the roots in tables."""
        return float(np.nanmax(np.abs(self.signed), initial=0.0))

    def text_of(self, root: float) -> str:
        """Text of a signed root: a frequency or, if negative, a growth rate."""
        if root == 0:
            return "0"
        text = fixed(abs(root), self._largest, 6)
        return f"{text}i" if root < 0 else text

    def statistics(self, axis: int) -> dict[str, Array]:
        """Mapping from "mean", "min" and "max" to these statistics of the signed roots along an axis. The
        mean is NaN if frequencies and growth rates occur together."""
        signed = self.signed
        mixed = (signed < 0).any(axis=axis) & ~(signed < 0).all(axis=axis)
        mean = np.where(mixed, np.nan, signed.mean(axis=axis))
        return {"mean": mean, "min": signed.min(axis=axis), "max": signed.max(axis=axis)}


def _roots_of(frequencies: Array, growth_rates: Array | None) -> NaturalFrequencies:
    """Return frequencies and growth rates. Growth rates are missing in files of earlier versions."""
    rates = np.full_like(frequencies, np.nan) if growth_rates is None else growth_rates
    return NaturalFrequencies(frequencies, rates)


def _growing(rows: Roots, positions: str) -> list[str]:
    """Return a list with one sentence, which names the modes that grow in the rows of a result. The list is
    empty if no mode grows."""
    frequencies, rates = rows._roots
    grows = np.isfinite(rates)
    if not grows.any():
        return []
    lost = "symmetric" if np.isfinite(frequencies[grows]).any() else "positive"
    count = np.count_nonzero(grows.reshape(len(grows), -1).any(axis=1))
    highest = int(np.nonzero(grows)[-1].max()) + 1
    where = f" at {count} of {len(grows)} {positions}" if len(grows) > 1 else ""
    named = "mode 1 grows" if highest == 1 else f"modes up to {highest} grow"
    return [
        f"the static stiffness is not {lost}{where}: "
        f"{named} instead of vibrating, at up to {np.nanmax(rates):.4g} 1/s"
    ]


def _vibrating(figures: Mapping[str, Array]) -> dict[str, Array]:
    """Return statistics of signed roots, with NaN in place of growth rates."""
    return {name: np.where(values < 0, np.nan, values) for name, values in figures.items()}


@dataclass(frozen=True)
class Frequencies(Roots):
    """Natural frequencies with the drive held still, from `solve.frequencies`.

    Attributes
    ----------
    positions : (m,) array
        Positions of the drive in rad.
    values : (m, k) array
        Frequencies in rad/s of the first k modes, in ascending order of λ in K v = λ M v; NaN where λ < 0.
    growth_rates : (m, k) array
        Growth rates √−λ in 1/s where λ < 0, otherwise NaN. A mode with complex λ has both a frequency and a
        growth rate.
    rigid_body_modes : sequence of RigidBodyMode
        Rigid-body modes at the first position, with frequency 0.
    """

    system: PeriodicSystem
    positions: Array
    values: Array
    growth_rates: Array | None = None
    rigid_body_modes: Sequence[RigidBodyMode] = ()

    @property
    def _roots(self) -> NaturalFrequencies:
        return _roots_of(self.values, self.growth_rates)

    @property
    def mean(self) -> Array:
        """Means (k,) over the positions; NaN for a mode that grows at any position."""
        return self.values.mean(axis=0)

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom, reduced by the number of constraints of inextensible links."""
        return freedoms_of(self.system)

    @matches_annotations
    def shapes(self, number: int = 0) -> list[ModeShape]:
        """Mode shapes at the position with index `number`. Raises ValueOutOfBoundsError for other indices and
        for systems that are not beam structures."""
        require_index("number", number, len(self.positions))
        return structure_of(self.system).mode_shapes(float(self.positions[number]), self.values[number])

    def texts(self, number: int, form: str, factor: float = 1.0) -> list[str]:
        """Texts of the roots at the position with index `number`: for example 21.5 for λ > 0, 1.73i for λ <
        0, and 21.5±1.73i for complex λ."""
        texts = []
        for omega, rate in zip(*(factor * roots[number] for roots in self._roots), strict=True):
            parts = [
                text
                for value, text in ((omega, f"{omega:{form}}"), (rate, f"{rate:{form}}i"))
                if known(value)
            ]
            texts.append("±".join(parts) or "–")
        return texts

    @property
    def summary_values(self) -> dict[str, Any]:
        """Positions (rad), frequencies (rad/s), growth rates (1/s), and statistics over the positions."""
        frequencies, growth_rates = self._roots
        roots = {"positions": self.positions, "frequencies": frequencies, "growth_rates": growth_rates}
        return {**roots, **_vibrating(self.statistics(0))}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per position."""
        degrees = [f"{angle:.5g}°" for angle in np.degrees(self.positions)]
        columns = {"position": Column(self.positions, "rad", "of the drive", "position", degrees)}
        frequencies, growth_rates = self._roots
        for k, (omegas, rates) in enumerate(zip(frequencies.T, growth_rates.T, strict=True), start=1):
            heading, texts = (
                f"mode {k}" if k <= MOST_SHOWN else "",
                [*map(self.text_of, self.signed[:, k - 1])],
            )
            columns[f"frequency{k}"] = Column(omegas, "rad/s", f"natural frequency {k}", heading, texts)
            if np.isfinite(rates).any():
                columns[f"growth_rate{k}"] = Column(rates, "1/s", f"growth rate of mode {k}")
        return columns


@dataclass(frozen=True)
class Variation(Roots):
    """Natural frequencies versus a parameter, from `solve.frequencies_over`.

    Attributes
    ----------
    parameter, values : str, (v,) array
        Name of the parameter, and its values in its own unit.
    positions : (m,) array
        Positions of the drive in rad.
    frequencies, growth_rates : (v, m, k) array
        Frequencies in rad/s and growth rates in 1/s; see `Frequencies`.
    pinned : dict of str to (v,) array
        Lowest frequency in rad/s of each link as a single beam, pinned at both ends.
    errors : tuple of str or None
        For each value of the parameter: reason why it has no frequencies, or None.
    """

    system: PeriodicSystem
    parameter: str
    values: Array
    positions: Array
    frequencies: Array
    pinned: dict[str, Array]
    errors: tuple[str | None, ...]
    growth_rates: Array | None = None

    @property
    def _roots(self) -> NaturalFrequencies:
        return _roots_of(self.frequencies, self.growth_rates)

    @property
    def figures(self) -> dict[str, Array]:
        """Mapping from "mean", "min" and "max" to these statistics (v, k) of the frequencies over the
        positions; NaN where modes grow."""
        return _vibrating(self.statistics(1))

    @property
    def mean(self) -> Array:
        """Means (v, k) over the positions."""
        return self.figures["mean"]

    @property
    def largest_growth_rates(self) -> Array:
        """Largest growth rates (v, k) over the positions; NaN if the mode does not grow at any position."""
        return np.fmax.reduce(self._roots[1], axis=1)

    @property
    def _largest(self) -> float:
        return float(np.nanmax(np.abs(self.signed[..., self.shown_modes]), initial=0.0))

    @property
    def shown_modes(self) -> list[int]:
        """Indices (from 0) of the lowest mode and of the lowest elastic mode. The lowest elastic mode is the
        first mode whose frequency is nonzero at one or more positions."""
        signed = np.nan_to_num(self.signed).any(axis=(0, 1))
        return sorted({0, int(signed.argmax())})

    @property
    def summary_values(self) -> dict[str, Any]:
        """Parameter, positions (rad) and statistics (rad/s)."""
        over = {"parameter": self.parameter, "values": self.values, "positions": self.positions}
        growing = {"growth_rates": self.largest_growth_rates}
        return {**over, **self.figures, **growing, "pinned": self.pinned, "errors": self.errors}

    @property
    def columns(self) -> Columns:
        """Columns of the table, with one row per value of the parameter."""
        unit, _ = self.system.labels.parameter_labels[self.parameter]
        title = headed(self.parameter, unit_of(self.system, self.parameter).name)
        varied = partial(fixed, magnitude=float(np.abs(self.values).max()), digits=5)
        columns = {self.parameter: Column(self.values, unit, "varied", title, varied)}
        shown, several = self.statistics(1), self.several
        headings = {name: f"{name} ω" for name in ("mean", "min", "max")} if several else {"mean": "ω"}
        for k, (name, values) in itertools.product(range(self.frequencies.shape[2]), self.figures.items()):
            is_shown = k == self.shown_modes[-1] or (k in self.shown_modes and name == "mean")
            heading = f"{headings[name]}{k + 1}" if is_shown and name in headings else ""
            texts = [*map(self.text_of, shown[name][:, k])]
            meaning = f"{name} over the positions"
            columns[f"frequency{k + 1}_{name}"] = Column(values[:, k], "rad/s", meaning, heading, texts)
        for k, rates in enumerate(self.largest_growth_rates.T, start=1):
            if np.isfinite(rates).any():
                columns[f"growth_rate{k}"] = Column(rates, "1/s", "largest over the positions")
        for number, (link, pinned) in enumerate(self.pinned.items()):
            labels = "rad/s", "the link alone, pinned at both ends", f"{link} alone" * (number < _MOST_LINKS)
            columns[f"{link}_pinned"] = Column(pinned, *labels, self.text_of)
        return columns

    @property
    def several(self) -> bool:
        """Whether there are several positions."""
        return len(self.positions) > 1


@dataclass(frozen=True)
class Findings(Result):
    """Natural frequencies and mode shapes at a position and, if requested, frequencies over the revolution
    and versus a parameter. `first` maps each parameter that is given as a range to the first value that the
    model accepts; the frequencies at the position refer to this value."""

    here: Frequencies
    turn: Frequencies | None = None
    variation: Variation | None = None
    shapes: Sequence[ModeShape] = ()
    first: Sequence[str] = ()

    @stored_property
    def warnings(self) -> list[str]:
        """Warnings about growing modes, and about values of the parameter without a result, one sentence
        each."""
        texts = [*self._reduction]
        texts += _growing(self.turn or self.here, "positions")
        if self.variation is not None:
            texts += _growing(self.variation, f"values of {self.variation.parameter}")
            failed = [error for error in self.variation.errors if error is not None]
            if failed:
                of = f"of {len(self.variation.errors)} values"
                texts.append(f"{counted(len(failed), f'{of} has', f'{of} have')} no result: {failed[0]}")
        return texts

    def record(self) -> dict[str, Any]:
        """JSON object of `solve frequencies --json`, in rad/s and rad; parameters in the model's units."""
        first = self.here.summary_values
        here = {"position": self.here.positions[0], "frequencies": first["frequencies"][0]}
        here |= {"growth_rates": first["growth_rates"][0], "rigid_body_modes": self.here.rigid_body_modes}
        further = {
            "turn": self.turn and self.turn.summary_values,
            "over": self.variation and self.variation.summary_values,
            "modes": [self._shape_record(shape) for shape in self.shapes],
        }
        head = {**model_info(self.here.system), "freedoms": self.here.freedoms, **here}
        requested = {name: values for name, values in further.items() if values}
        return to_json({**head, **requested, "warnings": self.warnings})

    def _shape_record(self, shape: ModeShape) -> dict[str, Any]:
        links = {}
        by_link = zip(shape.places, shape.displacements, shape.transverse, strict=True)
        for link, (place, moved, transverse) in zip(self.here.system.labels.links, by_link, strict=True):
            curves = dict(zip(("x", "y", "dx", "dy"), (*place.T, *moved.T), strict=True))
            links[link.name] = {**curves, "transverse": transverse}
        return {"frequency": shape.frequency, "modal_mass": shape.modal_mass, "links": links}

    @property
    def summary(self) -> str:
        """Sentence on the lowest frequencies at the position."""
        where = f" at {math.degrees(self.here.positions[0]):.6g}°" if self.here.system.labels.moves else ""
        omegas, growth_rates = (roots[0] for roots in self.here._roots)
        growing = np.isnan(omegas) & np.isfinite(growth_rates)
        texts = np.array(self.here.texts(0, ".4g", 1 / (2 * math.pi)), dtype=object)[~growing]
        hertz = f"{', '.join(texts)} Hz" if len(texts) else "none"
        rates = ", ".join(f"{rate:.4g}" for rate in growth_rates[growing])
        growth = f" Growth rates: {rates} 1/s." if rates else ""
        return f"The lowest natural frequencies{where}, at standstill: {hertz}.{growth}"

    def header_rows(self) -> HeaderRows:
        place = f"{math.degrees(self.here.positions[0]):.6g}°"
        system = self.system
        values = {
            name: measured(system.labels.parameters[name], system.labels.parameter_labels[name][0])
            for name in self.first
        }
        at = [
            ("at", f"{name}={value}, the first possible value of the range") for name, value in values.items()
        ]
        return [("freedoms", str(self.here.freedoms)), *[("position", place)] * self.system.labels.moves, *at]

    @property
    def system(self) -> PeriodicSystem:  # type: ignore[override]
        return self.here.system

    @property
    def widest(self) -> "Frequencies | Variation":
        """Frequencies for files and figures: the frequencies versus the parameter if they are computed;
        otherwise, the frequencies over the revolution if they are computed; otherwise, the frequencies at the
        position."""
        return self.variation or self.turn or self.here

    def file_contents(self) -> FileContents:
        return self.widest.file_contents()
