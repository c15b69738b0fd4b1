"""Rigid planar four-bar linkage: positions, velocities and accelerations (Chapter 3 of the thesis).

The crank OA rotates about the origin O, the follower CB rotates about C at (L4, 0), and the coupler AB
connects the two. t1, t2, t3 are the angles of OA, AB, CB from the x axis. The loop-closure equation is Eq.
(3.3) of the thesis:

    L1 exp(i t1) + L2 exp(i t2) = L3 exp(i t3) + L4

Positions, velocities and accelerations of points are complex numbers x + iy. Lengths are in m, angles in rad,
and times in s. Crank angles may be arrays of any shape.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from solve.arrays import Array, Plane
from solve.errors import SolveError, UnknownNameError, ValueOutOfBoundsError

BRANCHES = {"open": 1.0, "crossed": -1.0}
"""Sign of sin(t3 - t2) for each branch. B is on the left of the line from A to C for the branch "open", and
on the right for "crossed"."""

TURN = 2 * math.pi
_LENGTHS = ("L1", "L2", "L3", "L4")

ADVISED = (math.radians(40), math.radians(140))
"""Advised range of the transmission angle (section 3.3 of the thesis)."""

OUTSIDE_ADVISED = "outside {:g}°–{:g}°".format(*map(math.degrees, ADVISED))


class LinkageError(SolveError):
    """Raised if a linkage cannot be assembled at a crank angle, or at any crank angle."""


class Extremes(NamedTuple):
    """Smallest and largest value over a revolution, and the crank angles at which they occur."""

    min: float
    min_position: float
    max: float
    max_position: float


@dataclass(frozen=True)
class Linkage:
    """Four-bar linkage: lengths (m) of crank, coupler, follower and ground link, and the branch of assembly.

    Raises ValueOutOfBoundsError for a length that is not positive, UnknownNameError for an unknown branch,
    and LinkageError if the longest link is not shorter than the others together (zero mobility, Eq. (3.2) of
    the thesis).
    """

    L1: float
    L2: float
    L3: float
    L4: float
    branch: str = "open"

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, float], branch: str) -> "Linkage":
        """Linkage whose lengths are parameters of a model."""
        return cls(*(parameters[name] for name in _LENGTHS), branch=branch)

    def __post_init__(self) -> None:
        for name, length in zip(_LENGTHS, self.lengths, strict=True):
            if not (math.isfinite(length) and length > 0):
                raise ValueOutOfBoundsError(f"{name} is {length:g} m; allowed: a length > 0")
        if self.branch not in BRANCHES:
            raise UnknownNameError("branch", self.branch, BRANCHES)
        longest = max(self.lengths)
        sum_of_others = sum(self.lengths) - longest
        if longest >= sum_of_others - self.slack:
            raise LinkageError(
                f"the longest link is {longest:g} m, the others together {sum_of_others:g} m, so that no "
                "movable linkage can be assembled; shorten the longest link or lengthen the others"
            )

    @property
    def lengths(self) -> tuple[float, float, float, float]:
        """Lengths L1, L2, L3, L4."""
        return self.L1, self.L2, self.L3, self.L4

    @property
    def turns_fully(self) -> bool:
        """Whether the crank can rotate fully, so that coupler and follower are never in line."""
        return not any(self._stops)

    @property
    def crank_range(self) -> tuple[float, float]:
        """Smallest and largest |t1| within 0 … π at which the linkage can be assembled; 0 and π if the crank
        can rotate fully.

        At an end other than 0 or π, coupler and follower are in line, and the crank turns back.
        """
        folded, stretched = self._stops
        return (
            _angle_opposite(self.L1, self.L4, abs(self.L2 - self.L3)) if folded else 0.0,
            _angle_opposite(self.L1, self.L4, self.L2 + self.L3) if stretched else math.pi,
        )

    @property
    def _stops(self) -> tuple[bool, bool]:
        """Whether coupler and follower are in line at the ends of the crank's range: folded at the smallest
        |t1|, stretched at the largest."""
        L1, L2, L3, L4 = self.lengths
        fold_gap, stretch_gap = abs(L1 - L4) - abs(L2 - L3), (L2 + L3) - (L1 + L4)
        return fold_gap <= self.slack, stretch_gap <= self.slack

    @property
    def slack(self) -> float:
        """Difference (m) below which two sums of lengths count as equal. It is far above their relative
        round-off of 1e-16."""
        return 1e-12 * sum(self.lengths)

    @property
    def dead_points(self) -> tuple[float, ...]:
        """Crank angles within 0 … 2π at which crank and coupler are in line: first stretched, then folded.

        A rocking follower reverses at these angles; a follower that turns fully has no dead points. Raises
        LinkageError for a crank that cannot turn fully.
        """
        self.require_full_turn()
        L1, L2, L3, L4 = self.lengths
        if min(self.lengths) == L4:
            return ()
        stretched = _angle_opposite(L1 + L2, L4, L3)
        folded = math.pi + _angle_opposite(L2 - L1, L4, L3)
        side = BRANCHES[self.branch]
        return (side * stretched) % (TURN), (side * folded) % TURN

    def require_full_turn(self) -> None:
        """Raise LinkageError unless the crank can turn fully."""
        if self.turns_fully:
            return
        lengths = ", ".join(f"{length:g}" for length in self.lengths)
        stops = [end for end, stops in zip(self.crank_range, self._stops, strict=True) if stops]
        angles = " and ".join(f"±{math.degrees(end):.4g}°".replace("±0°", "0°") for end in stops)
        raise LinkageError(
            f"the crank cannot turn fully: with L1, L2, L3, L4 = {lengths} m, coupler and follower are "
            f"collinear at t1 = {angles}; a full turn requires |L1 - L4| > |L2 - L3| and L1 + L4 < L2 + L3"
        )

    def transmission_angle(self, t1: ArrayLike) -> Array:
        """Return the transmission angle γ, 0 … π, between coupler and follower (Eq. (3.9) of the thesis).
        Raises LinkageError for crank angles that the linkage cannot reach."""
        return np.angle(self._coupler_to_follower(np.asarray(t1, dtype=float)))

    def transmission_extremes(self) -> Extremes:
        """Return the extremes of γ over a revolution, which occur at t1 = 0 and π (Eq. (3.10) of the thesis).

        Raises LinkageError for a crank that cannot turn fully.
        """
        self.require_full_turn()
        least, greatest = self.transmission_angle([0.0, math.pi])
        return Extremes(float(least), 0.0, float(greatest), math.pi)

    def mechanical_advantage(self, t1: ArrayLike) -> Array:
        """Return the mechanical advantage T3/T1 = ω1/ω3 = L3 sin γ/(L1 sin β), where β is the angle from the
        coupler to the crank; infinite at dead points.

        The torque T1 drives the crank, and the follower delivers T3, without friction or inertia. The sign is
        positive if both links rotate in the same direction. Eq. (3.1) of the thesis prints L4 sin β instead
        of L1 sin β.
        """
        with np.errstate(divide="ignore"):
            return 1.0 / self.motion(t1).omega[2]

    def motion(self, t1: ArrayLike, omega1: ArrayLike = 1.0, alpha1: ArrayLike = 0.0) -> "Motion":
        """Return the angles, angular velocities and angular accelerations (Eq. (3.11) of the thesis) at crank
        angles t1 (rad).

        `omega1` (rad/s) and `alpha1` (rad/s²) of the crank broadcast with t1. The angles are computed from
        the triangle ABC instead of Eqs. (3.5) to (3.8) of the thesis; Eq. (3.7) prints -K1 cos t2 instead of
        +K1 cos t2.

        Raises LinkageError for angles that the linkage cannot reach, and for angles at which coupler and
        follower are in line, where the motion is undetermined.
        """
        t1, omega1, alpha1 = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (t1, omega1, alpha1)))
        turned = self._coupler_to_follower(t1)
        if np.any(turned.imag == 0.0):
            worst = np.degrees(t1[turned.imag == 0.0].flat[0])
            raise LinkageError(f"at t1 = {worst:.6g}° coupler and follower lie in line; choose another t1")
        turned = turned.real + 1j * BRANCHES[self.branch] * turned.imag
        span = self.L4 - self.L1 * np.exp(1j * t1)
        e2 = span * np.conj(self.L2 - self.L3 * turned)
        e2 /= np.abs(e2)
        directions = np.exp(1j * t1), e2, e2 * turned
        omega, alpha = rates(self.lengths, directions, (omega1, alpha1))
        return Motion(self, np.stack((t1, *map(np.angle, directions[1:]))), omega, alpha)

    def _coupler_to_follower(self, t1: Array) -> Plane:
        """Return the complex unit exp(iγ), where γ is the angle at B in the triangle ABC."""
        L2, L3 = self.L2, self.L3
        d = np.abs(self.L4 - self.L1 * np.exp(1j * t1))
        stretch, fold = L2 + L3 - d, d - abs(L2 - L3)
        out = ~(np.minimum(stretch, fold) >= -self.slack)
        if np.any(out):
            least, greatest = (math.degrees(angle) for angle in self.crank_range)
            raise LinkageError(
                f"the linkage does not close at t1 = {np.degrees(t1[out].flat[0]):.6g}°; "
                f"allowed: {least:.6g}° <= |t1| <= {greatest:.6g}°"
            )
        # A product instead of 1 - cos² avoids cancellation for angles near 0 and π.
        in_line = np.minimum(stretch, fold) <= self.slack
        product = stretch * fold * (L2 + L3 + d) * (d + abs(L2 - L3))
        turned = (L2**2 + L3**2 - d**2) + 1j * np.sqrt(np.where(in_line, 0.0, product))
        return turned / np.abs(turned)


@dataclass(frozen=True)
class Motion:
    """Angles `t`, angular velocities `omega` and angular accelerations `alpha` of the links 1, 2, 3, as
    arrays (3, …) for the crank angles (…).

    A point of a link is a complex number X + iY (m) in the frame of the link: X is measured along the link
    from its first joint (O of the crank, A of the coupler, C of the follower), and Y at +90° to it. Arrays of
    points broadcast with the crank angles.
    """

    linkage: Linkage
    t: Array
    omega: Array
    alpha: Array

    def position(self, link: int, point: complex | Plane = 0.0) -> Plane:
        """Position x + iy (m) of a point of a link; for points of the coupler see section 3.6 of the
        thesis."""
        first = {1: 0.0, 2: self._crank_pin, 3: self.linkage.L4}[link]
        return first + point * self.direction(link)

    def velocity(self, link: int, point: complex | Plane = 0.0) -> Plane:
        """Velocity (m/s) of a point of a link."""
        first = 1j * self.omega[0] * self._crank_pin if link == 2 else 0.0
        return first + 1j * self.omega[link - 1] * point * self.direction(link)

    def acceleration(self, link: int, point: complex | Plane = 0.0) -> Plane:
        """Acceleration (m/s²) of a point of a link.

        At B, the result is Eq. (3.13) of the thesis, which prints sin t1 instead of sin t2 in two places.
        """
        first = (1j * self.alpha[0] - self.omega[0] ** 2) * self._crank_pin if link == 2 else 0.0
        rate = 1j * self.alpha[link - 1] - self.omega[link - 1] ** 2
        return first + rate * point * self.direction(link)

    def direction(self, link: int) -> Plane:
        """Complex unit exp(it) in the direction of the X axis of a link."""
        return np.exp(1j * self.t[link - 1])

    @property
    def _crank_pin(self) -> Plane:
        """Position of the crank pin A relative to O."""
        return self.linkage.L1 * self.direction(1)


def rates(
    lengths: Sequence[float],
    directions: Sequence[Array | Plane],
    crank: tuple[Array, Array],
    pivot: tuple[ArrayLike, ArrayLike] = (0.0, 0.0),
) -> tuple[Array, Array]:
    """Return the angular velocities ω and angular accelerations α (3, …) of crank, coupler and follower (Eq.
    (3.11) of the thesis).

    `lengths` are L1, L2, L3, …; `directions` are exp(it) of the links; `crank` contains ω1 and α1; `pivot`
    contains the velocity and the acceleration of C along the x axis.
    """
    L1, L2, L3, *_ = lengths
    e1, e2, e3 = directions
    omega1, alpha1 = crank
    velocity, acceleration = (np.asarray(rate) for rate in pivot)
    sides = 1j * L2 * e2, -1j * L3 * e3
    omega2, omega3 = _components(*sides, velocity - 1j * L1 * omega1 * e1)
    normal = L1 * omega1**2 * e1 + L2 * omega2**2 * e2 - L3 * omega3**2 * e3
    alpha2, alpha3 = _components(*sides, acceleration - 1j * L1 * alpha1 * e1 + normal)
    return np.stack((omega1, omega2, omega3)), np.stack((alpha1, alpha2, alpha3))


def _components(first: Any, second: Any, vector: Any) -> tuple[Array, Array]:
    """Return the real numbers a and b for which a·first + b·second = vector in the plane."""
    area = np.imag(np.conj(first) * second)
    return np.imag(np.conj(vector) * second) / area, np.imag(np.conj(first) * vector) / area


def _angle_opposite(a: float, b: float, opposite: float) -> float:
    """Return the angle of a triangle between the sides a and b, opposite to the third side."""
    cosine = (a**2 + b**2 - opposite**2) / (2 * a * b)
    return math.acos(min(max(cosine, -1.0), 1.0))


def within_advised(least: float, greatest: float) -> bool:
    """Return whether a range of transmission angles lies within the advised range."""
    return ADVISED[0] <= least and greatest <= ADVISED[1]


def transmission_warnings(linkage: Linkage) -> list[str]:
    """Return a list with a warning if the transmission angle leaves the advised range; empty otherwise.

    If the crank cannot turn fully, there is always a warning, because coupler and follower are in line at the
    ends of its range.
    """
    if not linkage.turns_fully:
        return ["the crank cannot turn fully: the transmission angle reaches 0° or 180° where it turns back"]
    gamma = linkage.transmission_extremes()
    if within_advised(gamma.min, gamma.max):
        return []
    return [
        f"the transmission angle goes from {math.degrees(gamma.min):.4g}° to {math.degrees(gamma.max):.4g}°, "
        f"{OUTSIDE_ADVISED}: force transmission to the follower is poor, and its position is "
        "sensitive to errors of the lengths"
    ]
