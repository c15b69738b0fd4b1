"""What a file of results holds, whatever its format."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.errors import ValueOutOfBoundsError
from solve.results.orbit import Orbit
from solve.results.record import plain, problem_record
from solve.results.stability import Stability


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


def orbit_contents(orbit: Orbit) -> Contents:
    """Time, phase, coordinates, outputs and rates at the nodes; multipliers and exponents.

    In .npz and .mat: phase, time (m+1,); q, qd, qdd (n, m+1) with the names `coordinates`;
    output_values (k, m+1) with the names `outputs`; multipliers, exponents (complex); metadata (JSON).
    """
    outputs = [np.asarray(orbit.outputs[name]) for name in orbit.system.outputs]
    arrays = {
        "phase": orbit.phase,
        "time": orbit.time,
        "q": orbit.q,
        "qd": orbit.qd,
        "qdd": orbit.qdd,
        "coordinates": np.array(orbit.coordinates),
        "outputs": np.array(orbit.system.outputs, dtype=str),
        "output_values": np.array(outputs).reshape(len(outputs), len(orbit.phase)),
        **_stability_arrays(orbit),
    }
    further = _joined(_rates(orbit), _stability_columns(orbit))
    curves = _joined(_axes(orbit), _curves(orbit))
    _joined(curves, further)
    return Contents(curves, further, arrays, _metadata(orbit))


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


def stability_contents(result: Stability) -> Contents:
    """Multipliers and exponents."""
    return Contents(_stability_columns(result), {}, _stability_arrays(result), _metadata(result))


def table_contents(
    columns: Mapping[str, tuple[Sequence[Any], str, str]], metadata: Mapping[str, Any]
) -> Contents:
    """Columns of a table by name: values, unit, meaning."""
    made = {
        name: Variable("row", np.array(values), unit, meaning)
        for name, (values, unit, meaning) in columns.items()
    }
    return Contents(made, {}, {name: column.values for name, column in made.items()}, plain(metadata))


def _axes(orbit: Orbit) -> dict[str, Variable]:
    return {
        "time": Variable("phase", orbit.time, "s", "time"),
        "phase": Variable("phase", orbit.phase, "rad", "phase of the drive"),
    }


def _curves(orbit: Orbit) -> dict[str, Variable]:
    units, meanings = orbit.system.units, orbit.system.meanings
    curves = (*zip(orbit.coordinates, orbit.q, strict=True), *orbit.outputs.items())
    return {
        name: Variable("phase", values, units.get(name, ""), meanings.get(name, ""))
        for name, values in curves
    }


def _rates(orbit: Orbit) -> dict[str, Variable]:
    kinds = (("d", "velocity", "/s", orbit.qd), ("dd", "acceleration", "/s^2", orbit.qdd))
    rates = {}
    for suffix, word, per, values in kinds:
        for name, row in zip(orbit.coordinates, values, strict=True):
            unit = orbit.system.units.get(name, "")
            rates[name + suffix] = Variable("phase", row, unit and unit + per, f"{word} of {name}")
    return rates


def _stability_arrays(result: Stability) -> dict[str, Array]:
    return {"multipliers": result.multipliers, "exponents": result.exponents}


def _stability_columns(result: Stability) -> dict[str, Variable]:
    rho, exponents = result.multipliers, result.exponents
    parts = {
        "multiplier_re": (np.real(rho), "1", "Floquet multiplier, real part"),
        "multiplier_im": (np.imag(rho), "1", "Floquet multiplier, imaginary part"),
        "exponent_re": (np.real(exponents), "1/s", "Floquet exponent, real part: growth"),
        "exponent_im": (np.imag(exponents), "rad/s", "Floquet exponent, imaginary part"),
    }
    return {name: Variable("multiplier", *part) for name, part in parts.items()}


def _metadata(result: Stability) -> dict[str, Any]:
    system = result.system
    return plain(
        {
            **problem_record(result),
            "spectral_radius": result.spectral_radius,
            "verdict": result.verdict,
            "error_estimate": result.error_estimate._asdict(),
            "warnings": result.warnings,
            "units": dict(system.units),
            "meanings": dict(system.meanings),
        }
    )
