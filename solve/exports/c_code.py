"""Export of the generated functions of a model as C code, by CasADi, with a simple wrapper for each
function."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

from solve.equations import is_nonlinear
from solve.errors import FileError, LinearModelError
from solve.labels import require_motion
from solve.model.model import LinearisedModel, Model
from solve.model.sampling import by_rows, inputs_of
from solve.results.contents import versions
from solve.system import PeriodicSystem
from solve.threads import symbolic

if TYPE_CHECKING:
    import casadi

_FUNCTIONS = {
    "linearised": "M q'' + C q' + K q = d, linearised about the fundamental motion q = 0.",
    "residual": "The nonlinear equations of motion, r = 0.",
    "outputs": "Outputs y with the drive at constant speed.",
}
"""Generated functions, and their descriptions in the header."""

_SCALARS = "phase", "speed"

_ARGUMENTS = "Phase in rad, speed in rad/s, time derivatives, SI units; matrices by rows, M[i * n + j]."


def require_formulas(system: PeriodicSystem, what: str) -> Model:
    """Return the system if it is a model with formulas. Raises NoMotionError or LinearModelError
    otherwise."""
    require_motion(system)
    linearised = isinstance(system, LinearisedModel)
    if not isinstance(system, Model) or linearised or system.assembled or not is_nonlinear(system):
        raise LinearModelError(
            f"{what} requires the formulas of a mechanism, and {system.labels.name} has only numerical "
            "matrices; export these to a .mat file"
        )
    return system


def identifier(model: Model) -> str:
    """Name of the model as a C identifier."""
    name = re.sub(r"\W", "_", model.labels.name, flags=re.ASCII)
    return name if name[:1].isalpha() else f"model_{name}"


def c_code(system: PeriodicSystem, file_stem: str) -> tuple[str, str]:
    """Texts of FILE.c and FILE.h. Raises LinearModelError, NoMotionError, FileError."""
    if not file_stem.isprintable() or set(file_stem) & set('"\\'):
        raise FileError(
            f"{file_stem!r} cannot be the name of a C file; leave out quotes, backslashes and "
            "control characters"
        )
    model = require_formulas(system, "C code")
    names = [name for name in _FUNCTIONS if name != "outputs" or model.outputs]
    functions = {name: _by_rows(model, name) for name in names}
    return _source(model, functions, file_stem), _header(model, functions)


@symbolic
def _by_rows(model: Model, name: str) -> "casadi.Function":
    """Generated function with dense results: matrices row by row, all outputs in one column y."""
    import casadi

    function = model.setup.function(name)
    inputs = inputs_of(function)
    values = function.call([*inputs.values()], True, False)
    names = ["y"] if name == "outputs" else function.name_out()
    results = [by_rows(values)] if name == "outputs" else [by_rows([value]) for value in values]
    return casadi.Function(
        f"{identifier(model)}_casadi_{name}", [*inputs.values()], results, [*inputs], names
    )


def _prototype(model: Model, name: str, function: "casadi.Function") -> str:
    inputs = [f"double {x}" if x in _SCALARS else f"const double *{x}" for x in function.name_in()]
    results = [f"double *{y}" for y in function.name_out()]
    return f"int {identifier(model)}_{name}({', '.join([*inputs, *results])})"


def _header(model: Model, functions: dict[str, "casadi.Function"]) -> str:
    name = identifier(model)
    guard = f"{name.upper()}_H"
    lines = [
        *_banner(model),
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        f"#define {name.upper()}_COORDINATES {model.n}",
        f"#define {name.upper()}_PARAMETERS {len(model.parameters)}",
        f"#define {name.upper()}_OUTPUTS {len(model.outputs)}",
        "",
        *_listed("q", model, model.coordinates),
        *_listed("y", model, model.outputs if "outputs" in functions else ()),
        *_listed("p", model, tuple(model.parameters)),
        f"/* Values of the parameters p of case {_plain(str(model.labels.case))}, including changed values. "
        "*/",
        f"extern const double {name}_parameters[{max(len(model.parameters), 1)}];",
        "",
        f"/* {_ARGUMENTS}",
        "   Every function returns 0, keeps no state, and may run in several threads at once. */",
        "",
    ]
    for function_name, function in functions.items():
        lines += [f"/* {_FUNCTIONS[function_name]} */", f"{_prototype(model, function_name, function)};", ""]
    return "\n".join([*lines, "#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {guard} */", ""])


def _source(model: Model, functions: dict[str, "casadi.Function"], stem: str) -> str:
    import casadi

    name = identifier(model)
    # Separate symbols allow several models in one program.
    generator = casadi.CodeGenerator(f"{name}_casadi.c")
    for function in functions.values():
        generator.add(function)
    values = ", ".join(repr(value) for value in model.parameters.values()) or "0.0"
    parts = [
        "\n".join(_banner(model)),
        f'#include "{stem}.h"\n',
        generator.dump(),
        f"const double {name}_parameters[{max(len(model.parameters), 1)}] = {{{values}}};\n",
        *(_wrapper(model, function_name, function) for function_name, function in functions.items()),
    ]
    return "\n".join(parts)


def _wrapper(model: Model, name: str, function: "casadi.Function") -> str:
    inputs = [f"&{x}" if x in _SCALARS else x for x in function.name_in()]
    sizes = function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w()
    arguments, results, integers, work = (max(size, 1) for size in sizes)
    lines = [
        f"{_prototype(model, name, function)} {{",
        f"  const double *arg[{arguments}];",
        f"  double *res[{results}];",
        f"  casadi_int iw[{integers}];",
        f"  double w[{work}];",
        *(f"  arg[{k}] = {x};" for k, x in enumerate(inputs)),
        *(f"  res[{k}] = {y};" for k, y in enumerate(function.name_out())),
        f"  return {function.name()}(arg, res, iw, w, 0);",
        "}",
        "",
    ]
    return "\n".join(lines)


def _banner(model: Model) -> list[str]:
    options = "".join(f", {name}={value}" for name, value in model.labels.options.items())
    numbers = versions()
    tools = f"parametric-vibration {numbers['parametric-vibration']} with CasADi {numbers['casadi']}"
    return [
        f"/* {_plain(model.labels.title)}",
        f"   model {_plain(model.labels.name)}, code {model.labels.model_hash}{_plain(options)}",
        f"   written by {tools} */",
    ]


def _listed(symbol: str, model: Model, names: Sequence[str]) -> list[str]:
    """C comment with name, unit and meaning of each entry of an array."""
    lines = []
    for k, name in enumerate(names):
        default = model.labels.units.get(name, ""), model.labels.meanings.get(name, "")
        unit, meaning = model.labels.parameter_labels[name] if symbol == "p" else default
        lines.append(f"   {symbol}[{k}]  {name} ({unit or '1'}): {_plain(meaning)}")
    return [f"/* {symbol}:", *lines, "*/", ""] if lines else []


def _plain(text: str) -> str:
    """Text without line breaks and comment ends."""
    return text.replace("*/", "* /").replace("\n", " ")
