"""Results as plain data, the keys of `--json`: NaN and infinity become None, complex numbers [re, im]."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from solve.loading import Model
from solve.results.orbit import Orbit, Turn
from solve.results.stability import Stability


def plain(value: Any) -> Any:
    """Python's own numbers, lists and dictionaries.

    >>> plain({"rho": np.array([0.5 + 0.25j]), "error": math.nan})
    {'rho': [[0.5, 0.25]], 'error': None}
    """
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, complex | np.complexfloating):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [plain(item) for item in value]
    return value


def stability_record(result: Stability) -> dict[str, Any]:
    """Of `solve floquet`."""
    further = {"residual": None, "warnings": result.warnings}
    return plain({**problem_record(result), **_verdict(result), **further})


def orbit_record(orbit: Orbit, harmonics: int = 60, quasi_static: bool = False) -> dict[str, Any]:
    """Of `solve periodic`, with `harmonics` amplitudes above the mean for every quantity."""
    record = {
        **problem_record(orbit),
        **_turn(orbit, harmonics),
        **_verdict(orbit),
        "residual": orbit.residual,
        "warnings": orbit.warnings,
    }
    if quasi_static:
        record["quasi_static"] = _turn(orbit.quasi_static, harmonics)
    return plain(record)


def model_record(system: Any) -> dict[str, Any]:
    """Which model, with which numbers; a system of a user's own has neither case nor parameters."""
    known = isinstance(system, Model)
    return {
        "model": system.name,
        "case": system.case if known else None,
        "parameters": dict(system.parameters) if known else {},
        "options": dict(system.options) if known else {},
    }


def problem_record(result: Stability) -> dict[str, Any]:
    """What was solved, and how."""
    return {
        **model_record(result.system),
        "speed": result.speed,
        "period": result.period,
        "method": result.method,
        "steps": result.steps,
    }


def _verdict(result: Stability) -> dict[str, Any]:
    return {
        "multipliers": result.multipliers,
        "unresolved": result.unresolved,
        "exponents": result.exponents,
        "spectral_radius": result.spectral_radius,
        "verdict": result.verdict,
        "stable": result.stable,
        "error_estimate": result.error_estimate._asdict(),
        "distance_from_one": result.distance_from_one,
        "liouville": result.liouville,
        "condition": result.condition,
        "notes": result.notes,
    }


def _turn(turn: Turn, harmonics: int) -> dict[str, Any]:
    system = turn.system
    return {
        "coordinates": {name: _quantity(turn, name, harmonics) for name in system.coordinates},
        "outputs": {name: _quantity(turn, name, harmonics) for name in system.outputs},
    }


def _quantity(turn: Turn, name: str, count: int) -> dict[str, Any]:
    range_ = turn.statistics(name)
    amplitudes, phases = turn.harmonics(name, count)
    return {
        "unit": turn.system.units.get(name, ""),
        "meaning": turn.system.meanings.get(name, ""),
        "max": range_.max,
        "min": range_.min,
        "max_abs": range_.max_abs,
        "mean": range_.mean,
        "rms": range_.rms,
        "max_phase": range_.max_phase,
        "min_phase": range_.min_phase,
        "harmonics": amplitudes,
        "phases": phases,
    }
