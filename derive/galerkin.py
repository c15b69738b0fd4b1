"""Galerkin projection of a deflection onto its mode functions, and source code of the generated functions.

Lagrange's equations are formed from the energies per unit length as if w, w′ and w″ at a position were
coordinates. Their linearised left-hand sides are r_a = Σ_b M_ab ẅ_b + C_ab ẇ_b + K_ab w_b − d_a, where a and
b are orders of derivatives with respect to x. The equations of the amplitudes are ∫ Σ_a ψ_j^(a) r_a dx = 0.
The coefficients are polynomials in x. The projection therefore requires only constant integrals of products
of mode functions and powers of x.

The shortening u = ½∫w′² is of second order. Lagrange's expression for u is a force F_u along the link, with
the virtual work ∫ F_u δu dx = ∫ w′ δw′ [∫ F_u dx from x to the end] dx. The tension N(x) is the sum of this
inner integral and the force at the end, which is Lagrange's expression for the total shortening. The energy
of the geometric stiffness is N w′²/2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy

from derive.declarations import RUNNING
from derive.equations import Energies, equation, gathered, taylor_expansion
from derive.errors import DeclarationError, SingularMassError, UnsupportedExpressionError
from derive.field import XI, Field, FieldIntegral, ModalIntegral, modal_integral, modal_moment
from derive.mechanism import MechanismStatement
from derive.printer import CasadiPrinter
from derive.symbols import PHASE, Moving, counted, steady

ZERO_MATRIX, ZERO_COLUMN = sympy.symbols("zero_matrix zero_column", real=True)
"""Symbols of a zero matrix and a zero column with as many rows as there are modes."""

ZEROS = {"C": ZERO_MATRIX, "K": ZERO_MATRIX, "d": ZERO_COLUMN}


@dataclass(frozen=True)
class Moment:
    """Column of the integrals ∫ ξ^power ψ_j^(derivative) dξ, with one row per mode j."""

    derivative: int
    power: int
    formula: Any


@dataclass(frozen=True)
class Pair:
    """Matrix of the integrals ∫ ξ^power ψ_j^(first) ψ_i^(second) dξ, with row j and column i."""

    first: int
    second: int
    power: int
    integral: ModalIntegral


@dataclass
class Projection:
    """Matrices and drive torque at varying speed, as sums of coefficients times integrals of mode functions.

    most: largest number of modes. pairs, moments: integrals by symbol, as matrices and as columns. weighted:
    column by symbol, where the symbol is the scalar product of the column with the amplitudes; the rate of
    the symbol is the scalar product with the rates of the amplitudes.
    """

    deflection: Field
    most: int
    pairs: dict[sympy.Symbol, Pair] = field(default_factory=dict)
    moments: dict[sympy.Symbol, Moment] = field(default_factory=dict)
    weighted: dict[Moving, sympy.Symbol] = field(default_factory=dict)
    varying: dict[str, Any] = field(default_factory=dict)
    """M, C, K, d at varying speed."""
    drive_torque: Any = sympy.S.Zero
    tension: Any = sympy.S.Zero
    """Axial force N, a polynomial in the position."""

    @property
    def linearised(self) -> dict[str, Any]:
        """Matrices M, C, K and load d at constant speed."""
        named = {name: steady(part) for name, part in self.varying.items()}
        return {name: part if part != 0 else ZEROS[name] for name, part in named.items()}

    @property
    def tensions(self) -> dict[Any, Any]:
        """Mapping from symbols of the tension at a position to the tension N there."""
        x = self.deflection.position
        return {
            point: self.tension.xreplace({x: position})
            for point, (local, position) in self.deflection.points.items()
            if local == self.deflection.tension
        }


def project(mechanism: MechanismStatement, deflection: Field) -> Projection:
    """Derive the linear equations of the amplitudes, the drive torque to first order, and the tension.

    Raises DeclarationError for energies that are not sums of integrals, UnsupportedExpressionError for a
    density that is not a polynomial in x or for mode functions whose integrals have no closed form, and
    SingularMassError for a deflection without inertia.
    """
    most = len(mechanism.declared_coordinates)
    projection = Projection(deflection, most)
    energies = (mechanism.kinetic, mechanism.potential, mechanism.dissipation)
    parts = [_split(energy, deflection) for energy in energies]
    whole, density = (Energies(*each) for each in zip(*parts, strict=True))
    projection.tension = _tension(mechanism, deflection, whole, density)
    straight = _zeroed([deflection.shortening, deflection.total_shortening])
    density = Energies(*(each.xreplace(straight) for each in density))
    _project_rows(projection, density)
    if not mechanism.no_drive_torque:
        whole = Energies(*(each.xreplace(straight) for each in whole))
        forces = [[each.xreplace(straight) for each in work] for work in mechanism.forces]
        projection.drive_torque = equation(whole, PHASE, forces) + _torque(projection, density)
    _require_free_names(mechanism, projection)
    return projection


def _require_free_names(mechanism: MechanismStatement, projection: Projection) -> None:
    for symbol in (*projection.pairs, *projection.moments, *projection.weighted):
        if symbol.name in mechanism.names():
            raise DeclarationError(
                f'"{symbol.name}" is the name of an integral of mode functions; use another name'
            )


def _split(energy: Any, deflection: Field) -> tuple[Any, Any]:
    """Return the terms of an energy outside integrals, and the sum of the densities of its integrals."""
    energy = counted(sympy.sympify(energy))
    marks = {atom: sympy.Dummy() for atom in energy.atoms(FieldIntegral)}
    marked = energy.xreplace(marks)
    density = sympy.Add(*(marked.diff(mark) * integral.density for integral, mark in marks.items()))
    if density.has(*marks.values(), FieldIntegral):
        raise DeclarationError(
            f"energies must be sums of integrals over {deflection.name}, without nested integrals"
        )
    return marked.xreplace(dict.fromkeys(marks.values(), sympy.S.Zero)), density


def _tension(mechanism: MechanismStatement, deflection: Field, whole: Energies, density: Energies) -> Any:
    """Axial force N(x) of the straight link, from Lagrange's equations for the shortening at x and at the
    end."""
    x, length, chord = deflection.position, deflection.length, deflection.total_shortening
    straight = _zeroed(deflection.symbols)
    at_end = equation(whole, chord, mechanism.forces).xreplace(straight)
    spread = _powers(equation(density, chord).xreplace(straight), x)
    along = _powers(equation(density, deflection.shortening).xreplace(straight), x)
    terms = [at_end]
    terms += [factor * length ** (k + 1) / (k + 1) for k, factor in spread.items()]
    terms += [factor * (length ** (k + 1) - x ** (k + 1)) / (k + 1) for k, factor in along.items()]
    return gathered(sympy.Add(*terms))


def _project_rows(projection: Projection, density: Energies) -> None:
    deflection = projection.deflection
    rows = sympy.Matrix([equation(density, local) for local in deflection.derivatives])
    M, C, K, d = taylor_expansion(rows, deflection.derivatives)
    K[1, 1] += projection.tension
    matrices: dict[str, Any] = {"M": M, "C": C, "K": K}
    for name, local in matrices.items():
        projection.varying[name] = sympy.Add(
            *(_pair_terms(projection, local[a, b], a, b) for a in range(3) for b in range(3))
        )
    projection.varying["d"] = sympy.Add(*(_moment_terms(projection, d[a], a) for a in range(3)))
    if projection.varying["M"] == 0:
        raise SingularMassError(f"the kinetic energy gives no inertia to {deflection.name}; add its mass")
    for name, zeros in ZEROS.items():
        if projection.varying[name] == 0:
            projection.varying[name] = zeros


def _pair_terms(projection: Projection, coefficient: Any, a: int, b: int) -> Any:
    """Integral ∫ coefficient ψ_j^(a) ψ_i^(b) dx as a sum of factors times symbols of `pairs`."""
    deflection, terms = projection.deflection, []
    for power, factor in _powers(coefficient, deflection.position).items():
        integral = modal_integral(deflection.shape, a, b, power, projection.most)
        if not integral.vanishes:
            symbol = sympy.Symbol(f"{deflection.name}_{a}{b}_{power}", real=True)
            projection.pairs[symbol] = Pair(a, b, power, integral)
            terms.append(symbol * factor * deflection.length ** (1 + power - a - b))
    return sympy.Add(*terms)


def _moment_terms(projection: Projection, coefficient: Any, a: int) -> Any:
    """Integral ∫ coefficient ψ_j^(a) dx as a sum of factors times symbols of `moments`."""
    deflection, terms = projection.deflection, []
    for power, factor in _powers(coefficient, deflection.position).items():
        formula = modal_moment(deflection.shape, a, power, projection.most)
        if formula != 0:
            symbol = sympy.Symbol(f"{deflection.name}_{a}_{power}", real=True)
            projection.moments[symbol] = Moment(a, power, formula)
            terms.append(symbol * factor * deflection.length ** (1 + power - a))
    return sympy.Add(*terms)


def _torque(projection: Projection, density: Energies) -> Any:
    """Lagrange's expression for the phase, integrated over the link, to first order in the amplitudes."""
    deflection = projection.deflection
    first = Energies(*(_first_order(each, deflection.derivatives) for each in density))
    M, C, K, d = (
        row.row(0) for row in taylor_expansion(sympy.Matrix([equation(first, PHASE)]), deflection.derivatives)
    )
    powers = _powers(-d[0], deflection.position)
    terms = [factor * deflection.length ** (k + 1) / (k + 1) for k, factor in powers.items()]
    for times, row in enumerate((K, C, M)):
        for a in range(3):
            column = _moment_terms(projection, row[a], a)
            moments = sorted(column.free_symbols & set(projection.moments), key=str)
            terms.append(
                column.xreplace({moment: _weighted_moment(projection, moment, times) for moment in moments})
            )
    return sympy.Add(*terms)


def _weighted_moment(projection: Projection, moment: sympy.Symbol, times: int) -> Moving:
    """Symbol of the scalar product of a column with the amplitudes' time derivatives of order `times`."""
    symbol = Moving(f"{moment.name}_q")
    projection.weighted[symbol] = moment
    return symbol.motion[times]


def _first_order(expression: Any, moving: tuple[Moving, ...]) -> Any:
    """Taylor expansion to first order in coordinates and their rates."""
    symbols = [*moving, *(symbol.rate for symbol in moving)]
    rest = dict.fromkeys(symbols, sympy.S.Zero)
    return sympy.Add(expression.xreplace(rest), *(s * expression.diff(s).xreplace(rest) for s in symbols))


def _zeroed(moving: list[Moving]) -> Mapping[sympy.Basic, Any]:
    return dict.fromkeys((s for symbol in moving for s in symbol.motion), sympy.S.Zero)


def _powers(expression: Any, x: sympy.Symbol) -> dict[int, Any]:
    """Coefficients of a polynomial in x; keys are the powers."""
    factors: dict[int, list[Any]] = {}
    for term in sympy.Add.make_args(sympy.expand(expression)):
        factor, varying = term.as_independent(x, as_Add=False)
        base, power = varying.as_base_exp() if varying.has(x) else (x, sympy.S.Zero)
        if base != x or not power.is_Integer or power < 0:
            raise UnsupportedExpressionError(f"energies must be polynomials in {x}; given: {varying}")
        factors.setdefault(int(power), []).append(factor)
    sums = {power: gathered(sympy.Add(*terms)) for power, terms in sorted(factors.items())}
    return {power: factor for power, factor in sums.items() if factor != 0}


K = sympy.Symbol("k", integer=True, positive=True)
PAIRS = '''\
def _pairs(integral, count):
    """Matrix of an integral of two mode functions, with row i and column j."""
    numbers = range(1, count + 1)
    return casadi.DM([[integral(i, j) for j in numbers] for i in numbers])'''
COLUMN = '''\
def _column(integral, count):
    """Column of an integral of one mode function, with row j."""
    return casadi.DM([integral(j) for j in range(1, count + 1)])'''
RESIDUAL = '''\
def _residual(name, matrices):
    """Function that returns the residual r of the linear equations with the given matrices."""
    *drive, p = (casadi.SX.sym(each, matrices.size1_in(each)) for each in matrices.name_in())
    q, qd, qdd = (casadi.SX.sym(each, matrices.size1_out("d")) for each in ("q", "qd", "qdd"))
    M, C, K, d = matrices(*drive, p)
    names = [*matrices.name_in()[:-1], "q", "qd", "qdd", "p"]
    r = M @ qdd + C @ qd + K @ q - d
    return casadi.Function(name, [*drive, q, qd, qdd, p], [r], names, ["r"])'''
AMPLITUDES = ("coordinates", "rates", "accelerations")


def definitions(projection: Projection) -> dict[sympy.Symbol, str]:
    """Mapping from symbols to the source code of their values, for the symbols of the projected equations and
    of deflections at a position."""
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
    """Mapping from the symbols of `Field.line` to the source code of their values.

    The position is the fraction `running` of the length.
    """
    printer, modes = CasadiPrinter(), deflection.modes
    length = printer.doprint(deflection.length)
    texts = {deflection.position: f"({length})*{RUNNING}"}
    for order, local in enumerate(deflection.derivatives):
        shape = f"_{deflection.name}({RUNNING}, {order}, {modes})"
        texts[local] = f"casadi.dot({shape}, coordinates)" + (f"/({length})**{order}" if order else "")
    return texts


def field_tools(projection: Projection) -> list[str]:
    """Source code of the functions that the definitions of a projection call."""
    return [
        _modes(projection.deflection),
        *([PAIRS] if projection.pairs else []),
        *([COLUMN] if projection.moments else []),
        RESIDUAL,
        *(_pair(name, pair) for name, pair in projection.pairs.items()),
        *(_moment(name, moment) for name, moment in projection.moments.items()),
    ]


def field_functions(deflection: Field, given: str, options: Sequence[str]) -> list[str]:
    """Source code of the functions for the residuals and the mode functions.

    given: source code of the parameters of these functions. options: names of the module's options.
    """
    passed = ", ".join(f"{name}={name}" for name in options)
    modes = deflection.modes
    residuals = [
        f'''\
def residual{suffix}({given}):
    """{doc}."""
    return _residual("residual{suffix}", linearised{suffix}({passed}))'''
        for suffix, doc in (
            ("", "Residual r of the linear equation of motion r = 0"),
            ("_varying", "Residual r of the linear equation of motion at varying speed"),
        )
    ]
    fields = f'''\
def fields({given}):
    """Mode functions of the entry of FIELDS at the fraction xi of the length."""
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
    """Mode functions psi_1 to psi_count of {deflection.name} at xi = x/length, differentiated with respect to
    xi."""
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
