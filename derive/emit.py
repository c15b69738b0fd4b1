"""Source code of a generated module: constants, and functions that build CasADi functions."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import sympy

from derive.constants import constants, literal
from derive.declarations import AROUND, RUNNING, Condition, Output
from derive.discontinuities import ANGLES, PASSES, Passage, passages
from derive.equations import (
    accelerated,
    clearances,
    drive_torque,
    from_fundamental,
    input_matrix,
    linearise,
    residuals,
)
from derive.errors import DeclarationError, ImpulseError
from derive.field import Field
from derive.freshness import hashed_module
from derive.function_text import (
    VARYING,
    GeneratedFunction,
    breaks_text,
    function_text,
    options_text,
    tuple_lines,
    varying_text,
)
from derive.galerkin import Projection, along, definitions, field_functions, field_tools, project
from derive.mechanism import MechanismStatement
from derive.printer import COMPONENTS, FOURIER, loop_orders, loop_text
from derive.reading import Equation, mathml, read
from derive.symbols import steady
from derive.units import size
from derive.validity import Demand, conditions, demands, idle, losses, switched
from solve.terminal import progress

CHOICE = '''\
def _choice(option, value):
    """List with 1.0 for the chosen value of an option and 0.0 for each other allowed value."""
    allowed = next(values for name, values, _ in OPTIONS if name == option)
    if value not in allowed:
        raise ValueError(f"option {option} is {value!r}; allowed: {', '.join(map(str, allowed))}")
    return [float(value == each) for each in allowed]'''
COUNT = '''\
def _count(option, value):
    """Value of an option whose values are integers."""
    allowed = next(values for name, values, _ in OPTIONS if name == option)
    if value not in allowed:
        raise ValueError(f"option {option} is {value!r}; allowed: {allowed[0]} to {allowed[-1]}")
    return int(value)'''
TOOLS = {
    "_count(": COUNT,
    "_fourier(": FOURIER,
    "_components(": COMPONENTS,
    "_choice(": CHOICE,
    "_passes(": PASSES,
    "_angles(": ANGLES,
    "_varying(": VARYING,
}

MOST_TO_READ = 2000
"""Largest number of operations in M, C, K and d for which the equations are printed for reading. Chosen by
judgement: the mechanisms of `models/` have up to 364 operations, which are printed on about one page."""

RIGID = "a mechanism without coordinates has no equations of motion"

DOCS = {
    "residual": "Nonlinear r of the equation of motion r = 0.",
    "outputs": "One scalar per entry of OUTPUTS.",
}
STATE = ("phase", "speed", "q", "qd", "qdd", "p")
ACCELERATED = ("phase", "speed", "acceleration", "q", "qd", "qdd", "p")


@dataclass(frozen=True)
class Equations:
    """All results of the derivation, from which a generated module is written.

    residual, outputs: results at varying speed; residual is None if there are no coordinates or if
    `functions` contains it. definitions: source code that defines symbols other than inputs. tools,
    functions: source code of functions, placed before and after the other functions. conditions: conditions
    on the parameters. demands: domain conditions. passages: phases of the switches. nonlinear: sentences
    about terms that the linear equations ignore. idle: sentences about terms that all equations ignore.
    switched: sentences about steps and kinks that the vibration may cross. no_drive_torque: reason why there
    is no drive torque. projection: projection of a deflection onto its mode functions. inputs: matrix B, if
    there are inputs.
    """

    linearised: dict[str, Any]
    residual: sympy.Matrix | None
    outputs: list[Output]
    definitions: dict[sympy.Symbol, str] = field(default_factory=dict)
    tools: list[str] = field(default_factory=list)
    functions: list[str] = field(default_factory=list)
    conditions: list[Condition] = field(default_factory=list)
    demands: list[Demand] = field(default_factory=list)
    passages: list[Passage] = field(default_factory=list)
    nonlinear: list[str] = field(default_factory=list)
    switched: list[str] = field(default_factory=list)
    idle: list[str] = field(default_factory=list)
    no_drive_torque: str = ""
    projection: Projection | None = None
    inputs: sympy.Matrix | None = None

    @property
    def of_states(self) -> dict[str, dict[str, Any]]:
        """Mapping from names of functions to their results at varying speed, as a mapping from names."""
        residual = {} if self.residual is None else {"residual": {"r": self.residual}}
        return {**residual, "outputs": {output.name: output.expression for output in self.outputs}}


def derive_equations(mechanism: MechanismStatement) -> Equations:
    """Derive the equations of a checked mechanism. Raises SingularMassError for a coordinate without
    inertia."""
    if mechanism.declared_field:
        return _field_equations(mechanism, mechanism.declared_field)
    varying = residuals(mechanism)
    r = steady(varying)
    reason, outputs = mechanism.no_drive_torque, []
    if not reason:
        try:
            # With modal damping, which the residual does not contain, its rows do not vanish on a motion.
            rows = () if mechanism.damping_ratios else [*varying]
            outputs.append(_torque(drive_torque(mechanism, rows)))
        except ImpulseError as error:
            reason = f"it would contain impulses: {error}"
    for declared in mechanism.declared_outputs:
        outputs.append(_in_its_unit(declared, from_fundamental(mechanism, declared.expression)))
    linearised, expressions = linearise(mechanism, r), [output.expression for output in outputs]
    moving = [s for coordinate in mechanism.declared_coordinates for s in coordinate.symbol.motion]
    B = input_matrix(mechanism) if mechanism.declared_inputs else None
    return Equations(
        linearised._asdict(),
        varying if mechanism.declared_coordinates else None,
        outputs,
        conditions=[*conditions(mechanism), *clearances(mechanism, r)],
        demands=demands(mechanism),
        passages=passages([*linearised, *([] if B is None else [B])], [*map(steady, expressions)], moving),
        nonlinear=losses(mechanism, [*r], linearised),
        switched=switched(mechanism),
        idle=idle(mechanism, [*varying, *linearised, *expressions]),
        no_drive_torque=reason,
        inputs=B,
    )


def _field_equations(mechanism: MechanismStatement, deflection: Field) -> Equations:
    projection = project(mechanism, deflection)
    outputs = [] if mechanism.no_drive_torque else [_torque(projection.drive_torque)]
    for declared in mechanism.declared_outputs:
        outputs.append(_in_its_unit(declared, declared.expression.xreplace(projection.tensions)))
    options = [option.name for option in mechanism.declared_options]
    functions = field_functions(deflection, options_text(mechanism), options)
    tools = field_tools(projection)
    linearised = [sympy.sympify(matrix) for matrix in projection.linearised.values()]
    return Equations(
        projection.linearised,
        None,
        outputs,
        definitions(projection),
        tools,
        functions,
        conditions=conditions(mechanism),
        demands=demands(mechanism),
        passages=passages(linearised, (), ()),
        no_drive_torque=mechanism.no_drive_torque,
        projection=projection,
    )


def module_text(
    mechanism: MechanismStatement,
    source_sha256: str,
    command: str,
    report: Callable[[str], object] = lambda _: None,
) -> str:
    """Source code of the generated module of a mechanism.

    command: arguments of `python -m derive` that regenerate the module. report: function that receives each
    sentence about terms that the equations ignore.
    """
    with progress.steps(2) as step:
        step("equations")
        equations = derive_equations(mechanism)
        for sentence in (*equations.nonlinear, *equations.switched, *equations.idle):
            report(sentence)
        step("code")
        texts, counts = functions_text(mechanism, _functions(mechanism, equations))
    options = [option.name for option in mechanism.declared_options]
    texts += [varying_text(name, options_text(mechanism), options) for name in equations.of_states]
    texts += equations.functions
    if equations.passages:
        texts.append(breaks_text(mechanism, equations.passages))
    texts.append(_for_reading(mechanism, equations, counts["linearised"]))
    tools = [tool for call, tool in TOOLS.items() if any(call in text for text in texts)]
    data = [
        constants(mechanism, equations.outputs, _operations(counts), equations.conditions),
        *_domain(equations.demands),
        *_reasons(equations),
    ]
    body = "\n\n\n".join(["\n".join(data), *tools, *equations.tools, *texts]) + "\n"
    _require_own_names(body)
    return hashed_module(mechanism.title, command, source_sha256, body)


def _require_own_names(body: str) -> None:
    """Raise DeclarationError if the name of a field or of an unknown of a loop is that of another generated
    function."""
    defined = re.findall(r"^def _(\w+)", body, re.MULTILINE)
    for name in defined:
        if defined.count(name) > 1:
            raise DeclarationError(
                f'"{name}" cannot be the name of a field or of an unknown: a function of the generated '
                "module has this name; choose another"
            )


def _domain(demanded: Sequence[Demand]) -> list[str]:
    """Lines of the constant DOMAIN; empty if there are no domain conditions."""
    return tuple_lines("DOMAIN", [literal(tuple(demand[:4])) for demand in demanded]) if demanded else []


def _reasons(equations: Equations) -> list[str]:
    """Lines of those of the constants NO_DRIVE_TORQUE, NONLINEAR and SWITCHED that are not empty."""
    lines = []
    if equations.no_drive_torque:
        lines.append(f"NO_DRIVE_TORQUE = {literal(equations.no_drive_torque)}")
    if equations.nonlinear:
        lines += tuple_lines("NONLINEAR", [*map(literal, equations.nonlinear)])
    if equations.switched:
        lines += tuple_lines("SWITCHED", [*map(literal, equations.switched)])
    return lines


def _for_reading(mechanism: MechanismStatement, equations: Equations, operations: int) -> str:
    """M, C, K and d as MathML, or the reason why they are not printed."""
    if not mechanism.declared_coordinates:
        return f"NO_EQUATIONS = {literal(RIGID)}"
    if operations > MOST_TO_READ:
        reason = f"M, C, K and d take {operations} operations; up to {MOST_TO_READ} are printed for reading"
        return f"NO_EQUATIONS = {literal(reason)}"
    return equations_text(read(mechanism, equations.linearised), equations.projection)


def equations_text(equations: Sequence[Equation], projection: Projection | None = None) -> str:
    """Source code of the constant EQUATIONS, with one MathML element per equation."""
    return "\n".join(tuple_lines("EQUATIONS", [*map(literal, mathml(equations, projection))]))


def functions_text(
    mechanism: MechanismStatement, functions: list[GeneratedFunction]
) -> tuple[list[str], dict[str, int]]:
    """Return the source code of all loops and functions, and the number of operations of each function."""
    orders = loop_orders([matrix for function in functions for matrix in function.matrices])
    loops = {loop.name: loop_text(loop, needed) for loop, needed in orders.items()}
    printed = {function.name: function_text(mechanism, function, orders) for function in functions}
    counts = {
        name: count + sum(n for loop, (_, n) in loops.items() if f"{loop}(" in text)
        for name, (text, count) in printed.items()
    }
    return [text for text, _ in (*loops.values(), *printed.values())], counts


def _operations(counts: dict[str, int]) -> dict[str, int]:
    """Number of operations of each function that is evaluated at every phase."""
    evaluated = {name: counts[name] for name in ("linearised", "residual", "outputs") if name in counts}
    return {"linearised": counts["linearised"], "residual": counts["linearised"], **evaluated}


def _functions(mechanism: MechanismStatement, equations: Equations) -> list[GeneratedFunction]:
    names = equations.definitions
    doc = "M, C, K, d of M q̈ + C q̇ + K q = d."
    functions = [GeneratedFunction("linearised", doc, ("phase", "speed", "p"), equations.linearised, names)]
    if equations.inputs is not None:
        doc = "B of M q̈ + C q̇ + K q = d + B u."
        functions.append(GeneratedFunction("inputs", doc, ("phase", "speed", "p"), {"B": equations.inputs}))
    for name, results in equations.of_states.items():
        constant = {each: steady(part) for each, part in results.items()}
        functions.append(GeneratedFunction(name, DOCS[name], STATE, constant, names))
        doc = f"Contribution to {name} of an acceleration of the drive."
        added = {each: accelerated(part) for each, part in results.items()}
        functions.append(GeneratedFunction(f"{name}_accelerated", doc, ACCELERATED, added, names))
    if equations.projection is not None:
        doc = "M, C, K, d at varying speed."
        inputs, varying = ("phase", "speed", "acceleration", "p"), equations.projection.varying
        functions.append(GeneratedFunction("linearised_varying", doc, inputs, varying, names))
    if mechanism.damping_ratios:
        doc = (
            "Damping ratios of the modes of M and K at speed 0, lowest frequency first; the last applies to "
            "all higher modes."
        )
        ratios = {"ratios": sympy.Matrix(mechanism.damping_ratios)}
        functions.append(GeneratedFunction("damping_ratios", doc, ("p",), ratios))
    functions += sketch_functions(mechanism)
    functions += domain_functions(equations.demands)
    return functions + condition_functions(equations.conditions)


def domain_functions(demanded: Sequence[Demand]) -> list[GeneratedFunction]:
    """List with the generated function of the domain conditions; empty if there are none."""
    if not demanded:
        return []
    doc = "One number per entry of DOMAIN. It must satisfy the relation of its entry at every phase."
    margins = sympy.Matrix([demand.margin for demand in demanded])
    return [GeneratedFunction("domain", doc, ("phase", "speed", "p"), {"margins": margins})]


def sketch_functions(mechanism: MechanismStatement) -> list[GeneratedFunction]:
    """List with the generated function that computes the lines of the sketch; empty without a sketch."""
    if not mechanism.declared_sketches:
        return []
    deflection, still = mechanism.declared_field, {AROUND: 2 * sympy.pi * RUNNING}
    texts: dict[sympy.Symbol, str] = {}
    if deflection:
        # The shortening of the link is neglected, since it is of second order in the deflection.
        still |= dict.fromkeys((deflection.shortening, deflection.total_shortening), sympy.S.Zero)
        texts = along(deflection)

    def drawn(number: Any) -> Any:
        return steady(from_fundamental(mechanism, number.xreplace(still)))

    lines = {sketch.name: sketch.at(drawn) for sketch in mechanism.declared_sketches}
    doc = (
        "Coordinates x and y of the points of each line of SKETCH, in sequence; running goes from 0 to 1 "
        "along the line."
    )
    return [GeneratedFunction("sketch", doc, ("phase", "speed", "q", "running", "p"), lines, texts)]


def condition_functions(conditions: Sequence[Condition]) -> list[GeneratedFunction]:
    """List with the generated function of the conditions on parameters; empty if there are none."""
    if not conditions:
        return []
    margins = sympy.Matrix([condition.margin for condition in conditions])
    doc = "One number per entry of CONDITIONS, positive where the condition holds."
    return [GeneratedFunction("conditions", doc, ("phase", "p"), {"margins": margins})]


def _in_its_unit(output: Output, expression: Any) -> Output:
    factor = size(output.unit)
    return replace(output, expression=expression if factor == 1.0 else expression / sympy.Float(factor))


def _torque(expression: Any) -> Output:
    return Output("drive_torque", expression, "N m", "torque of the drive")
