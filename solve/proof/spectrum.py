"""Enclosures of the eigenvalues of an interval matrix by Gershgorin's discs, and the verdict.

With approximate eigenvectors X, D = X⁻¹ΦX is nearly diagonal. Dividing row i of D by σ and multiplying column
i by σ yields a similar matrix. If disc i of this matrix, with radius Σ_j |D_ij|/σ, does not meet any other
disc, it contains exactly one eigenvalue. With the largest such σ, the radius is of second order in the
off-diagonal entries of D."""

from dataclasses import dataclass

from solve.period.multipliers import ASYMPTOTICALLY_STABLE, STABLE, UNDETERMINED, UNSTABLE
from solve.proof.balls import Ball, Matrix, acb, acb_mat, arb, largest, norm

_APART = 4
"""The entries of column i, multiplied by σ, are at most the distance between two discs divided by this
number. A quarter of the distance leaves room for both radii."""


@dataclass(frozen=True)
class Multiplier:
    """Disc that contains one or more Floquet multipliers.

    center: complex ball without radius. radius: exact upper bound on the distance from the center. count:
    number of multipliers in the disc. isolated: whether the disc contains only one multiplier. room: if the
    disc is isolated, lower bound on the distance between the center and all other multipliers."""

    center: Ball
    radius: Ball
    count: int
    isolated: bool
    room: Ball

    @property
    def low(self) -> Ball:
        """Lower bound on the modulus of at least one of the multipliers in the disc; not negative."""
        low = (abs(self.center) - self.radius).lower()
        return low if low > 0 else arb(0)

    @property
    def high(self) -> Ball:
        """Upper bound on the moduli of all multipliers in the disc."""
        return (abs(self.center) + self.radius).upper()


def multipliers(Phi: Matrix) -> list[Multiplier]:
    """Discs that enclose all eigenvalues of a real interval matrix (N, N), in order of decreasing modulus.
    Eigenvalues that cannot be separated share a disc."""
    Phi = acb_mat(Phi)
    found = [_discs(D) for D in _similar(Phi)]
    return min(found, key=lambda discs: float(largest(disc.high for disc in discs)))


def _similar(Phi: Matrix) -> list[Matrix]:
    """Return `Phi` and, if its eigenvectors are linearly independent, a similar matrix that is nearly
    diagonal."""
    X = Phi.mid().eig(right=True, algorithm="approx")[1].mid()
    try:
        return [Phi, X.solve(Phi * X)]
    except ZeroDivisionError:
        return [Phi]


def _discs(D: Matrix) -> list[Multiplier]:
    size = D.nrows()
    moduli = [[D[i, j].abs_upper() for j in range(size)] for i in range(size)]
    diagonal_radii = [_radius(D[i, i]) for i in range(size)]
    radii = [
        largest([sum((moduli[i][j] for j in range(size) if j != i), diagonal_radii[i])]) for i in range(size)
    ]
    centers = [D[i, i].mid() for i in range(size)]
    isolated = {i: _isolated(i, centers, radii, moduli, diagonal_radii[i]) for i in range(size)}
    found = [Multiplier(centers[i], disc[0], 1, True, disc[1]) for i, disc in isolated.items() if disc]
    for some in _connected(centers, radii):
        count = sum(isolated[i] is None for i in some)
        if count:
            found.append(_joined(some, centers, radii, count))
    found = _with_real(found)
    return sorted(found, key=lambda each: (-float(abs(each.center).mid()), -float(each.center.imag.mid())))


def _with_real(discs: list[Multiplier]) -> list[Multiplier]:
    """Replace the centers of discs by real centers if the multipliers are proved real. This is the case for a
    single multiplier in a disc that is symmetric about the real axis, because the disc also contains the
    complex conjugate."""
    result = list(discs)
    for at, disc in enumerate(discs):
        if not disc.isolated or disc.center.imag.is_zero() or abs(disc.center.imag) > disc.radius:
            continue
        center, radius = acb(disc.center.real), (disc.radius + abs(disc.center.imag)).upper()
        others = [abs(center - other.center) - other.radius for other in discs if other is not disc]
        if all(distance > radius for distance in others):
            result[at] = Multiplier(center, radius, 1, True, _least(others))
    return result


def _radius(x: Ball) -> Ball:
    return acb(arb(0, x.real.rad()), arb(0, x.imag.rad())).abs_upper()


def _least(distances: list[Ball]) -> Ball:
    """Lower bound on the smallest distance; infinite if there are no distances."""
    return min((distance.lower() for distance in distances), default=arb.pos_inf())


def _isolated(
    i: int, centers: list[Ball], radii: list[Ball], moduli: list[list[Ball]], own_radius: Ball
) -> tuple[Ball, Ball] | None:
    """Return the radius of a disc about center i that contains exactly one eigenvalue, and a lower bound on
    the distance from center i to all other eigenvalues. Return None if no such disc is found."""
    others = [j for j in range(len(centers)) if j != i]
    if not others:
        return radii[i], arb.pos_inf()
    gaps = {j: abs(centers[i] - centers[j]).lower() for j in others}
    sigma = arb(2) ** 60
    for j in others:
        if not gaps[j] > 0:
            return None
        if moduli[j][i] > 0:
            bound = gaps[j] / (_APART * moduli[j][i])
            sigma = bound.mid() if bound < sigma else sigma
    # With σ < 1, the disc would not lie within the unscaled disc. Eigenvalues are counted for the unscaled
    # discs.
    if not sigma >= 1:
        return None
    radius = ((radii[i] - own_radius) / sigma + own_radius).upper()
    distances = [gaps[j] - radii[j] - sigma * moduli[j][i] for j in others]
    return (radius, _least(distances)) if all(radius < distance for distance in distances) else None


def _connected(centers: list[Ball], radii: list[Ball]) -> list[list[int]]:
    """Sets of indices of discs that may overlap. The union of the discs of a set contains as many eigenvalues
    as discs."""
    sets: list[list[int]] = []
    for i in range(len(centers)):
        near = [
            some for some in sets if any(not abs(centers[i] - centers[j]) > radii[i] + radii[j] for j in some)
        ]
        sets = [some for some in sets if some not in near] + [[i, *(j for some in near for j in some)]]
    return sets


def _joined(some: list[int], centers: list[Ball], radii: list[Ball], count: int) -> Multiplier:
    """Disc that contains a set of discs, and hence `count` multipliers."""
    center = (sum((centers[i] for i in some), acb(0)) / len(some)).mid()
    reach = largest(abs(centers[i] - center) + radii[i] for i in some)
    others = [abs(centers[j] - center) - radii[j] for j in range(len(centers)) if j not in some]
    return Multiplier(center, reach, count, len(some) == 1, _least(others))


_POWERS = 20
"""Number of squarings of Φ. Norms and traces of the powers yield bounds on the spectral radius. Chosen by
judgement."""


def verdict(Phi: Matrix, found: list[Multiplier], conservative: bool) -> int:
    """Index in VERDICTS of the verdict that the enclosures imply.

    - Asymptotically stable if all discs lie inside the unit circle, or a norm of a power of Φ is below 1.
    - Unstable if a disc lies outside the unit circle, or the modulus of the trace of a power of Φ exceeds the
      number of rows of Φ.
    - Stable for one conservative coordinate (det Φ = 1) with |tr Φ| < 2: both multipliers are on the unit
      circle
      and distinct."""
    size = Phi.nrows()
    if all(each.high < 1 for each in found):
        return ASYMPTOTICALLY_STABLE
    if any(each.low > 1 for each in found):
        return UNSTABLE
    if conservative and size == 2 and abs(Phi.trace()) < 2:
        return STABLE
    power = Phi
    for _ in range(_POWERS):
        if norm(power) < 1:
            return ASYMPTOTICALLY_STABLE
        if abs(power.trace()) > size:
            return UNSTABLE
        power = power * power
    return UNDETERMINED
