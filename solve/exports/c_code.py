"""The generated functions of a model as C, by CasADi's generator, with a plain function around each."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from solve.errors import FileError
from solve.exports.equations import Quantity, identifier, parameters_of, quantities_of, require_formulas
from solve.model.model import Model
from solve.model.sampling import by_rows, inputs_of
from solve.results.contents import versions
from solve.system import PeriodicSystem

if TYPE_CHECKING:
    import casadi

_FUNCTIONS = {
    "linearised": "M q'' + C q' + K q = d, linearised about the fundamental motion q = 0.",
    "residual": "The nonlinear equations of motion, r = 0.",
    "outputs": "Outputs y, those of the drive at constant speed.",
}
"""Those of a generated module, and what the header says of each."""

_SCALARS = "phase", "speed"

_ARGUMENTS = "Phase in rad, speed in rad/s, derivatives by time, SI units; matrices by rows, M[i * n + j]."


def c_code(system: PeriodicSystem, file_stem: str) -> tuple[str, str]:
    """Text of FILE.c and FILE.h. Raises LinearModelError, NoMotionError, FileError."""
    if not file_stem.isprintable() or set(file_stem) & set('"\\'):
        raise FileError(f"{file_stem!r} cannot be the name of a file of C; leave out quotes and backslashes")
    model = require_formulas(system, "C code")
    names = [name for name in _FUNCTIONS if name != "outputs" or model.outputs]
    functions = {name: _by_rows(model, name) for name in names}
    return _source(model, functions, file_stem), _header(model, functions)


def _by_rows(model: Model, name: str) -> "casadi.Function":
    """A generated function with dense results by rows; outputs are one column y."""
    import casadi

    function = model.setup.function(name)
    inputs = inputs_of(function)
    parts = function.call([*inputs.values()], True, False)
    names = ["y"] if name == "outputs" else function.name_out()
    results = [by_rows(parts)] if name == "outputs" else [by_rows([part]) for part in parts]
    return casadi.Function(
        f"{identifier(model)}_casadi_{name}", [*inputs.values()], results, [*inputs], names
    )


def _prototype(model: Model, name: str, function: "casadi.Function") -> str:
    given = [f"double {each}" if each in _SCALARS else f"const double *{each}" for each in function.name_in()]
    results = [f"double *{each}" for each in function.name_out()]
    return f"int {identifier(model)}_{name}({', '.join([*given, *results])})"


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
        *_listed("q", quantities_of(model, model.coordinates)),
        *(_listed("y", quantities_of(model, model.outputs)) if "outputs" in functions else ()),
        *_listed("p", parameters_of(model)),
        f"/* Values of p of case {_plain(str(model.case))}, with those that were set. */",
        f"extern const double {name}_parameters[{max(len(model.parameters), 1)}];",
        "",
        f"/* {_ARGUMENTS}",
        "   Every function returns 0. They hold no memory and may run in several threads. */",
        "",
    ]
    for each, function in functions.items():
        lines += [f"/* {_FUNCTIONS[each]} */", f"{_prototype(model, each, function)};", ""]
    return "\n".join([*lines, "#ifdef __cplusplus", "}", "#endif", "", f"#endif /* {guard} */", ""])


def _source(model: Model, functions: dict[str, "casadi.Function"], stem: str) -> str:
    import casadi

    name = identifier(model)
    # Its own symbols, beside those of another model in the same program.
    generator = casadi.CodeGenerator(f"{name}_casadi.c")
    for function in functions.values():
        generator.add(function)
    values = ", ".join(repr(value) for value in model.parameters.values()) or "0.0"
    parts = [
        "\n".join(_banner(model)),
        f'#include "{stem}.h"\n',
        generator.dump(),
        f"const double {name}_parameters[{max(len(model.parameters), 1)}] = {{{values}}};\n",
        *(_wrapper(model, each, function) for each, function in functions.items()),
    ]
    return "\n".join(parts)


def _wrapper(model: Model, name: str, function: "casadi.Function") -> str:
    given = [f"&{each}" if each in _SCALARS else each for each in function.name_in()]
    sizes = function.sz_arg(), function.sz_res(), function.sz_iw(), function.sz_w()
    arguments, results, integers, work = (max(size, 1) for size in sizes)
    lines = [
        f"{_prototype(model, name, function)} {{",
        f"  const double *arg[{arguments}];",
        f"  double *res[{results}];",
        f"  casadi_int iw[{integers}];",
        f"  double w[{work}];",
        *(f"  arg[{at}] = {each};" for at, each in enumerate(given)),
        *(f"  res[{at}] = {each};" for at, each in enumerate(function.name_out())),
        f"  return {function.name()}(arg, res, iw, w, 0);",
        "}",
        "",
    ]
    return "\n".join(lines)


def _banner(model: Model) -> list[str]:
    chosen = "".join(f", {name}={value}" for name, value in model.options.items())
    made = versions()
    return [
        f"/* {_plain(model.title)}",
        f"   model {_plain(model.name)}, code {model.model_hash}{_plain(chosen)}",
        f"   written by parametric-vibration {made['parametric-vibration']} with CasADi {made['casadi']} */",
    ]


def _listed(symbol: str, quantities: Sequence[Quantity]) -> list[str]:
    """What each entry of an array is."""
    lines = [
        f"   {symbol}[{at}]  {each.name} ({each.unit or '1'}): {_plain(each.meaning)}"
        for at, each in enumerate(quantities)
    ]
    return [f"/* {symbol}:", *lines, "*/", ""] if lines else []


def _plain(text: str) -> str:
    """Without what would end a comment."""
    return text.replace("*/", "* /").replace("\n", " ")
