"""Public classes for the statement of a mechanism; `solve.load` accepts their instances."""

from collections.abc import Iterator

import sympy

from derive.checks import check
from derive.declarations import line_of
from derive.errors import DeriveError
from derive.freshness import sha256
from derive.mechanism import MechanismStatement
from derive.structure import StructureStatement
from derive.structure_text import generated_text

_MAX_CACHED = 64
"""Number of mechanisms whose generated code is cached. The longest module in `generated/` has 43 kB, so that
the cache occupies about 3 MB."""

_cache: dict[str, str] = {}


class Mechanism(MechanismStatement):
    """A mechanism driven at constant speed Ω, stated by its energies.

    All quantities are in coherent SI units. `kinetic` T, `potential` V and `dissipation` R
    (Rayleigh's function, half the power lost) are SymPy expressions in the coordinates, their
    rates (`derive.rate`), the parameters and `phase` φ = Ωt.

    Parameters
    ----------
    name : str
        Name of the mechanism and of its generated module.
    title : str
        Title for tables, figures and reports.
    energy : str, default "J"
        Unit of T and V. Change it only for equations without physical units.
    kinetic, potential, dissipation : sympy.Expr, default 0
        T, V and R; each may be set later as an attribute.
    period : sympy.Expr, default 2π
        Period in the phase, rad.
    damping_ratio : sympy.Expr or sequence of these, default 0
        Damping ratio ζ of all modes, or damping ratios in order of increasing frequency; the last value
        applies to all higher modes. The term M Φ diag(2ζω) Φᵀ M q̇ is added to the equations, where Φ and ω
        are the modes and frequencies of M and K at speed 0 and the current phase.

    Examples
    --------
    >>> from derive import Mechanism, rate
    >>> spring = Mechanism("spring", "Mass on a spring")
    >>> (q,) = spring.coordinates(q=("m", "deflection"))
    >>> m, k = spring.parameters(m=("kg", "mass", "> 0"), k=("N/m", "stiffness", "> 0"))
    >>> spring.kinetic = m * rate(q) ** 2 / 2
    >>> spring.potential = k * q**2 / 2
    >>> "def linearised(" in spring.code()
    True
    """

    __slots__ = ()

    def code(self) -> str:
        """Source code of the generated module, for `solve.load(mechanism, …)`.

        Returns
        -------
        str
            Python source of the module. Identical mechanisms are derived only once.

        Raises
        ------
        DeriveError
            One of its subclasses, according to the cause. The message states the line if it is known.
        """
        statement = "\n".join(_statement(self))
        if statement not in _cache:
            text = _derived(self, statement)
            while len(_cache) >= _MAX_CACHED:
                del _cache[next(iter(_cache))]
            _cache[statement] = text
        return _cache[statement]


class Structure(StructureStatement, Mechanism):
    """A plane structure of beams (called links) and joints.

    A joint is a pin, about which links rotate independently, unless `weld` or `clamp` declares otherwise.
    `damping_ratio` applies to every mode. Energies and coordinates follow from the links and from their
    element type, which is an option of the generated module.

    Parameters
    ----------
    name, title : str
        As for `Mechanism`.
    """

    __slots__ = ()


def _derived(mechanism: MechanismStatement, statement: str) -> str:
    try:
        check(mechanism)
        return generated_text(mechanism, sha256(statement), f"{mechanism.name}.py")
    except DeriveError as error:
        line = line_of(mechanism.lines, error)
        if line is None:
            raise
        raise type(error)(f"{mechanism.name}, line {line}: {error}") from error


def _statement(mechanism: MechanismStatement) -> Iterator[str]:
    """Yield the complete statement of a mechanism as text, with all digits of numbers."""
    yield repr(mechanism)
    if mechanism.declared_field:
        yield sympy.srepr(mechanism.declared_field.shape(*sympy.symbols("k xi")))
    for expression in (mechanism.kinetic, mechanism.potential, mechanism.dissipation, mechanism.period):
        yield sympy.srepr(expression)
    for pair in (*mechanism.forces, *mechanism.fundamental_motion.items()):
        yield sympy.srepr(pair)
    for output in mechanism.declared_outputs:
        yield sympy.srepr(output.expression)
    for declared in mechanism.declared_inputs:
        yield f"{declared} {sympy.srepr(declared.along)}"
    for sketch in mechanism.declared_sketches:
        yield sympy.srepr(sketch.points)
