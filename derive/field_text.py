"""The text of generated functions that a field needs: its mode functions, their integrals, the residual."""

from collections.abc import Sequence

import sympy

from derive.field import Field
from derive.galerkin import ZERO_COLUMN, ZERO_MATRIX, Moment, Pair, Projection
from derive.modal_integrals import XI
from derive.printer import CasadiPrinter
from derive.sketch import RUNNING

K = sympy.Symbol("k", integer=True, positive=True)
PAIRS = '''\
def _pairs(integral, count):
    """An integral of two modes for every row i and column j."""
    numbers = range(1, count + 1)
    return casadi.DM([[integral(i, j) for j in numbers] for i in numbers])'''
COLUMN = '''\
def _column(integral, count):
    """An integral of one mode for every row j."""
    return casadi.DM([integral(j) for j in range(1, count + 1)])'''
RESIDUAL = '''\
def _residual(name, matrices):
    """r of the equations with the matrices, which are a function of the drive and the parameters."""
    *drive, p = (casadi.SX.sym(each, matrices.size1_in(each)) for each in matrices.name_in())
    q, qd, qdd = (casadi.SX.sym(each, matrices.size1_out("d")) for each in ("q", "qd", "qdd"))
    M, C, K, d = matrices(*drive, p)
    names = [*matrices.name_in()[:-1], "q", "qd", "qdd", "p"]
    r = M @ qdd + C @ qd + K @ q - d
    return casadi.Function(name, [*drive, q, qd, qdd, p], [r], names, ["r"])'''
AMPLITUDES = ("coordinates", "rates", "accelerations")


def definitions(projection: Projection) -> dict[sympy.Symbol, str]:
    """Text for each symbol of the projected equations, and for each point of the field."""
    modes = projection.deflection.modes
    texts = {
        ZERO_MATRIX: f"casadi.DM.zeros({modes}, {modes})",
        ZERO_COLUMN: f"casadi.DM.zeros({modes})",
    }
    for pair in projection.pairs:
        texts[pair] = f"_pairs(_{pair}, {modes})"
    for moment in projection.moments:
        texts[moment] = f"_column(_{moment}, {modes})"
    for weighted, moment in projection.weighted.items():
        for symbol, amplitudes in zip(weighted.motion, AMPLITUDES, strict=True):
            texts[symbol] = f"casadi.dot(_column(_{moment}, {modes}), {amplitudes})"
    return texts | _points(projection.deflection)


def along(deflection: Field) -> dict[sympy.Symbol, str]:
    """Text for what `Field.line` holds, at the fraction `running` of the length."""
    printer, modes = CasadiPrinter(), deflection.modes
    length = printer.doprint(deflection.length)
    texts = {deflection.position: f"({length})*{RUNNING}"}
    for order, local in enumerate(deflection.derivatives):
        shape = f"_{deflection.name}({RUNNING}, {order}, {modes})"
        texts[local] = f"casadi.dot({shape}, coordinates)" + (f"/({length})**{order}" if order else "")
    return texts


def field_tools(projection: Projection) -> list[str]:
    """Module functions that the definitions call."""
    return [
        _modes(projection.deflection),
        *([PAIRS] if projection.pairs else []),
        *([COLUMN] if projection.moments else []),
        RESIDUAL,
        *(_pair(name, pair) for name, pair in projection.pairs.items()),
        *(_moment(name, moment) for name, moment in projection.moments.items()),
    ]


def field_functions(deflection: Field, given: str, options: Sequence[str]) -> list[str]:
    """The residuals, and the mode functions for those who want the deflection elsewhere.

    given: text of the functions' parameters. options: names of the module's options.
    """
    passed = ", ".join(f"{name}={name}" for name in options)
    modes = deflection.modes
    residuals = [
        f'''\
def residual{suffix}({given}):
    """{doc}, as the projected equations are."""
    return _residual("residual{suffix}", linearised{suffix}({passed}))'''
        for suffix, doc in (
            ("", "r of the equation of motion r = 0; linear"),
            ("_varying", "r where the speed varies; linear"),
        )
    ]
    fields = f'''\
def fields({given}):
    """Mode functions of each of FIELDS at a fraction xi of its length."""
    {modes} = _count("{modes}", {modes})
    xi = casadi.SX.sym("xi")
    shapes = _{deflection.name}(xi, 0, {modes})
    return casadi.Function("fields", [xi], [shapes], ["xi"], ["{deflection.name}"])'''
    return [*residuals, fields]


def _points(deflection: Field) -> dict[sympy.Symbol, str]:
    texts: dict[sympy.Symbol, str] = {}
    printer = CasadiPrinter()
    for point, (local, position) in deflection.points.items():
        if local in deflection.derivatives:
            order = deflection.derivatives.index(local)
            xi = printer.doprint(position / deflection.length)
            scale = f"/({printer.doprint(deflection.length**order)})" if order else ""
            shape = f"_{deflection.name}({xi}, {order}, {deflection.modes})"
            for symbol, amplitudes in zip(point.motion, AMPLITUDES, strict=True):
                texts[symbol] = f"casadi.dot({shape}, {amplitudes}){scale}"
    return texts


def _modes(deflection: Field) -> str:
    shape = deflection.shape(K, XI)
    rows = [CasadiPrinter().doprint(shape.diff(XI, order)) for order in range(3)]
    listed = "\n".join(f"            {row}," for row in rows)
    return f'''\
def _{deflection.name}(xi, derivative, count):
    """Mode functions psi_1 to psi_count of {deflection.name} at xi = x/length, differentiated by xi."""
    return casadi.vertcat(*(
        (
{listed}
        )[derivative]
        for k in range(1, count + 1)
    ))'''


def _pair(name: sympy.Symbol, pair: Pair) -> str:
    printer = CasadiPrinter()
    return f'''\
def _{name}(i, j):
    """Integral of xi^{pair.power} psi_i^({pair.first}) psi_j^({pair.second}) over xi from 0 to 1."""
    if i == j:
        return {printer.doprint(pair.integral.equal)}
    return {printer.doprint(pair.integral.different)}'''


def _moment(name: sympy.Symbol, moment: Moment) -> str:
    return f'''\
def _{name}(j):
    """Integral of xi^{moment.power} psi_j^({moment.derivative}) over xi from 0 to 1."""
    return {CasadiPrinter().doprint(moment.formula)}'''
