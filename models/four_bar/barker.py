"""Mobility, Grashof's condition and Barker's fourteen classes of planar four-bar linkages (sections 3.2 and
3.4 of the thesis).

C. R. Barker, A complete classification of planar four-bar linkages, Mech. Mach. Theory 20 (1985) 535-554.
Barker's solution space has the coordinates λ2, λ3, λ4: the lengths of coupler, follower and ground link,
divided by the length of the crank. Three planes divide the space into eight regions. On each plane, one pair
of links is as long as the other pair:

    u2 = L1 + L2 - L3 - L4 = 0,   u3 = L1 + L3 - L2 - L4 = 0,   u4 = L1 + L4 - L2 - L3 = 0

The signs of u2, u3, u4 determine the class. Let s and l be the lengths of the shortest and the longest link,
and p and q those of the others:

- s + l < p + q: each pair that contains s is shorter than the other pair, and u2 u3 u4 is negative;
- s + l > p + q: each pair that contains l is longer than the other pair, and u2 u3 u4 is positive;
- on one of the planes, the linkage has a change point."""

import math
from dataclasses import dataclass

from models.four_bar.linkage import Linkage


@dataclass(frozen=True)
class BarkerClass:
    """One of the fourteen classes: number, symbol, name, category and distinctive link (Table 3.1 of the
    thesis)."""

    number: int
    symbol: str
    name: str
    category: str
    mark: str


CLASSES = {
    kind.symbol: kind
    for kind in (
        BarkerClass(1, "GCCC", "Grashof crank-crank-crank", "Grashof", "frame L4 shortest"),
        BarkerClass(2, "GCRR", "Grashof crank-rocker-rocker", "Grashof", "input L1 shortest"),
        BarkerClass(3, "GRCR", "Grashof rocker-crank-rocker", "Grashof", "coupler L2 shortest"),
        BarkerClass(4, "GRRC", "Grashof rocker-rocker-crank", "Grashof", "output L3 shortest"),
        BarkerClass(5, "RRR1", "class 1 rocker-rocker-rocker", "non-Grashof", "frame L4 longest"),
        BarkerClass(6, "RRR2", "class 2 rocker-rocker-rocker", "non-Grashof", "input L1 longest"),
        BarkerClass(7, "RRR3", "class 3 rocker-rocker-rocker", "non-Grashof", "coupler L2 longest"),
        BarkerClass(8, "RRR4", "class 4 rocker-rocker-rocker", "non-Grashof", "output L3 longest"),
        BarkerClass(9, "CPCCC", "change point crank-crank-crank", "change point", "frame L4 shortest"),
        BarkerClass(10, "CPCRR", "change point crank-rocker-rocker", "change point", "input L1 shortest"),
        BarkerClass(11, "CPRCR", "change point rocker-crank-rocker", "change point", "coupler L2 shortest"),
        BarkerClass(12, "CPRRC", "change point rocker-rocker-crank", "change point", "output L3 shortest"),
        BarkerClass(13, "CP2X", "double change point", "change point", "two pairs of equal links"),
        BarkerClass(14, "CP3X", "triple change point", "change point", "four equal links"),
    )
}
"""Mapping from symbols to the fourteen classes, in Barker's order. Names and symbols state whether input,
coupler and output rotate fully (crank) or not (rocker) relative to the frame. Table 3.1 of the thesis prints
crank-rocker-crank for GCRR and CPCRR.
"""

REGIONS = {
    (-1, -1, -1): "GCRR",
    (-1, +1, +1): "GRCR",
    (+1, -1, +1): "GRRC",
    (+1, +1, -1): "GCCC",
    (+1, +1, +1): "RRR2",
    (+1, -1, -1): "RRR3",
    (-1, +1, -1): "RRR4",
    (-1, -1, +1): "RRR1",
}
"""Mapping from the signs of u2, u3, u4 to the classes."""


def classify(linkage: Linkage) -> BarkerClass:
    """Return the class of a linkage. Sums of lengths that differ by round-off count as equal.

    If one sign is zero, the class is the change-point class of the adjacent Grashof region.

    >>> classify(Linkage(0.170, 0.328, 0.525, 0.547)).symbol
    'GCRR'
    """
    signs = _signs(linkage)
    zeros = signs.count(0)
    if zeros == 0:
        return CLASSES[REGIONS[signs]]
    if zeros > 1:
        return CLASSES["CP2X" if zeros == 2 else "CP3X"]
    grashof = -math.prod(sign for sign in signs if sign)
    u2, u3, u4 = (sign or grashof for sign in signs)
    return CLASSES["CP" + REGIONS[u2, u3, u4].removeprefix("G")]


def satisfies_grashof(linkage: Linkage) -> bool:
    """Return whether s + l <= p + q, so that at least one link can rotate fully relative to the others
    (section 3.4 of the thesis)."""
    return classify(linkage).category != "non-Grashof"


def solution_space(linkage: Linkage) -> tuple[float, float, float]:
    """Return the coordinates λ2, λ3, λ4 of a linkage in Barker's solution space."""
    return linkage.L2 / linkage.L1, linkage.L3 / linkage.L1, linkage.L4 / linkage.L1


def base_plane(linkage: Linkage) -> float:
    """Return the distance λ of the base plane that contains the linkage, λ2 + λ3 + λ4 = √3 λ, from the
    origin."""
    return sum(solution_space(linkage)) / math.sqrt(3)


def mobility(links: int = 4, single: int = 4, double: int = 0) -> int:
    """Return the number of degrees of freedom 3(k - 1) - 2 j1 - j2 of a planar mechanism, by Kutzbach's
    formula (section 3.2 of the thesis).

    `links` is k, the number of links including the ground; `single` and `double` are j1 and j2, the numbers
    of joints with one and with two degrees of freedom.

    >>> mobility()
    1
    """
    return 3 * (links - 1) - 2 * single - double


def _signs(linkage: Linkage) -> tuple[int, int, int]:
    L1, L2, L3, L4 = linkage.lengths
    u2, u3, u4 = (
        0 if abs(u) <= linkage.slack else int(math.copysign(1, u))
        for u in (L1 + L2 - L3 - L4, L1 + L3 - L2 - L4, L1 + L4 - L2 - L3)
    )
    return u2, u3, u4
