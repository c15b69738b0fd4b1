"""Local matrices of beam elements, from the generated tables."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from solve.arrays import Array
from solve.model.generated import beam_elements

AXIAL, BENDING = 1, 2
"""Order of the derivative that the strain energy holds; it names the direction of a freedom."""

EXACT = "dynamic"
"""The element whose shape functions solve the equation of vibration; its freedoms are the cubic one's."""


class Freedom(NamedTuple):
    """The derivative of order `order` of the axial or transverse displacement at ξ = x/L."""

    direction: int
    order: int
    xi: float


@dataclass(frozen=True)
class Element:
    """A plane beam element: axial freedoms first, then those of bending, k together.

    mass, elongation, bending, geometric and coupling are (k, k) for unit length; coefficients (k, p) of
    the shape functions are those of 1, ξ, ξ², ….
    """

    name: str
    freedoms: tuple[Freedom, ...]
    unit_mass: Array
    unit_elongation: Array
    unit_bending: Array
    unit_geometric: Array
    unit_coupling: Array
    coefficients: Array

    def mass(self, L: float, mu: float) -> Array:
        """Mass matrix for derivatives by x (kg, kg m, …): thesis (4.22)."""
        return mu * L * self._scaled(self.unit_mass, L)

    def stiffness(self, L: float, EA: float, EI: float) -> Array:
        """Stiffness matrix for derivatives by x (N/m, N, …): thesis (4.11)."""
        return EA / L * self.unit_elongation + EI / L**3 * self._scaled(self.unit_bending, L)

    def geometric(self, L: float) -> Array:
        """Stiffness by a unit axial force, tension positive (1/m, 1, …): thesis (4.38)."""
        return self._scaled(self.unit_geometric, L) / L

    def coupling(self, L: float, mu: float) -> Array:
        """Skew P = ∫ ρA Nᵀ S N dx, S = [[0, −1], [1, 0]]: how rotation couples both displacements."""
        return mu * L * self._scaled(self.unit_coupling, L)

    def strains(self, L: float, xi: Array) -> tuple[Array, Array]:
        """Elongation u′ and curvature v″ (points, k) at ξ for each unit freedom."""
        axial = np.array([each.direction == AXIAL for each in self.freedoms])
        return self._derivative(L, xi, AXIAL) * axial, self._derivative(L, xi, BENDING) * ~axial

    def displacement(self, L: float, xi: Array) -> tuple[Array, Array]:
        """Axial and transverse displacement (points, k) at ξ for each unit freedom."""
        shapes = self._derivative(L, xi, 0)
        axial = np.array([each.direction == AXIAL for each in self.freedoms])
        return shapes * axial, shapes * ~axial

    def rotation(self, L: float, xi: Array) -> Array:
        """Rotation v′ (points, k) of the axis at ξ for each unit freedom."""
        bending = np.array([each.direction == BENDING for each in self.freedoms])
        return self._derivative(L, xi, 1) * bending

    def _derivative(self, L: float, xi: Array, order: int) -> Array:
        """Derivative by x of the shape functions (points, k) at ξ."""
        coefficients = polynomial.polyder(self.coefficients, order, axis=1)
        powers = xi[:, None] ** np.arange(coefficients.shape[1])
        return powers @ coefficients.T * self._powers(L) / L**order

    def _scaled(self, table: Array, L: float) -> Array:
        return table * np.multiply.outer(self._powers(L), self._powers(L))

    def _powers(self, L: float) -> Array:
        return L ** np.array([each.order for each in self.freedoms], dtype=float)


@lru_cache
def element(name: str) -> Element:
    """The element of a name that the generated tables know; the exact one has the cubic's freedoms."""
    tables = beam_elements()
    stated = tables.ELEMENTS["cubic" if name == EXACT else name]
    families = [tables.FAMILIES[stated[direction]] for direction in ("axial", "bending")]
    freedoms = tuple(
        Freedom(family["strain"], order, xi) for family in families for order, xi in family["freedoms"]
    )
    axial, bending = (
        {name: np.array(family[name], dtype=float) for name in ("mass", "stiffness", "shapes")}
        for family in families
    )
    none_axial, none_bending = (np.zeros_like(each["mass"]) for each in (axial, bending))
    return Element(
        name,
        freedoms,
        _diagonal(axial["mass"], bending["mass"]),
        _diagonal(axial["stiffness"], none_bending),
        _diagonal(none_axial, bending["stiffness"]),
        _diagonal(none_axial, np.array(families[1]["geometric"], dtype=float)),
        _skew(np.array(stated["coupling"], dtype=float)),
        _stacked(axial["shapes"], bending["shapes"]),
    )


def _diagonal(first: Array, second: Array) -> Array:
    """Two square blocks on the diagonal."""
    k = len(first)
    whole = np.zeros((k + len(second),) * 2)
    whole[:k, :k], whole[k:, k:] = first, second
    return whole


def _skew(X: Array) -> Array:
    """[[0, −X], [Xᵀ, 0]] for X (axial, bending)."""
    a, b = X.shape
    return np.block([[np.zeros((a, a)), -X], [X.T, np.zeros((b, b))]])


def _stacked(first: Array, second: Array) -> Array:
    """Rows of both, filled up with zeros to the same length."""
    width = max(first.shape[1], second.shape[1])
    return np.vstack([np.pad(rows, ((0, 0), (0, width - rows.shape[1]))) for rows in (first, second)])
