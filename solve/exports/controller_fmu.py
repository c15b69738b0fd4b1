"""Export of a controller as a functional mock-up unit (FMI 3.0, model exchange).

The inputs of the unit are the phase of the drive and the measured quantities; without an observer, the states
take the place of the measured quantities. The outputs of the unit are the inputs of the machine."""

from typing import Any

import numpy as np

from solve.arrays import Array
from solve.exports.controller_code import Tables, controller_name, table_warnings
from solve.exports.fmu import Tools, Unit, Variable, add, begun, require_different_names
from solve.results.controller import Controller


def controller_fmu(result: Controller, samples: int) -> tuple[bytes, list[str]]:
    """Return the FMU, as the bytes of an archive, and warnings.

    Inputs are the phase of the drive and the measured quantities; without an observer, the states take the
    place of the measured quantities. Outputs are the inputs of the machine. States are the estimates, which
    start at 0. Matrices are interpolated linearly between `samples` phases. Raises MissingLibraryError;
    raises ValueOutOfBoundsError if two names are equal."""
    tools, system, period = Tools.found(), result.system, result.system.period
    tables, error = Tables.interpolated(result, samples)
    units, sizes = result.closed.labels.units, _sizes(result)

    drive = Variable("phase", "rad", "phase of the drive", 0.0)
    observer = result.observer
    read = result.states if observer is None else observer.signals
    signals = [Variable(name, units.get(name, ""), "measured", 0.0) for name in read]
    estimates = [
        Variable(f"{name}_hat", units.get(f"{name}_hat", ""), f"estimate of {name}", 0.0, size)
        for name, size in zip(result.states, sizes, strict=False)
    ]
    outputs = [Variable(name, units.get(name, ""), "input of the machine", None) for name in result.signals]
    scalars = [drive, *signals, *estimates, *outputs]
    require_different_names(scalars)
    unit = Unit(
        controller_name(result),
        f"Controller of {system.labels.title}",
        period / result.speed,
        scalars,
        estimates,
    )
    builder = begun(unit.name)
    phi = add(builder, drive, "input")
    y = [add(builder, each, "input") for each in signals]
    x = [add(builder, each, "local") for each in estimates]
    u = [add(builder, each, "output") for each in outputs]
    _add_equations(builder, tables, period, phi, (y, x, u))
    return unit.packed(builder, tools), [*result.warnings, *table_warnings(result, samples, error)]


def _sizes(result: Controller) -> list[float]:
    """Nominal sizes of the estimates: their standard deviations. The list is empty without an observer."""
    if result.observer is None:
        return []
    return [float(np.sqrt(each)) or 1.0 for each in np.diagonal(result.observer.riccati(0.0)[0])]


def _add_equations(
    builder: Any, tables: Tables, period: float, phi: Any, symbols: tuple[list[Any], list[Any], list[Any]]
) -> None:
    """Add the equations u = −K x + f and, for estimates x, x′ = A x + b + L y."""
    import casadi

    y, x, u = symbols
    wrapped = phi - period * casadi.floor(phi / period)

    def at(name: str, array: Array) -> Any:
        """Matrix interpolated at the phase of the FMU."""
        values = array.reshape(len(array), -1)
        shape = (*array.shape[1:], 1)[:2]
        table = casadi.interpolant(name, "linear", [tables.phase.tolist()], values.ravel().tolist())
        return casadi.reshape(table(wrapped), shape[1], shape[0]).T

    states = casadi.vertcat(*(x or y))
    computed = at("f", tables.f) - at("K", tables.K) @ states
    if x:
        rates = at("A", tables.A) @ states + at("b", tables.b) + at("L", tables.L) @ casadi.vertcat(*y)
        for state, rate in zip(x, casadi.vertsplit(rates), strict=True):
            builder.eq(builder.der(state), rate)
    for symbol, value in zip(u, casadi.vertsplit(computed), strict=True):
        builder.eq(symbol, value)
