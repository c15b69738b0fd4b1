"""Beam elements: local matrices from generated tables."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial

from solve.arrays import Array
from solve.model.generated import beam_elements

AXIAL, BENDING = 1, 2
"""Directions of degrees of freedom. The value is the order of the derivative of the displacement in the
strain energy."""

Function = Callable[[Array], Array]

EXACT = "dynamic"
"""Name of the element whose shape functions solve the vibration equation. It has the degrees of freedom of
the cubic element."""


class Freedom(NamedTuple):
    """Degree of freedom: the derivative of order `order` of the axial or transverse displacement at ξ =
    x/L."""

    direction: int
    order: int
    xi: float


@dataclass(frozen=True)
class Element:
    """Plane beam element with k degrees of freedom, axial ones first.

    mass, elongation, bending, geometric, coupling: matrices (k, k) of an element of unit length. coefficients
    (k, p): coefficients of 1, ξ, ξ², … in the shape functions."""

    name: str
    freedoms: tuple[Freedom, ...]
    mass: Array
    elongation: Array
    bending: Array
    geometric: Array
    coupling: Array
    coefficients: Array

    @cached_property
    def axial(self) -> Array:
        """Mask (k,) of the axial degrees of freedom."""
        return np.array([freedom.direction == AXIAL for freedom in self.freedoms])

    @cached_property
    def axes(self) -> Array:
        """Coefficient matrices (3, k, k) of 1, c and s in the rotation R from ground axes to link axes
        (thesis, Eq. (4.26)).

        In ground axes, u and v are replaced by the displacements x and y."""
        axes = np.zeros((3, len(self.freedoms), len(self.freedoms)))
        for (i, one), (j, other) in product(enumerate(self.freedoms), repeat=2):
            if one.order > 0:
                axes[0, i, i] = 1.0
            elif i == j:
                axes[1, i, i] = 1.0
            elif (one.xi, 0) == (other.xi, other.order):
                axes[2, i, j] = 1.0 if one.direction == AXIAL else -1.0
        return axes

    def scaled(self, table: Array, L: float) -> Array:
        """Convert a matrix `table` (k, k) for degrees of freedom that include derivatives with respect to ξ.
        The result is for derivatives with respect to x."""
        return table * np.multiply.outer(self._powers(L), self._powers(L))

    def shapes(self, L: float, xi: Array, order: int = 0) -> tuple[Array, Array]:
        """Return axial and transverse displacements at ξ for unit degrees of freedom, (points, k) each, or
        their derivatives of order `order` with respect to x."""
        coefficients = polynomial.polyder(self.coefficients, order, axis=1)
        powers = xi[:, None] ** np.arange(coefficients.shape[1])
        shapes = powers @ coefficients.T * self._powers(L) / L**order
        return shapes * self.axial, shapes * ~self.axial

    def _powers(self, L: float) -> Array:
        return L ** np.array([freedom.order for freedom in self.freedoms], dtype=float)


@lru_cache
def element(name: str) -> Element:
    """Element with this name in the generated tables. The exact element has the degrees of freedom of the
    cubic element."""
    tables = beam_elements()
    stated = tables.ELEMENTS["cubic" if name == EXACT else name]
    axial, bending = families = [tables.FAMILIES[stated[direction]] for direction in ("axial", "bending")]
    freedoms = tuple(
        Freedom(family["strain"], order, xi) for family in families for order, xi in family["freedoms"]
    )
    k, split = len(freedoms), len(axial["freedoms"])
    a, b = slice(0, split), slice(split, k)
    coupling = _filled((k, k), (a, b, stated["coupling"]))
    terms = [len(family["shapes"][0]) for family in families]
    return Element(
        name,
        freedoms,
        mass=_filled((k, k), (a, a, axial["mass"]), (b, b, bending["mass"])),
        elongation=_filled((k, k), (a, a, axial["stiffness"])),
        bending=_filled((k, k), (b, b, bending["stiffness"])),
        geometric=_filled((k, k), (b, b, bending["geometric"])),
        coupling=coupling.T - coupling,
        coefficients=_filled(
            (k, max(terms)), (a, slice(terms[0]), axial["shapes"]), (b, slice(terms[1]), bending["shapes"])
        ),
    )


def _filled(shape: tuple[int, int], *blocks: tuple[slice, slice, Sequence]) -> Array:
    """Matrix with the given blocks (rows, columns, values) and zeros elsewhere."""
    matrix = np.zeros(shape)
    for rows, columns, values in blocks:
        matrix[rows, columns] = values
    return matrix
