"""The classes with which a user states a mechanism, and which `solve.load` accepts."""

from derive.mechanism import MechanismStatement
from derive.structure import StructureStatement


class Mechanism(MechanismStatement):
    """A mechanism driven at constant speed Ω, stated by its energies.

    Everything is in coherent SI units. `kinetic` T, `potential` V and `dissipation` R
    (Rayleigh's function, half the power lost) are SymPy expressions in the coordinates, their
    rates (`derive.rate`), the parameters and `phase` φ = Ωt. `energy` is the unit of T and V,
    to be changed only for an equation without physical units. `damping_ratio` ζ, one for all modes or a
    sequence in the order of rising frequencies, of which the last counts for all that follow, adds
    M Φ diag(2ζω) Φᵀ M q̇ with the modes of M and K at speed 0 at every position.
    """

    __slots__ = ()

    def code(self) -> str:
        """Text of the generated module, for `solve.load(mechanism, …)`. Raises DeriveError subclasses."""
        # Loaded here: a statement alone needs no code generation.
        from derive.in_memory import code

        return code(self)


class Structure(StructureStatement, Mechanism):
    """Links that are beams in the plane, and the joints between them.

    A joint is a pin unless `weld` or `clamp` says otherwise: its links share its place, and each turns
    for itself. `damping_ratio` is that of every mode. Energies and coordinates follow from the links
    and from the elements that the user of the generated module chooses, link by link.
    """

    __slots__ = ()
