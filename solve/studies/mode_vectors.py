"""All Floquet modes of a system at one point, over the period, on a grid that several points share."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from solve.arrays import EPS, ROUND_OFF, Array
from solve.certify.all_multipliers import multiplier_errors, step_maps
from solve.certify.comparison import NO_DIGIT
from solve.kernel import slicot
from solve.methods.free import free
from solve.methods.method import Method
from solve.period.blocks import Blocks, balanced_blocks
from solve.period.floquet_modes import ALIASED, periodic_parts
from solve.period.frozen import FrozenModes, balanced, frozen
from solve.period.points import SinglePoint
from solve.period.product_eigenvalues import (
    ProductEigenvalues,
    eigenvalue_logarithms,
    product_eigenvalues,
)

SURE = 10.0
"""Two exponents count as distinct if the ratio of their difference to the sum of their estimated errors is at
least this number. Chosen by judgement."""


@dataclass(frozen=True)
class ModeVectors:
    """Floquet modes p(φ) exp(λt) of a system at a speed, without rigid-body modes or unresolved modes.

    Attributes
    ----------
    rotation : float
        2π/T in rad/s.
    nodes, weights : (m,)
        Phases at the starts of the steps, scaled to 2π per period, and their weights in a mean over the
        period.
    exponents : (k,)
        Complex exponents λ in 1/s, with imaginary parts within ±π/T.
    errors : (k,)
        Estimated absolute errors of the exponents in 1/s.
    parts : (m, N, k)
        Vectors p at the nodes: coordinates, then their derivatives with respect to time.
    inertia : (n,)
        Mean inertia of each coordinate, in an arbitrary common unit.
    """

    rotation: float
    nodes: Array
    weights: Array
    exponents: Array
    errors: Array
    parts: Array
    inertia: Array

    @property
    def inverse(self) -> Array:
        """Left inverse (m, k, N) of p at the nodes."""
        return self._inverse

    @cached_property
    def _inverse(self) -> Array:
        return np.linalg.pinv(self.parts)

    @property
    def resolved(self) -> bool:
        """Whether the nodes resolve the harmonics of all modes: in no mode may the fraction in the upper
        third of the harmonics exceed the limit of `solve.period.floquet_modes`."""
        most = (len(self.nodes) - 1) // 2
        harmonics = np.arange(-most, most + 1)
        power = self.power(harmonics).sum(axis=1)
        upper = power[:, 3 * np.abs(harmonics) > len(self.nodes)].sum(axis=1)
        return bool((upper <= ALIASED * power.sum(axis=1)).all())

    def power(self, harmonics: Array) -> Array:
        """Squared amplitudes |p_h|² (k, n, h) of the given harmonics of each mode and coordinate, weighted by
        the inertia of the coordinates."""
        coordinates, m = self.parts[:, : len(self.inertia)], len(self.nodes)
        if self._is_uniform:
            amplitudes = np.fft.fft(coordinates, axis=0)[harmonics % m] / m
        else:
            waves = self.weights[:, None] * np.exp(-1j * np.outer(self.nodes, harmonics))
            amplitudes = np.tensordot(waves, coordinates, axes=(0, 0))
        return np.moveaxis(np.abs(amplitudes) ** 2 * self.inertia[:, None], (0, 1, 2), (2, 1, 0))

    @property
    def _is_uniform(self) -> bool:
        """Whether the nodes divide the period evenly, so that a fast Fourier transform applies."""
        uniform = np.arange(len(self.nodes)) * (2 * math.pi / len(self.nodes))
        return bool(np.abs(self.nodes - uniform).max() <= ROUND_OFF)

    def distances(self, others: Array) -> Array:
        """Distances (k, j) of the exponents from `others` (j,), with imaginary parts modulo 2π/T."""
        difference = self.exponents[:, None] - others
        angles = np.angle(np.exp(2j * math.pi * np.imag(difference) / self.rotation))
        return np.hypot(np.real(difference), angles * self.rotation / (2 * math.pi))

    @cached_property
    def partners(self) -> Array:
        """Index (k,) of the complex conjugate of each mode; the index of the mode itself if its multiplier is
        real."""
        return self.distances(self.exponents.conj()).argmin(axis=1)

    @cached_property
    def coincident(self) -> Array:
        """Mask (k, k) of the pairs of modes whose exponents are equal within their errors. Individual
        eigenvectors of such a pair are undetermined; only the plane that they span is known."""
        limit = SURE * (self.errors[:, None] + self.errors)
        return self.distances(self.exponents) <= limit


def mode_vectors(point: SinglePoint, method: Method, steps: int, rtol: float, engine: str) -> ModeVectors:
    """Compute the modes of a point by a method with step maps. The errors of the exponents are estimated with
    one more stage per step. They correspond to relative errors of at least `rtol` in the multipliers. Raises
    SolveError subclasses."""
    finer = method.with_another_stage
    assert finer is not None
    frozen_modes = frozen(point)
    equations = balanced(point, frozen_modes)
    (grid, (maps,)), (_, (others,)) = (step_maps(equations, each, steps, engine) for each in (method, finer))
    blocks, eigenvalues = _eigenvalues(maps)
    errors = multiplier_errors(_logarithms(others), eigenvalues)
    is_kept = (errors < NO_DIGIT) & np.isfinite(eigenvalues.logarithms[0])
    is_kept[_rigid(point, eigenvalues.logarithms[0])] = False
    kept, period = np.flatnonzero(is_kept), grid.period / point.speed
    parts = periodic_parts(maps, grid, blocks, eigenvalues)[:, :, kept]
    parts[:, point.n :] *= point.speed
    parts /= np.sqrt((np.abs(parts) ** 2).sum(axis=1).mean(axis=0))
    return ModeVectors(
        2 * math.pi / period,
        grid.nodes[:-1] * (2 * math.pi / grid.period),
        (grid.h + np.roll(grid.h, 1)) / (2 * grid.period),
        eigenvalues.logarithms[0][kept] / period,
        np.fmax(errors[kept], rtol) / period,
        parts,
        _inertia(point, frozen_modes, blocks.units[0]),
    )


def _rigid(point: SinglePoint, logarithms: Array) -> Array:
    """Return the indices of the multipliers of rigid-body modes, which are the multipliers nearest to +1."""
    held = free(point)
    count = 0 if held is None else int(held.modes.multiplicity[0])
    return np.argsort(np.abs(logarithms), kind="stable")[:count]


def _inertia(point: SinglePoint, modes: FrozenModes, units: Array) -> Array:
    """Return the mean of the diagonal of M (n,), relative to its largest entry. Systems with first-order
    states have no inertia; for these, return weights from `units` (N,), the units that balance the step
    maps."""
    if point.first_order:
        return 1 / units[: point.n] ** 2
    mean = np.abs(modes.mean_mass[0].diagonal())
    return mean / mean.max()


def _eigenvalues(maps: Array) -> tuple[Blocks, ProductEigenvalues]:
    """Return block products of the step maps (m, N, N), and the eigenvalues and right eigenvectors of the
    product of all maps."""
    if slicot.available():
        blocks = balanced_blocks(maps[None])
        return blocks, product_eigenvalues(blocks.factors, blocks.rounding, vectors=True)
    Phi = np.eye(maps.shape[-1])
    for step in maps:
        Phi = step @ Phi
    rho, vectors = np.linalg.eig(Phi)
    with np.errstate(divide="ignore"):
        logarithms = np.log(rho.astype(complex))
        errors = len(maps) * EPS * np.linalg.norm(Phi, 2) / np.abs(rho)
    blocks = Blocks(Phi[None, None], np.zeros((1, 1, *Phi.shape)), np.ones((1, len(Phi))), np.zeros(1, int))
    right = vectors.astype(complex)[None, None]
    return blocks, ProductEigenvalues(logarithms[None], errors[None], right, None)


def _logarithms(maps: Array) -> Array:
    """Return the logarithms (N,) of the eigenvalues of the product of the step maps."""
    if slicot.available():
        return eigenvalue_logarithms(balanced_blocks(maps[None]).factors[0])
    return _eigenvalues(maps)[1].logarithms[0]
