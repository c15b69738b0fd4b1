"""What a file of results holds, whatever its format."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.results.record import plain
from solve.system import PeriodicSystem


class Variable(NamedTuple):
    """A named array: its axis ("phase", "multiplier", …), unit ("" for texts and counts), meaning."""

    axis: str
    values: Array
    unit: str
    meaning: str


@dataclass(frozen=True)
class Contents:
    """columns: the table of .csv. further: what .nc holds besides. arrays: for .npz and .mat.
    metadata: plain data about the whole."""

    columns: Mapping[str, Variable]
    further: Mapping[str, Variable]
    arrays: Mapping[str, Array]
    metadata: Mapping[str, Any]

    @property
    def metadata_text(self) -> str:
        return json.dumps(self.metadata, ensure_ascii=False, allow_nan=False)


def orbit_contents(
    system: PeriodicSystem,
    axes: tuple[Array, Array],
    state: tuple[Array, Array, Array],
    outputs: Mapping[str, Array],
    stability: Contents,
) -> Contents:
    """Beside those of its stability, phase and time (m+1,), state q, q̇, q̈ (n, m+1), outputs (m+1,).

    In .npz and .mat: phase, time (m+1,); q, qd, qdd (n, m+1) with the names `coordinates`;
    output_values (k, m+1) with the names `outputs`; multipliers, exponents (complex); metadata (JSON).
    """
    arrays = {
        **dict(zip(("phase", "time", "q", "qd", "qdd"), (*axes, *state), strict=True)),
        "coordinates": np.array(system.coordinates),
        "outputs": np.array(system.outputs, dtype=str),
        "output_values": np.array([outputs[name] for name in system.outputs]).reshape(-1, len(axes[0])),
        **stability.arrays,
    }
    along = {
        "time": Variable("phase", axes[1], "s", "time"),
        "phase": Variable("phase", axes[0], "rad", "phase of the drive"),
    }
    further = _joined(_rates(system, *state[1:]), stability.columns)
    curves = _joined(along, _curves(system, state[0], outputs))
    _joined(curves, further)
    return Contents(curves, further, arrays, stability.metadata)


def _joined(*parts: Mapping[str, Variable]) -> dict[str, Variable]:
    """The variables of all parts, none lost to another of its name. Raises ValueOutOfBoundsError."""
    joined: dict[str, Variable] = {}
    for part in parts:
        for name, variable in part.items():
            if name in joined:
                raise ValueOutOfBoundsError(
                    f"'{name}' is the name of two quantities ({joined[name].meaning or 'a coordinate'}; "
                    f"{variable.meaning or 'a coordinate'}); give the coordinate or output another"
                )
            joined[name] = variable
    return joined


def stability_contents(multipliers: Array, exponents: Array, metadata: Mapping[str, Any]) -> Contents:
    """Multipliers and exponents."""
    parts = {
        "multiplier_re": (np.real(multipliers), "1", "Floquet multiplier, real part"),
        "multiplier_im": (np.imag(multipliers), "1", "Floquet multiplier, imaginary part"),
        "exponent_re": (np.real(exponents), "1/s", "Floquet exponent, real part: growth"),
        "exponent_im": (np.imag(exponents), "rad/s", "Floquet exponent, imaginary part"),
    }
    columns = {name: Variable("multiplier", *part) for name, part in parts.items()}
    return Contents(columns, {}, {"multipliers": multipliers, "exponents": exponents}, plain(metadata))


def table_contents(
    columns: Mapping[str, tuple[Sequence[Any], str, str]], metadata: Mapping[str, Any]
) -> Contents:
    """Columns of a table by name: values, unit, meaning."""
    made = {
        name: Variable("row", np.array(values), unit, meaning)
        for name, (values, unit, meaning) in columns.items()
    }
    return Contents(made, {}, {name: column.values for name, column in made.items()}, plain(metadata))


def rows_contents(
    rows: Sequence[Mapping[str, Any]],
    columns: Mapping[str, tuple[Any, str, str]],
    metadata: Mapping[str, Any],
) -> Contents:
    """Rows of a table; columns by name: what stands where a row has None, unit, meaning."""
    made = {
        name: ([missing if row[name] is None else row[name] for row in rows], unit, meaning)
        for name, (missing, unit, meaning) in columns.items()
    }
    return table_contents(made, metadata)


def _curves(system: PeriodicSystem, q: Array, outputs: Mapping[str, Array]) -> dict[str, Variable]:
    return {
        name: Variable("phase", values, system.units.get(name, ""), system.meanings.get(name, ""))
        for name, values in (*zip(system.coordinates, q, strict=True), *outputs.items())
    }


def _rates(system: PeriodicSystem, qd: Array, qdd: Array) -> dict[str, Variable]:
    rates = {}
    for suffix, word, per, values in (("d", "velocity", "/s", qd), ("dd", "acceleration", "/s^2", qdd)):
        for name, row in zip(system.coordinates, values, strict=True):
            unit = system.units.get(name, "")
            rates[name + suffix] = Variable("phase", row, unit and unit + per, f"{word} of {name}")
    return rates
