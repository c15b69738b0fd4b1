"""The flexible slider-crank of the Test Set for IVP solvers, from its energies.

B. Simeon, Modelling a flexible slider crank mechanism by a mixed system of DAEs and PDEs, Mathematical
Modelling of Systems 2 (1996) 1-18; Test Set for IVP solvers, problem `crank` (F. Mazzia, C. Magherini,
F. Iavernaro), whose equations are public in tpetzoldt/deSolve, pkg/daeSolve/src/Ex_crank.f.
The connecting rod has two sine shapes across and a quadratic element along it. The set's masses along the
rod are 15 times those of that element (8, 1, 2 for 8/15, 1/15, 2/15), and its pi is 3.1415927; both are kept
here, since its reference solution rests on them.
"""

import numpy as np

from derive import Matrix, Mechanism, Rational, cos, rate, sin

PI = Rational("3.1415927")
NUMBERS = {
    "L1": 0.15, "L2": 0.30, "J1": 0.002727, "J2": 0.0045339259, "m2": 0.151104, "m3": 0.075552,
    "E": 0.20e12, "b": 0.008, "h": 0.008, "rho": 7870.0,
}  # fmt: skip
SPEED, TIME = 150.0, 0.1
START = (
    np.array([0.0, 0.0, 0.103339863e-04, 0.169327969e-04]),
    np.array([0.444896105e00, 0.463434311e-02, -0.178591076e-05, -0.268938672e-05]),
)
"""q and q̇ as the set gives them, to nine digits."""
REFERENCE = {
    "phi2": "-0.3311734988256260", "x3": "0.1697373328427860", "q1": "0.1893192899613509e-3",
    "q2": "0.2375751249879174e-4", "q3": "-0.5323896770569702e-5", "q4": "-0.8363313279112129e-5",
    "phi2 rate": "0.6025346755138369e+2", "x3 rate": "-0.8753116326670527e+1",
}  # fmt: skip
"""At 0.1 s, by MEBDFI with tolerances of 1e-14."""


def mechanism():
    crank = Mechanism("crank", "Slider-crank with a flexible connecting rod")
    q = Matrix(
        crank.coordinates(
            q1=("m", "half wave across"), q2=("m", "whole wave across"),
            q3=("m", "stretch to the middle"), q4=("m", "stretch to the end"),
        )
    )  # fmt: skip
    q1, q2, q3, q4 = q
    v1, v2, v3, v4 = rate(q)
    L1, L2 = crank.parameters(L1=("m", "crank", "> 0"), L2=("m", "connecting rod", "> 0"))
    J1, J2 = crank.parameters(J1=("kg m^2", "crank", "> 0"), J2=("kg m^2", "rod about its pin", "> 0"))
    m2, m3 = crank.parameters(m2=("kg", "rod", "> 0"), m3=("kg", "slider", "> 0"))
    E, rho = crank.parameters(E=("Pa", "Young's modulus", "> 0"), rho=("kg/m^3", "density", "> 0"))
    b, h = crank.parameters(b=("m", "width", "> 0"), h=("m", "height", "> 0"))

    phi = crank.phase
    phi2, slide = crank.loop(
        {"phi2": "rad", "slide": "m"},
        driven_by=(phi, q4),
        closure=lambda x, u, phi2, slide: (
            L1 * sin(x) + (L2 + u) * sin(phi2),
            L1 * cos(x) + (L2 + u) * cos(phi2) - slide,
        ),
        start=lambda x, u: (-L1 / L2 * sin(x), L1 * cos(x) + L2),
    )
    turn, spin = rate(phi), rate(phi2)
    m = rho * b * h * L2

    along, along_rate = (2 * a / 3 + c / 6 for a, c in ((q3, q4), (v3, v4)))
    across, across_rate = 2 * q1 / PI, 2 * v1 / PI
    moment = L2 * (q3 / 3 + q4 / 6)
    moment_rate = L2 * (v1 / PI - v2 / (2 * PI))
    masses = Matrix([[Rational(1, 2), 0, 0, 0], [0, Rational(1, 2), 0, 0], [0, 0, 8, 1], [0, 0, 1, 2]])
    odd, even = 16 / PI**3, 8 / PI**3 - 1 / PI
    swept = Matrix(
        [[0, 0, -odd, even], [0, 0, 0, 1 / (2 * PI)], [odd, 0, 0, 0], [-even, -1 / (2 * PI), 0, 0]]
    )
    pin = L1 * turn
    crank.kinetic = (
        (J1 + m2 * L1**2) * turn**2 / 2
        + J2 * spin**2 / 2
        + m2 * L2 / 2 * pin * spin * cos(phi - phi2)
        + m3 * rate(slide) ** 2 / 2
        + m / 2 * ((rate(q).T * masses * rate(q))[0] + spin**2 * (q.T * masses * q)[0])
        + m * spin**2 * moment
        + m * spin * (moment_rate + (q.T * swept * rate(q))[0])
        + m * pin * spin * (sin(phi - phi2) * across + cos(phi - phi2) * along)
        + m * pin * (cos(phi - phi2) * across_rate - sin(phi - phi2) * along_rate)
    )
    bending = PI**4 / 24 * (h / L2) ** 2 * (q1**2 + 16 * q2**2)
    tension = (16 * q3**2 - 16 * q3 * q4 + 7 * q4**2) / 3
    crank.potential = E * b * h / L2 / 2 * (bending + tension)
    crank.output("rod_angle", phi2, "rad", "direction of the rod")
    crank.output("slider", slide, "m", "slider")
    return crank


def quantities(phase, q, qd):
    """What the set prints, of a state of q; the rod's direction and the slider follow from the loop."""
    L1, reach = NUMBERS["L1"], NUMBERS["L2"] + q[3]
    phi2 = np.arcsin(-L1 * np.sin(phase) / reach)
    rate = -(L1 * np.cos(phase) * SPEED + np.sin(phi2) * qd[3]) / (reach * np.cos(phi2))
    slide = L1 * np.cos(phase) + reach * np.cos(phi2)
    slide_rate = -L1 * np.sin(phase) * SPEED - reach * np.sin(phi2) * rate + np.cos(phi2) * qd[3]
    named = {"phi2": phi2, "x3": slide, "phi2 rate": rate, "x3 rate": slide_rate}
    return named | {f"q{k}": value for k, value in enumerate(q, 1)}


def equations(phase, speed, q, qd, qdd):
    """Left side of Simeon's equations for q, reduced by the constraints: Jᵀ(M w - f) with w = J q̈ + J̇ q̇ + …
    of p = (φ1, φ2, x3, q), whose multipliers do no work along the columns of J."""
    n = NUMBERS
    L1, L2, pi = n["L1"], n["L2"], 3.1415927
    facm, facb = n["rho"] * n["b"] * n["h"] * L2, n["b"] * n["h"] * L2
    fack, rho = n["E"] * n["b"] * n["h"] / L2, n["rho"]
    MQ, KQ, BQ = np.zeros((3, 4, 4))
    MQ[0, 0] = MQ[1, 1] = facm / 2
    MQ[2:, 2:] = facm * np.array([[8.0, 1.0], [1.0, 2.0]])
    KQ[0, 0] = fack * pi**4 / 24 * (n["h"] / L2) ** 2
    KQ[1, 1] = fack * pi**4 * 2 / 3 * (n["h"] / L2) ** 2
    KQ[2:, 2:] = fack / 3 * np.array([[16.0, -8.0], [-8.0, 7.0]])
    BQ[0, 2:] = facb * np.array([-16 / pi**3, 8 / pi**3 - 1 / pi])
    BQ[1, 3] = facb / (2 * pi)
    BQ -= BQ.T
    c1 = facb * np.array([0, 0, 2 / 3, 1 / 6])
    c2 = facb * np.array([2 / pi, 0, 0, 0])
    c12 = L2 * facb * np.array([0, 0, 1 / 3, 1 / 6])
    c21 = L2 * facb * np.array([1 / pi, -0.5 / pi, 0, 0])

    reach = L2 + q[3]
    p2 = np.arcsin(-L1 * np.sin(phase) / reach)
    s1, c_1, s2, c_2 = np.sin(phase), np.cos(phase), np.sin(p2), np.cos(p2)
    v2 = -(L1 * c_1 * speed + s2 * qd[3]) / (reach * c_2)
    w2 = (
        L1 * s1 * speed**2 + reach * s2 * v2**2 - 2 * c_2 * v2 * qd[3] - s2 * qdd[3]
    ) / (reach * c_2)  # fmt: skip
    w3 = (
        -L1 * c_1 * speed**2 - reach * (c_2 * v2**2 + s2 * w2) - 2 * s2 * v2 * qd[3] + c_2 * qdd[3]
    )  # fmt: skip
    s12, c_12 = np.sin(phase - p2), np.cos(phase - p2)

    M = np.zeros((7, 7))
    M[0, 0] = n["J1"] + n["m2"] * L1**2
    M[0, 1] = M[1, 0] = L1 * L2 * n["m2"] * c_12 / 2 + rho * L1 * (s12 * c2 @ q + c_12 * c1 @ q)
    M[1, 1] = n["J2"] + q @ MQ @ q + 2 * rho * c12 @ q
    M[2, 2] = n["m3"]
    M[0, 3:] = M[3:, 0] = rho * L1 * (-s12 * c1 + c_12 * c2)
    M[1, 3:] = M[3:, 1] = rho * (c21 + q @ BQ)
    M[3:, 3:] = MQ
    f = np.zeros(7)
    f[1] = (
        L1 * L2 * n["m2"] * speed**2 * s12 / 2
        + rho * L1 * speed**2 * (s12 * c1 @ q - c_12 * c2 @ q)
        - 2 * rho * v2 * c12 @ qd
        - 2 * v2 * qd @ MQ @ q
        - rho * qd @ BQ @ qd
    )
    f[3:] = (
        v2**2 * MQ @ q
        + rho * (v2**2 * c12 + L1 * speed**2 * (c_12 * c1 + s12 * c2) + 2 * v2 * BQ @ qd)
        - KQ @ q
    )
    J = np.zeros((7, 4))
    J[3:] = np.eye(4)
    J[1, 3] = -s2 / (reach * c_2)
    J[2, 3] = c_2 - reach * s2 * J[1, 3]
    return J.T @ (M @ np.concatenate(([0.0, w2, w3], qdd)) - f)
