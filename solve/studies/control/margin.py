"""Smallest change of parameters that makes a stable system unstable."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from solve.arguments import checked_rtol, unique_names
from solve.arrays import Array
from solve.derivatives.figures import DIFFERENCE_STEP
from solve.errors import ControlError, SolveError, ValueOutOfBoundsError, require_name
from solve.period.multipliers import UNIT_CIRCLE
from solve.results.controller import StabilityMargin
from solve.results.stability import Stability
from solve.single import floquet
from solve.system import PeriodicSystem, of_system
from solve.units import speed_in_si

_SCAN = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.7, 0.85, 1.0)
"""Distances along a ray between which the boundary is sought. The last one is the largest distance that is
searched. Chosen by judgement."""

_TURNS, _GAIN = (1.0, 0.5, 0.25, 0.1), 1e-4
"""Fractions of the rotation towards the normal of the boundary that are tried one after another, and relative
decrease of the distance below which the search ends. Chosen by judgement."""

_TOLERANCE, _BESIDE = 1e-6, 1e-3
"""Relative tolerance of the distance to the boundary; and the relative distance from the boundary, on either
side, at which verdicts are computed. Chosen by judgement."""


@of_system
def stability_margin(
    system: PeriodicSystem, speed: float | str, by: Sequence[str], rtol: float = 1e-6
) -> StabilityMargin:
    """Find the smallest relative change of parameters that makes a system unstable.

    Parameters
    ----------
    system : PeriodicSystem
        Asymptotically stable system with parameters, such as the closed loop of a model.
    speed : float or str
        Ω in rad/s, or a string with a unit.
    by : sequence of str
        Names of parameters whose values are not 0.
    rtol : float
        Relative tolerance of the multipliers.

    Returns
    -------
    StabilityMargin
        Distance √Σ(Δp/p)², the changes, and the verdicts on both sides of the boundary. Changes of up to 100
        % are searched; if no boundary is found, the distance is infinite.

    Raises
    ------
    ControlError
        For a system that is not asymptotically stable.
    SolveError
        Other subclasses for bad input.

    Notes
    -----
    The boundary |ρ| = 1 is located on rays from the unchanged parameters. At the nearest point of the
    boundary, the normal of the boundary is parallel to the ray. The ray is therefore rotated towards the
    normal as long as the distance decreases. On the first ray only one parameter changes: the one that
    reaches the boundary with the smallest change. The minimum is a local one.

    Examples
    --------
    >>> import solve
    >>> mathieu = solve.load("mathieu", delta=1.2, epsilon=0.3, zeta=0.01)
    >>> round(stability_margin(mathieu, 1.0, ["delta"]).changes["delta"], 4)
    -0.0453
    """
    names, omega, rtol = unique_names(by), speed_in_si(speed), checked_rtol(rtol)
    for name in names:
        require_name(f"parameter of {system.labels.name}", name, system.labels.parameters)
        if not system.labels.parameters[name]:
            raise ValueOutOfBoundsError(
                f"{name} is 0, so that its relative change is undefined; name parameters that differ from 0"
            )
    if not names:
        raise ValueOutOfBoundsError("'by' is empty; give names of parameters that differ from 0")
    return _Boundary(system, omega, names, rtol).nearest()


class _Boundary:
    """Boundary of stability in the space of relative changes δ (r,) of parameters."""

    def __init__(self, system: PeriodicSystem, speed: float, names: Sequence[str], rtol: float):
        self._system, self._speed, self._names, self._rtol = system, speed, names, rtol

    def nearest(self) -> StabilityMargin:
        """Point of the boundary that is nearest to the unchanged parameters. Raises ControlError for a system
        that is not asymptotically stable."""
        unit = np.eye(len(self._names))
        verdict = self._stability(0 * unit[0]).verdict
        if verdict != "asymptotically stable":
            raise ControlError(
                f"{self._system.labels.name} is {verdict}; a margin requires an asymptotically stable system"
            )
        distance, ray = min(((self._distance(ray), ray) for ray in (*unit, *-unit)), key=lambda pair: pair[0])
        if not np.isfinite(distance):
            return StabilityMargin(np.inf, {}, ())
        improved = True
        while improved and len(unit) > 1:
            improved = False
            normal = self._normal(distance * ray)
            for turn in _TURNS:
                trial = ray + turn * (normal - ray)
                trial /= np.linalg.norm(trial)
                if (shorter := self._distance(trial)) < distance:
                    improved = shorter < (1 - _GAIN) * distance
                    distance, ray = shorter, trial
                    break
        sides = [distance * side * ray for side in (1 - _BESIDE, 1 + _BESIDE)]
        verdicts = tuple(self._stability(side).verdict for side in sides)
        changes = dict(zip(self._names, (distance * ray).tolist(), strict=True))
        return StabilityMargin(distance, changes, verdicts)

    def _distance(self, ray: Array) -> float:
        """Distance of the boundary along a ray; infinite if no boundary is found."""
        from scipy.optimize import brentq

        inside = 0.0
        for size in _SCAN:
            try:
                growth = self._growth(size * ray)
            except SolveError:
                return np.inf
            if growth > 0:
                root: Any = brentq(lambda x: self._growth(x * ray), inside, size, xtol=_TOLERANCE * size)
                return float(root)
            inside = size
        return np.inf

    def _growth(self, change: Array) -> float:
        """log |ρ| of the largest multiplier, plus the tolerance of verdicts. The sum is 0 where the motion
        ceases to be asymptotically stable."""
        return float(np.log(self._stability(change).spectral_radius)) + UNIT_CIRCLE

    def _normal(self, change: Array) -> Array:
        """Unit normal (r,) of the boundary, by central differences."""
        # If log |ρ| is accurate to 1e-6, the derivatives are accurate to 1e-2, sufficient for a direction.
        unit = DIFFERENCE_STEP * np.eye(len(change))
        slopes = np.array([self._growth(change + step) - self._growth(change - step) for step in unit])
        return slopes / (np.linalg.norm(slopes) or 1.0)

    def _stability(self, change: Array) -> Stability:
        values = {
            name: self._system.labels.parameters[name] * (1 + part)
            for name, part in zip(self._names, change.tolist(), strict=True)
        }
        return floquet(self._system.varied(values), self._speed, rtol=self._rtol)
