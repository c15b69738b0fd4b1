"""Correction of models that have few elements per link, by the dynamic stiffness at the lowest frequency
(section 7.4.1 of the thesis).

At every position, M and K of the cubic elements are replaced by the exact matrices at the lowest frequency
ω1: M(ω1) = −∂D/∂(ω²) and K(ω1) = D(ω1) + ω1² M(ω1). The thesis determines ω1 by iteration from the frequency
of the cubic elements; here the algorithm of Wittrick and Williams determines it directly. The first mode is
exact; other modes are approximate, because the matrices are valid at ω1.

The shape functions N at ω1 do not contain rigid motions, so that −M(ω1) q̈_r is not the consistent inertia
load. The consistent load is −∫ ρA N(ω1)ᵀ a_r dx = [D(ω1) − D(0)] q̈_r/ω1², because N satisfies the equation
of vibration at ω1 and the acceleration a_r is linear along a link. The factor of q̈_r in this load is the
slope of the secant of D as a function of ω², whereas −M(ω1) is the slope of the tangent.
"""

from collections.abc import Callable, Mapping
from functools import cached_property

import numpy as np

from solve.approximation import interpolated
from solve.arrays import Array, LazyMapping
from solve.beams.element import EXACT
from solve.beams.frequencies import exact_frequencies
from solve.beams.motion import modal_damping
from solve.beams.structure import StructureModel
from solve.capabilities import Capabilities, Outputs
from solve.contracts import Matrices
from solve.errors import UnknownNameError
from solve.labels import Labels
from solve.system import PeriodicSystem

LOADS = ("consistent", "nodal")
"""Names of the two inertia loads: "consistent" is ∫ ρA N(ω1)ᵀ a_r dx, and "nodal" is M(ω1) q̈_r, as in the
thesis."""

_KINDS = ("deflection", "stress_plus", "stress_minus", "strain_energy")
"""Kinds of outputs that are available; joint forces are not."""

_FIXED = {"terms": "instantaneous", "stiffening": "off", "damping": "modal"}
"""Options of the model that the correction requires."""


class Corrected(PeriodicSystem, Outputs):
    """Four-bar linkage with cubic elements whose matrices are corrected at ω1.

    `load` is one of LOADS. Outputs are those of the model, computed with the exact shape functions at ω1.
    Raises UnknownNameError for another load, or for a model with options that the correction does not
    support.
    """

    def __init__(self, model: StructureModel, load: str = "consistent"):
        if load not in LOADS:
            raise UnknownNameError("load of the corrected model", load, LOADS)
        for option, value in _FIXED.items():
            if model.labels.options[option] != value:
                raise UnknownNameError(
                    f"value of option {option} of the corrected model",
                    str(model.labels.options[option]),
                    [value],
                )
        cubic, exact = (model.varied(options={"element": kind}) for kind in ("cubic", EXACT))
        super().__init__(self._equations, cubic.coordinates, cubic.period)
        self.model, self.load = model, load
        self._cubic, self._exact = cubic, exact
        self._observed = {name: place for name, place in cubic.observed.items() if place[0] in _KINDS}
        self.outputs = tuple(self._observed)
        self.labels = Labels(
            name=f"{model.labels.name}, {load} load",
            units=cubic.labels.units,
            meanings=cubic.labels.meanings,
            largest_of=cubic.labels.largest_of,
        )

    @cached_property
    def lowest(self) -> Callable[[Array], Array]:
        """Function of phases (m,) that returns the lowest frequency ω1 (m,) of exact links, in rad/s."""
        return interpolated(
            lambda phase: exact_frequencies(self._exact.at_positions(phase), 1)[:, 0], self.period
        )

    def _equations(self, phase: Array, speed: float) -> Matrices:
        squared, D, M, K = self._at_lowest(phase)
        inertia, _, static, load = self._cubic.at(phase, speed)
        rigid = -np.linalg.solve(inertia, load[..., None])
        d = (D - static) @ rigid / squared if self.load == "consistent" else -M @ rigid
        return M, self._damping(phase), K, d[..., 0]

    def _at_lowest(self, phase: Array) -> tuple[Array, Array, Array, Array]:
        """Return ω1² (m, 1, 1), and D, M and K (m, n, n) at ω1."""
        positions, omega = self._exact.at_positions(phase), self.lowest(phase)
        indices, squared = np.arange(len(omega)), (omega**2)[:, None, None]
        D, M = positions.dynamic_stiffness(indices, omega), positions.dynamic_mass(indices, omega)
        return squared, D, M, D + squared * M

    @cached_property
    def _damping(self) -> Callable[[Array], Array]:
        """Damping matrix for which every mode at every position has the damping ratio ζ."""

        def at_positions(phase: Array) -> Array:
            _, _, M, K = self._at_lowest(phase)
            return modal_damping(M, K, self._exact.beams.properties.damping_ratio)

        return interpolated(at_positions, self.period)

    def deflection(self, link: str, fraction: float, phase: Array, q: Array) -> Array:
        """Transverse displacement (k,) from the rigid motion, m, as for the model."""
        point = self._exact.point(link, fraction)
        return point.displacement(self._exact.beams.angle(phase), q, self.lowest(phase))[1]

    def stress(self, link: str, fraction: float, surface: str, phase: Array, q: Array) -> Array:
        """Axial stress (k,) on the surface "plus" or "minus", Pa, as for the model."""
        point = self._exact.point(link, fraction)
        return point.stress(self._exact.beams.angle(phase), q, surface, self.lowest(phase))

    @property
    def capabilities(self) -> Capabilities:
        return super().capabilities._replace(outputs=self)

    def output_values(
        self, phase: Array, speed: Array | float, q: Array, qd: Array, qdd: Array, acceleration: float = 0.0
    ) -> Mapping[str, Array]:
        def value(name: str) -> Array:
            kind, link, fraction = self._observed[name]
            if kind == "strain_energy":
                *_, K = self._at_lowest(phase)
                return np.einsum("ik,kij,jk->k", q, K, q, optimize=True) / 2
            if kind == "deflection":
                return self.deflection(link, fraction, phase, q)
            return self.stress(link, fraction, kind.removeprefix("stress_"), phase, q)

        return LazyMapping(list(self._observed), value)
