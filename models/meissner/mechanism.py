"""Meissner's equation, Eq. (7.10) of the thesis, with two intervals."""

from derive import Mechanism, pi, rate, rectangle


def mechanism() -> Mechanism:
    """Return the mechanism q̈ + w² q = 0, where w is w1 in the first fraction `share` of each revolution and
    w2 in the rest.

    For a share of 1/2, the sum of the multipliers is twice Meissner's function J2 = cos x1 cos x2 − (w1/w2 +
    w2/w1)/2 sin x1 sin x2 with x = π w/Ω. At π rad/s, w1 and w2 equal x1 and x2.
    """
    meissner = Mechanism("meissner", "Meissner's equation (thesis 7.2.3)", energy="1/s^2")
    (q,) = meissner.coordinates(q=("1", "deflection, for a mass of 1"))
    w1, w2 = meissner.parameters(
        w1=("rad/s", "natural frequency in the first interval", ">= 0"),
        w2=("rad/s", "natural frequency in the second interval", ">= 0"),
    )
    share = meissner.parameter("share", "1", "duration of the first interval in revolutions", "> 0, < 1")
    first = rectangle(meissner.phase, 0, 2 * pi * share)
    meissner.kinetic = rate(q) ** 2 / 2
    meissner.potential = (w2**2 + (w1**2 - w2**2) * first) * q**2 / 2
    meissner.decline_drive_torque("an equation without physical units has no torque")

    # Sketch of a mass of size 1 on a spring. The more compliant the spring is, the wider it is drawn.
    width, wall = 1 - (w2 + (w1 - w2) * first) / (w1 + w2), -4
    coils = [(wall + (q - wall) * k / 13, width * (-1) ** k) for k in range(1, 13)]
    meissner.sketch("spring", [(wall, 0), *coils, (q, 0)], unit="1")
    box = [(q, -0.5), (q + 1, -0.5), (q + 1, 0.5), (q, 0.5), (q, -0.5)]
    meissner.sketch("mass", box, unit="1")
    return meissner
