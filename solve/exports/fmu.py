"""Export of nonlinear equations as a functional mock-up unit (FMI 3.0, model exchange;
https://fmi-standard.org), by CasADi (J. A. E. Andersson et al., Math. Program. Comput. 11 (2019) 1-36)."""

import shlex
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import chdir
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from solve.arrays import Array
from solve.certify.coefficients import require_load
from solve.errors import MissingLibraryError, NoLoadError, ValueOutOfBoundsError
from solve.exports.c_code import identifier, require_formulas
from solve.exports.state_space import signals
from solve.kernel.compiler import CompilerError, c_compiler
from solve.model.model import Model
from solve.model.sampling import symbol
from solve.newton.orbits import nonlinear
from solve.system import PeriodicSystem
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

_TIME = 1980, 1, 1, 0, 0, 0
"""Fixed time stamp of the files in the archive. Archives with equal contents are then identical."""

_WHAT = "an FMU"

_SAMPLES = 512
"""Number of phases per period at which the magnitudes of the states are sampled. Chosen by judgement."""

_NOMINALS = "nominals[i] = 1;"
"""Code that CasADi 3.8 generates for the nominal sizes of the states. This code is replaced by computed
sizes, because tools scale errors by the nominal sizes."""

_ASSIGNED = "__assign__"
"""Prefix of the internal variables of CasADi."""


class Variable(NamedTuple):
    """Scalar variable of the FMU: name, unit, meaning, start value (None for outputs) and nominal size."""

    name: str
    unit: str
    meaning: str
    start: float | None
    nominal: float = 1.0


class _Variables(NamedTuple):
    """Variables of a model. drive: phase and speed of the drive. inputs: acceleration of the drive, followed
    by the forces."""

    drive: list[Variable]
    coordinates: list[Variable]
    rates: list[Variable]
    inputs: list[Variable]
    parameters: list[Variable]
    outputs: list[Variable]

    @property
    def states(self) -> list[Variable]:
        return [*self.drive, *self.coordinates, *self.rates]


def fmu(system: PeriodicSystem, speed: float) -> tuple[bytes, list[str]]:
    """Return an FMU, as the bytes of an archive, and warnings about its initial orbit.

    States are the phase and the speed of the drive, the coordinates and their rates. They start on the
    periodic orbit of the nonlinear equations at the speed (rad/s). Inputs are the acceleration of the drive
    and a force along each coordinate; an input that is not connected is 0. Parameters are tunable. The
    archive contains the C code and a library for this machine. Jumps of the matrices are events; their phases
    do not follow changes of the parameters.

    Raises LinearModelError for systems without formulas; MissingLibraryError without compiler, headers or
    CasADi 3.8; ValueOutOfBoundsError if two quantities have the same name; and subclasses of SolveError if
    there is no orbit."""
    model = require_formulas(system, _WHAT)
    tools = Tools.found()
    variables, warnings = _variables(model, speed)
    scalars = [variable for group in variables for variable in group]
    require_different_names(scalars)
    unit = Unit(identifier(model), model.labels.title, model.period / speed, scalars, variables.states)
    return unit.packed(_built(model, variables), tools), warnings


class Tools(NamedTuple):
    """Folder with the FMI headers, and command of a C compiler."""

    headers: Path
    compiler: str

    @classmethod
    def found(cls) -> "Tools":
        """Find the tools on this machine. Raises MissingLibraryError."""
        return cls(_headers(), _compiler())


class Unit(NamedTuple):
    """Properties of an FMU: name, description, period in s, all scalar variables, and the variables that are
    states."""

    name: str
    title: str
    period: float
    scalars: Sequence[Variable]
    states: Sequence[Variable]

    def packed(self, builder: Any, tools: Tools) -> bytes:
        """Bytes of the FMU archive for the equations in a `casadi.DaeBuilder`."""
        # CasADi writes into the current folder.
        with TemporaryDirectory() as folder, chdir(folder):
            files = _compiled(builder, self, tools)
            description = Path("modelDescription.xml")
            description.write_bytes(_described(description.read_bytes(), self))
            return _packed(files)


def _headers() -> Path:
    """Folder with the FMI headers. Raises MissingLibraryError."""
    try:
        import fmpy
    except ImportError:
        raise MissingLibraryError.of_extra(_WHAT, "fmpy", "fmu") from None
    return Path(fmpy.__file__).parent / "c-code"


def _compiler() -> str:
    import casadi

    if not hasattr(casadi.DaeBuilder, "compile_fmu"):
        raise MissingLibraryError.of_extra(_WHAT, "CasADi 3.8", "fmu")
    try:
        return shlex.join(c_compiler().command)
    except CompilerError as reason:
        raise MissingLibraryError(f"{_WHAT} requires a C compiler: {reason}; install a C compiler") from None


def _variables(model: Model, speed: float) -> tuple[_Variables, list[str]]:
    """Return the variables with start values, and warnings about the orbit that provides the start values."""
    n, names = model.n, signals(model)
    state, sizes, warnings = _start(model, speed)
    meanings = [model.labels.meanings.get(name, "") for name in model.coordinates]
    rate_meanings = [f"rate of {name}" for name in model.coordinates]
    force_meanings = [f"force along {name}" for name in model.coordinates]
    columns = names.states, names.state_units, [*meanings, *rate_meanings], state.tolist(), sizes.tolist()
    states = [Variable(*fields) for fields in zip(*columns, strict=True)]
    inputs = zip(names.inputs, names.input_units, force_meanings, strict=True)
    forces = [Variable(*fields, 0.0) for fields in inputs]
    drive = [
        Variable("phase", "rad", "phase of the drive", 0.0, model.period),
        Variable("speed", "rad/s", "speed of the drive", float(speed), float(speed)),
    ]
    acceleration = Variable("acceleration", "rad/s^2", "acceleration of the drive", 0.0)
    parameters = [
        Variable(name, *model.labels.parameter_labels[name], value)
        for name, value in model.parameters.items()
    ]
    outputs = [
        Variable(name, model.labels.units[name], model.labels.meanings[name], None) for name in model.outputs
    ]
    variables = _Variables(drive, states[:n], states[n:], [acceleration, *forces], parameters, outputs)
    return variables, warnings


def _start(model: Model, speed: float) -> tuple[Array, Array, list[str]]:
    """Return the initial q and q̇ (2n,) on the periodic orbit at phase 0, their largest moduli (2n,) on the
    orbit, and warnings. Without a load, the state is zero and the moduli are one."""
    try:
        require_load(model, speed)
    except NoLoadError as reason:
        return np.zeros(2 * model.n), np.ones(2 * model.n), [f"{reason}; the FMU starts at rest"]
    orbit = nonlinear(model, speed)
    q, qd, _ = orbit.state(np.linspace(0.0, model.period, _SAMPLES))
    states = np.concatenate((q, qd))
    sizes = np.abs(states).max(axis=1)
    return states[:, 0], np.where(sizes > 0, sizes, 1.0), list(orbit.warnings)


def require_different_names(variables: Sequence[Variable]) -> None:
    """Raise ValueOutOfBoundsError if two variables have the same name."""
    names = ["time", *(variable.name for variable in variables)]
    duplicates = sorted({name for name in names if names.count(name) > 1})
    if duplicates:
        raise ValueOutOfBoundsError(
            f"'{duplicates[0]}' would be the name of two variables of the FMU; rename the coordinate, output "
            "or parameter of the mechanism"
        )


def begun(name: str) -> Any:
    """Builder of an FMU. Its only variable is the time."""
    import casadi

    builder = casadi.DaeBuilder(name)
    builder.add("time", "independent", "continuous", {"unit": "s"})
    return builder


def add(builder: Any, variable: Variable, causality: str, variability: str = "continuous") -> Any:
    """Add a variable to a builder and return its symbol."""
    start = {} if variable.start is None else {"start": variable.start}
    attributes = {"unit": _unit(variable.unit), "description": variable.meaning, **start}
    return builder.add(variable.name, causality, variability, attributes)


def _built(model: Model, variables: _Variables) -> Any:
    """Builder with the equations of a model."""
    import casadi

    builder = begun(identifier(model))
    coordinates = {variable.name for variable in variables.coordinates}

    def added(variable: Variable) -> Any:
        causality = "output" if variable.name in coordinates or variable.start is None else "local"
        causality = "input" if variable in variables.inputs else causality
        kind = ("parameter", "tunable") if variable in variables.parameters else (causality,)
        return add(builder, variable, *kind)

    drive, q, qd, inputs, p, outputs = (list(map(added, group)) for group in variables)
    rates, values = _explicit(model)(*drive, *(casadi.vertcat(*group) for group in (q, qd, inputs, p)))
    states = [*drive, *q, *qd]
    for state, rate in zip(states, casadi.vertsplit(rates), strict=True):
        builder.eq(builder.der(state), rate)
    for output, value in zip(outputs, casadi.vertsplit(values) if outputs else (), strict=True):
        builder.eq(output, value)
    for jump in model.breaks:
        # The event indicator crosses zero downwards at the jump. The integrator restarts there.
        builder.when(-casadi.sin(2 * np.pi / model.period * (drive[0] - jump)) < 0, [])
    return builder


def _compiled(builder: Any, unit: Unit, tools: Tools) -> Mapping[str, str]:
    """Write the files of the FMU to the current folder. Return a mapping from these files to their paths in
    the archive."""
    files = builder.export_fmu({"no_warning": True, "with_serialization": False})
    # The library is linked to libm, because the importing tool may not have loaded libm.
    options = {
        "compiler": tools.compiler,
        "linker": tools.compiler,
        "flags": ["-O2", "-w"],
        "linker_flags": ["-lm"],
    }
    if unit.states:
        _with_nominals(Path(f"{unit.name}_wrap.c"), unit.states)
    try:
        return builder.compile_fmu(files, {"compiler_options": options, "include_dirs": [str(tools.headers)]})
    except RuntimeError as error:
        raise MissingLibraryError(
            f"{_WHAT} requires a C compiler, and '{tools.compiler}' failed; see its messages above"
        ) from error


def _with_nominals(wrapper: Path, states: Sequence[Variable]) -> None:
    sizes = ", ".join(repr(state.nominal) for state in states)
    nominals = f"{{ static const double sizes[] = {{{sizes}}}; nominals[i] = sizes[i]; }}"
    wrapper.write_text(wrapper.read_text("utf-8").replace(_NOMINALS, nominals), "utf-8")


@symbolic
def _explicit(model: Model) -> "casadi.Function":
    """Return a function of phase, speed, q, q̇, inputs and parameters. The function returns the outputs and
    the time derivatives of the states. The accelerations follow from M q̈ = u - r(q̈ = 0)."""
    import casadi

    n = model.n
    sizes = {"phase": 1, "speed": 1, "q": n, "qd": n, "u": n + 1, "p": len(model.parameters)}
    symbols = {name: symbol(name, size) for name, size in sizes.items()}
    phase, speed, q, qd, u, p = symbols.values()
    a = symbol("a", n)
    drive = [phase, speed, u[0]]
    (r,) = model.setup.function("residual_varying").call([*drive, q, qd, a, p], True, False)
    M, remainder = casadi.jacobian(r, a), casadi.substitute(r, a, 0)
    qdd = casadi.solve(M, u[1:] - remainder)
    values = casadi.SX(0, 1)
    if model.outputs:
        outputs = model.setup.function("outputs_varying").call([*drive, q, qd, qdd, p], True, False)
        values = casadi.vertcat(*outputs)
    rates = casadi.vertcat(speed, u[0], qd, qdd)
    return casadi.Function("explicit", list(symbols.values()), [casadi.cse(rates), casadi.cse(values)])


def _described(content: bytes, unit: Unit) -> bytes:
    """Add units, start values of the states and the period to the model description written by CasADi."""
    root = ET.fromstring(content)
    root.set("description", unit.title)
    root.set("generationTool", "parametric-vibration, CasADi")
    scalars, units = unit.scalars, ET.Element("UnitDefinitions")
    for name in sorted({"s", *(_unit(scalar.unit) for scalar in scalars if scalar.unit)}):
        ET.SubElement(units, "Unit", name=name)
    root.insert(1, units)
    stop = repr(unit.period)
    root.insert(2, ET.Element("DefaultExperiment", startTime="0", stopTime=stop, tolerance="1e-8"))
    listed, structure = root.find("ModelVariables"), root.find("ModelStructure")
    assert listed is not None
    assert structure is not None
    starts = {scalar.name: scalar.start for scalar in scalars if scalar.start is not None}
    states = {state.name: state for state in unit.states}
    initialised = set()
    for variable in list(listed):
        name = variable.get("name", "")
        if name.startswith(_ASSIGNED):
            listed.remove(variable)
        elif name in starts:
            # CasADi writes only six digits.
            variable.set("start", repr(starts[name]))
            if name in states:
                variable.set("initial", "exact")
                variable.set("nominal", repr(states[name].nominal))
                initialised.add(variable.get("valueReference"))
    for unknown in structure.findall("InitialUnknown"):
        if unknown.get("valueReference") in initialised:
            structure.remove(unknown)
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True)


def _unit(unit: str) -> str:
    """Unit in the notation of Modelica.

    >>> _unit("kg m^2"), _unit("N m s/rad")
    ('kg.m2', 'N.m.s/rad')
    """
    return unit.replace(" ", ".").replace("^", "")


def _packed(files: Mapping[str, str]) -> bytes:
    """Pack files in the current folder into an archive. `files` maps them to their paths in the archive."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, place in sorted(files.items()):
            entry = zipfile.ZipInfo(place.removeprefix("./"), _TIME)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, Path(file).read_bytes())
    return stream.getvalue()
