"""Statistics of the coordinates and outputs of an orbit."""

from collections.abc import Mapping

import numpy as np

from solve.arrays import Array
from solve.kernel.engines import COMPILED
from solve.period.curve import Curve, PeriodicCurve
from solve.period.quantities import Quantities
from solve.system import PeriodicSystem

_REPEATS, _SAMPLES = 1e-6, 512
"""Tolerance, relative, and number of phases of the comparison between periods of an orbit of several periods:
if they agree, it is an orbit of a single period."""

_A_STEP = 4
"""Phases per step at which outputs of two curves are compared."""


def coordinate_figures(curve: PeriodicCurve, engine: str) -> Array:
    """Statistics (n, 7) of each coordinate of the continuous curve: the fields of `Statistics`."""
    return Quantities(curve[None], np.ones(1), engine=engine).figures()[0]


def compiled_output_figures(
    system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str
) -> Array | None:
    """Statistics (o, 7) of each output at a speed in rad/s from compiled code; None without compiled code."""
    formulas = system.output_formulas() if engine == COMPILED else None
    if formulas is None:
        return None
    formulas = formulas._replace(values=formulas.values[None])
    positions = range(len(system.outputs))
    quantities = Quantities(curve[None], np.array([speed]), None, engine, formulas, positions)
    found = quantities.compiled_figures()
    return None if found is None else found[0, system.n :]


def output_figures(system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str) -> Array:
    """Statistics (o, 7) of each output, from compiled code if available."""
    compiled = compiled_output_figures(system, curve, speed, engine)
    if compiled is not None:
        return compiled

    def outputs(phase: Array, *state: Array) -> Array:
        values = system.output_values(phase[0], speed, *(part[0] for part in state))
        return np.array([[values[name] for name in system.outputs]])

    positions = range(len(system.outputs))
    quantities = Quantities(curve[None], np.array([speed]), outputs, engine, None, positions)
    return quantities.figures()[0, system.n :]


def orbit_figures(system: PeriodicSystem, curve: PeriodicCurve, speed: float, engine: str) -> Array:
    """Statistics (n + o, 7) of the coordinates, then of the outputs."""
    of_coordinates = coordinate_figures(curve, engine)
    if not system.outputs:
        return of_coordinates
    return np.concatenate((of_coordinates, output_figures(system, curve, speed, engine)))


def output_changes(system: PeriodicSystem, speed: float, one: Curve, other: Curve) -> Array:
    """Largest differences (o,) of the outputs between two curves on the same nodes, relative to the largest
    moduli on the other."""
    if not system.outputs:
        return np.zeros(0)
    phase = (other.nodes[:-1, None] + other.h[:, None] * (np.arange(_A_STEP) / _A_STEP)).ravel()
    before, after = (_outputs_at(system, phase, speed, curve) for curve in (one, other))
    changes = ((np.abs(after[name] - before[name]).max(), np.abs(after[name]).max()) for name in after)
    return np.array([change / (largest or 1.0) for change, largest in changes])


def _outputs_at(system: PeriodicSystem, phase: Array, speed: float, curve: Curve) -> Mapping[str, Array]:
    q, v, a = (curve.sampled(_A_STEP, order) for order in range(3))
    return system.output_values(phase, speed, q, speed * v, speed**2 * a)


def repeats_early(curve: PeriodicCurve, periods: int) -> bool:
    """Whether a curve over several periods repeats after one of them."""
    last = float(curve.nodes[-1])
    phase = np.arange(_SAMPLES) * (last / _SAMPLES)
    q, later = curve(phase), curve(phase + last / periods)
    return bool((np.abs(later - q).max(axis=1) <= _REPEATS * np.abs(q).max(axis=1)).all())
