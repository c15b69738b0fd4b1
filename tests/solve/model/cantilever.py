"""Clamped beam with Hermite elements from scikit-fem: M and K for deflections (m) and slopes (rad)."""

import numpy as np
import skfem
from skfem.helpers import dd, ddot

LENGTH, STIFFNESS, MASS = 0.8, 40.0, 1.2  # m, N m², kg/m


def cantilever(elements=12):
    """Return M and K (2 elements, 2 elements) in SI units, and the row numbers, from 1, of the deflection and
    slope of the tip."""
    mesh = skfem.MeshLine(np.linspace(0.0, LENGTH, elements + 1))
    basis = skfem.Basis(mesh, skfem.ElementLineHermite())

    @skfem.BilinearForm
    def bending(u, v, _):
        return STIFFNESS * ddot(dd(u), dd(v))

    @skfem.BilinearForm
    def inertia(u, v, _):
        return MASS * u * v

    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(lambda x: np.isclose(x[0], 0.0)).all())
    tip = basis.nodal_dofs[:, -1]
    M, K = (form.assemble(basis).toarray()[np.ix_(free, free)] for form in (inertia, bending))
    return M, K, [int(np.flatnonzero(free == dof)[0]) + 1 for dof in tip]
