"""The car axis of the Test Set for IVP solvers, from its energies: two wheels' springs under a rigid axle,
the right one on a bumpy road; its reference solution at 3 s."""

import numpy as np

from derive import Mechanism, cos, rate, sin, sqrt

SPEED, TIME = 10.0, 3.0
NUMBERS = {"m": 10 * 1e-2**2 / 2, "k": 1.0, "L": 1.0, "L0": 0.5, "r": 0.1, "g": 1.0}
REFERENCE = {
    "xl": "0.4934557842755629e-1", "yl": "0.4969894602303324", "xr": "0.1041742524885400e+1",
    "yr": "0.3739110272652214", "ylv": "0.7446866596327776e-2", "yrv": "0.7703410437794031",
}  # fmt: skip
"""At 3 s, as printed: the left and right end of the axle, and two velocities."""


def mechanism():
    car = Mechanism("car_axis", "Axle on two springs, the right one on a road that goes up and down")
    u = car.coordinate("u", "m", "left spring beyond its length at rest")
    tilt = car.coordinate("tilt", "rad", "axle against the horizontal")
    m, k = car.parameters(m=("kg", "each end", "> 0"), k=("N/m", "each spring", "> 0"))
    L, L0 = car.parameters(L=("m", "axle", "> 0"), L0=("m", "spring at rest", "> 0"))
    r, g = car.parameters(r=("m", "road", "> 0"), g=("m/s^2", "gravity"))
    road = r * sin(car.phase)
    across = sqrt(L**2 - road**2)
    height = L0 + u
    xl, yl = -height * road / L, height * across / L
    xr, yr = xl + L * cos(tilt), yl + L * sin(tilt)
    right = sqrt((xr - across) ** 2 + (yr - road) ** 2)
    car.kinetic = m * (rate(xl) ** 2 + rate(yl) ** 2 + rate(xr) ** 2 + rate(yr) ** 2) / 2
    car.potential = k * (u**2 + (right - L0) ** 2) / 2 + m * g * (yl + yr)
    return car


START = (np.zeros(2), np.zeros(2))
"""Both springs at rest, the axle level; the road turns the left end, and no coordinate moves."""


def ends(phase, u, tilt):
    """Return xl, yl, xr, yr."""
    road = NUMBERS["r"] * np.sin(phase)
    across, height = np.sqrt(1 - road**2), NUMBERS["L0"] + u
    xl, yl = -height * road, height * across
    return xl, yl, xl + np.cos(tilt), yl + np.sin(tilt)


def rates(phase, u, tilt, ud, tiltd):
    """Return the velocities of `ends`."""
    road, road_rate = NUMBERS["r"] * np.sin(phase), NUMBERS["r"] * SPEED * np.cos(phase)
    across, height = np.sqrt(1 - road**2), NUMBERS["L0"] + u
    xld = -ud * road - height * road_rate
    yld = ud * across - height * road * road_rate / across
    return xld, yld, xld - np.sin(tilt) * tiltd, yld + np.cos(tilt) * tiltd
