"""The text of a generated module: its constants, and functions that build CasADi functions."""

import json
from dataclasses import dataclass

import sympy

from derive import lagrange
from derive.freshness import banner, seal
from derive.function_text import Generated, function_text
from derive.linearise import linearise
from derive.mechanism import Mechanism, Output
from derive.printer import CasadiPrinter
from derive.recurrence import COMPONENTS, FOURIER

CHOICE = '''\
def _choice(option, value):
    """One indicator, 1.0 or 0.0, for each allowed value of an option."""
    allowed = next(values for name, values, _ in OPTIONS if name == option)
    if value not in allowed:
        raise ValueError(f"option {option} is {value!r}; allowed: {', '.join(map(str, allowed))}")
    return [float(value == each) for each in allowed]'''
TOOLS = {"_fourier(": FOURIER, "_components(": COMPONENTS, "_choice(": CHOICE}


@dataclass(frozen=True)
class Equations:
    """All that a generated module computes."""

    linearised: dict[str, sympy.Matrix]
    residual: sympy.Matrix
    outputs: list[Output]


def derive_equations(mechanism: Mechanism) -> Equations:
    """Equations of a checked mechanism; SingularMassError where a coordinate has no inertia."""
    r = lagrange.residual(mechanism)
    outputs = [] if mechanism.no_drive_torque else [_torque(mechanism, r)]
    for each in mechanism.declared_outputs:
        expression = lagrange.from_fundamental(mechanism, each.expression)
        outputs.append(Output(each.name, expression, each.unit, each.meaning))
    return Equations(linearise(mechanism, r)._asdict(), r, outputs)


def module_text(mechanism: Mechanism, source_sha256: str, derive_sha256: str, command: str) -> str:
    """Whole text of the generated module; `command` is what renews it, after `python -m derive`."""
    equations = derive_equations(mechanism)
    state = ("phase", "speed", "q", "qd", "qdd", "p")
    outputs = {each.name: each.expression for each in equations.outputs}
    functions = [
        Generated(
            "linearised", "M, C, K, d of M q̈ + C q̇ + K q = d.", ("phase", "speed", "p"), equations.linearised
        ),
        Generated(
            "residual", "Nonlinear r of the equation of motion r = 0.", state, {"r": equations.residual}
        ),
        Generated("outputs", "One scalar for each of OUTPUTS.", state, outputs),
    ]
    printed = {each.name: function_text(mechanism, each) for each in functions}
    texts = [text for text, _ in printed.values()]
    tools = [tool for call, tool in TOOLS.items() if any(call in text for text in texts)]
    data = constants(mechanism, equations.outputs, {name: count for name, (_, count) in printed.items()})
    body = "\n\n\n".join([data, *tools, *texts]) + "\n"
    return seal(banner(mechanism.title, command), source_sha256, derive_sha256, sympy.__version__, body)


def _torque(mechanism: Mechanism, residual: sympy.Matrix) -> Output:
    meaning = "torque of the drive that keeps the speed constant"
    return Output("drive_torque", lagrange.drive_torque(mechanism, residual), "N m", meaning)


def constants(mechanism: Mechanism, outputs: list[Output], operations: dict[str, int]) -> str:
    """The data of a generated module, but for its hashes."""
    rows = {
        "COORDINATES": [
            (each.symbol.name, each.unit, each.meaning) for each in mechanism.declared_coordinates
        ],
        "PARAMETERS": [
            (each.symbol.name, each.unit, each.meaning, each.bound) for each in mechanism.declared_parameters
        ],
        "OPTIONS": [(each.name, each.values, each.values[0]) for each in mechanism.declared_options],
        "OUTPUTS": [(each.name, each.unit, each.meaning) for each in outputs],
        "LIMITS": mechanism.limits,
    }
    lines = [f"NAME = {literal(mechanism.name)}", f"TITLE = {literal(mechanism.title)}"]
    for name, tuples in rows.items():
        lines += (
            [f"{name} = (", *(f"    {literal(row)}," for row in tuples), ")"] if tuples else [f"{name} = ()"]
        )
    lines += [
        f"VALIDITY = {json.dumps(mechanism.validity)}",
        f"PERIOD = {CasadiPrinter().doprint(sympy.sympify(mechanism.period))}",
        f"OPERATIONS = {json.dumps(operations)}",
    ]
    if mechanism.no_drive_torque:
        lines.append(f"NO_DRIVE_TORQUE = {literal(mechanism.no_drive_torque)}")
    return "\n".join(lines)


def literal(value: str | tuple) -> str:
    """A text or a tuple as Python, always with double quotes."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return "(" + ", ".join(map(literal, value)) + ("," if len(value) == 1 else "") + ")"
