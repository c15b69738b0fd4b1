"""Map of the design method: ratio of stress to allowable stress as a function of speed and ground length L4
(section 7.5 of the thesis).

A stress ratio is the stress divided by the allowable stress. If no link is named, it is the largest ratio of
all links.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from models.four_bar.linkage import ADVISED, Linkage
from models.four_bar.stress_map import StressMap
from solve.arrays import Array
from solve.beams.structure import StructureModel
from solve.errors import MissingValueError, SolveError, UnknownNameError, ValueOutOfBoundsError
from solve.results.serialization import NOT_STORED, Serializable, stored_property

_TOLERANCE = 0.01
"""Relative error of the interpolated stress above which an interval of speeds is bisected. Chosen by
judgement."""

_SHORTEST = 0.25
"""Relative length down to which intervals of speeds are bisected, as a multiple of ζ. The relative half-power
width of a peak is 2ζ."""

_MOST_HALVINGS = 8
"""Maximum number of passes of the refinement. Chosen by judgement."""


class DesignError(SolveError):
    """Raised if the mechanism does not permit a length or a speed, regardless of the stress."""


@dataclass(frozen=True)
class DesignMap(Serializable):
    """Steady stresses of a four-bar linkage at P ascending speeds (rad/s) and g ground lengths L4 (m).

    The mechanism's own L4 is one of the lengths. `allowable` (links,) are the allowable stresses in Pa.
    `stress` (P, g, links) is the largest |stress| over a revolution, in Pa. `error` (P,) and `radius_bound`
    (P,) are those of `Peaks`; the bound is the largest for any L4. `interpolation_error` is the largest
    relative error between the speeds, as found in the last bisection.
    """

    stress_map: StressMap = field(metadata=NOT_STORED)
    model: StructureModel
    allowable: Array
    speeds: Array
    L4: Array
    stress: Array
    error: Array
    radius_bound: Array
    interpolation_error: float

    @stored_property
    def links(self) -> list[str]:
        return self.stress_map.links

    @property
    def own_L4(self) -> float:
        """Ground length L4 (m) of the mechanism itself."""
        return self.model.labels.parameters["L4"]

    @cached_property
    def own_index(self) -> int:
        """Index of the mechanism's L4 in the lengths of the map."""
        return int(np.searchsorted(self.L4, self.own_L4))

    @cached_property
    def ratios(self) -> Array:
        """Stress ratios (P, g, links) of the links."""
        return self.stress / self.allowable

    @cached_property
    def ratio(self) -> Array:
        """Largest stress ratio (P, g) of all links."""
        return self.ratios.max(axis=2)

    @property
    def own_ratio(self) -> Array:
        """Largest stress ratio (P,) of all links for the mechanism's own L4."""
        return self.ratio[:, self.own_index]

    def worst_link(self, speed: float) -> str:
        """Return the name of the link with the largest ratio at a speed of the map, for the mechanism's own
        L4."""
        at = int(np.searchsorted(self.speeds, speed))
        return self.links[int(self.ratios[at, self.own_index].argmax())]

    def error_until(self, target: float) -> float:
        """Return the relative error of the stresses, at and between the points of the map, up to the target
        speed."""
        return max(self.interpolation_error, float(np.nanmax(self.error[self.speeds <= target])))

    def until(self, target: float) -> "DesignMap":
        """Return the map up to the target speed."""
        below = int(np.count_nonzero(self.speeds < target * (1 - 1e-9)))
        if target in self.speeds:
            last = {name: getattr(self, name)[below : below + 1] for name in _BY_SPEED}
        else:
            last = _solved(self.stress_map, np.array([target]), self.L4)
        return replace(
            self, **{name: np.concatenate((getattr(self, name)[:below], last[name])) for name in _BY_SPEED}
        )


_BY_SPEED = ("speeds", "stress", "error", "radius_bound")


def design_map(
    model: StructureModel,
    allowable: Mapping[str, float],
    speeds: Array,
    lengths: tuple[float, float],
    count: int = 48,
) -> DesignMap:
    """Compute the map of a mechanism for L4 between two lengths (m). `allowable` maps links to allowable
    stresses (Pa).

    `speeds` are the initial speeds, whose intervals are bisected until the interpolation meets the tolerance.
    `count` is the number of lengths in addition to the mechanism's own. Raises DesignError for impossible
    lengths or speeds.
    """
    _require_possible(model, lengths)
    stress_map = StressMap(model, *lengths)
    L4 = np.unique([*np.linspace(*lengths, count), model.parameters["L4"]])
    stresses = DesignMap(
        stress_map,
        model,
        np.array([allowable[link] for link in stress_map.links]),
        L4=L4,
        interpolation_error=0.0,
        **_solved(stress_map, speeds, L4),
    )
    if stresses.own_ratio[0] > 1:
        raise DesignError(
            f"at {model.labels.speed_unit.text(stresses.speeds[0], '.4g')}, the lowest speed, the stress is "
            f"already {stresses.own_ratio[0]:.4g} times the allowable one; give a lower first speed in "
            "--speeds, or raise the allowable stress"
        )
    return _refined(stresses)


def _require_possible(model: StructureModel, lengths: tuple[float, float]) -> None:
    """Raise DesignError if the model has no damping, or if the mechanism's own L4 is not within the range of
    lengths."""
    low, high = lengths
    if model.parameters["zeta"] <= 0:
        raise DesignError("zeta is 0: undamped critical speeds have no finite stress; set zeta > 0")
    if not low < high:
        raise DesignError(
            f"no pivot position is possible for L4 from {low:g} to {high:g} m; widen the range of L4"
        )
    own_L4 = model.parameters["L4"]
    if not low <= own_L4 <= high:
        raise DesignError(
            f"the mechanism's own L4, {own_L4:g} m, is not between {low:.4f} and {high:.4f} m, the allowed "
            "lengths; widen --L4"
        )


def _solved(stress_map: StressMap, speeds: Array, L4: Array) -> dict[str, Array]:
    """Compute those fields of a map that depend on the speed, at speeds (P,)."""
    peaks = stress_map.peaks(speeds, L4)
    return {
        "speeds": speeds,
        "stress": peaks.stress,
        "error": peaks.error,
        "radius_bound": peaks.radius_bound.max(axis=1),
    }


def _refined(stresses: DesignMap) -> DesignMap:
    """Return a map whose speed intervals are bisected until the interpolation meets the tolerance, or a limit
    of the refinement is reached."""
    open_ = np.ones(len(stresses.speeds) - 1, dtype=bool)
    for _ in range(_MOST_HALVINGS):
        at = np.log(stresses.speeds)
        open_ &= np.diff(at) > _SHORTEST * stresses.model.labels.parameters["zeta"]
        if not open_.any():
            break
        middle = ((at[:-1] + at[1:]) / 2)[open_]
        added = _solved(stresses.stress_map, np.exp(middle), stresses.L4)
        guess = np.exp(Akima1DInterpolator(at, np.log(stresses.stress))(middle))
        guess, solved = ((stress / stresses.allowable).max(axis=2) for stress in (guess, added["stress"]))
        error = np.abs(guess / solved - 1).max(axis=1)
        rough = np.zeros(len(open_), dtype=bool)
        rough[open_] = error > _TOLERANCE
        place, open_ = 1 + np.flatnonzero(open_), np.repeat(rough, 1 + open_)
        inserted = {
            name: np.insert(getattr(stresses, name), place, added[name], axis=0) for name in _BY_SPEED
        }
        stresses = replace(stresses, interpolation_error=float(error.max()), **inserted)
    return stresses


def allowed_lengths(linkage: Linkage) -> tuple[float, float]:
    """Return the smallest and the largest L4 (m) for which the crank rotates fully and the transmission angle
    is in the advised range (section 3.3 of the thesis).

    Raises DesignError if there is no such length.
    """
    L1, L2, L3 = linkage.L1, linkage.L2, linkage.L3
    near, far = (math.sqrt(L2**2 + L3**2 - 2 * L2 * L3 * math.cos(angle)) for angle in ADVISED)
    low, high = L1 + near, far - L1
    if not low < high:
        least, most = (math.degrees(angle) for angle in ADVISED)
        raise DesignError(
            f"no L4 keeps the transmission angle between {least:g}° and {most:g}° with L1, L2, L3 = "
            f"{L1:g}, {L2:g}, {L3:g} m; shorten the crank or give --L4"
        )
    return low, high


def checked_allowable(links: list[str], given: Mapping[str, float]) -> dict[str, float]:
    """Return the allowable stresses (Pa) of the links. Raises UnknownNameError, MissingValueError,
    ValueOutOfBoundsError."""
    for link, stress in given.items():
        if link not in links:
            raise UnknownNameError("link", link, links)
        if not (math.isfinite(stress) and stress > 0):
            raise ValueOutOfBoundsError(
                f"allowable stress of the {link} is {stress / 1e6:g} MPa; allowed: finite, > 0, like 100 MPa"
            )
    missing = [link for link in links if link not in given]
    if missing:
        raise MissingValueError(
            f"no allowable stress for {', '.join(missing)}; give one for each link or one for all"
        )
    return dict(given)
