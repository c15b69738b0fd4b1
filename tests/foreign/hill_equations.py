"""Equations of Hill: characteristic values of Mathieu's, band edges of others, a row of quadrupoles."""

from functools import partial

import numpy as np

import solve
from tests.digits import half_a_digit
from tests.foreign.wall import Case, Source, band_edge, oscillator

HANDBOOK = Source(
    "J. Burkardt, after M. Abramowitz and I. A. Stegun",
    "test values for TOMS 352, of Handbook of Mathematical Functions, chapter 20",
    "2006",
    "johannesgerer/jburkardt-f77, toms352/toms352_prb.f",
)
ZHANG_JIN = Source(
    "S. Zhang, J. Jin",
    "Computation of Special Functions, program MCVA2",
    "1996",
    "liangjj/mesa_working, library/specfun",
)
MATHEMATICA = Source(
    "chebfun developers", "Chebfun test `mathieu`, values of Mathematica", "2009", "chebfun/chebfun"
)
WOLFRAM = Source(
    "H. Montanelli", "Periodic ODE eigenvalue problems", "2014", "chebfun/examples, ode-eig/FourierEigs.m"
)
NAG = Source("NAG", "Library Manual Mark 29.2, results of the example of s22cac", "2023", "support.nag.com")
ANDREW = Source(
    "A. L. Andrew",
    "Correction of finite difference eigenvalues of periodic Sturm-Liouville problems, J. Austral. Math. "
    "Soc. B 30",
    "1989",
    "digits as in the tests of twist-numerical/matslise, test/matslise/periodic.cpp, which cite it and "
    "sciencedirect 0168927495000675",
)
IMPACTX = Source(
    "A. Huebl, C. Mitchell and others",
    "ImpactX, example FODO cell",
    "2022",
    "ECP-WarpX/impactx, examples/fodo",
)


MATHIEU_ERROR = 1e-10
"""To which the boundaries below are sought, three times over."""


def mathieu(q, multiplier, near):
    """Return the a nearest to `near` for which q'' + (a - 2q cos 2t) q = 0 has a periodic solution."""

    def problem(a):
        return oscillator(lambda t: a - 2 * q * np.cos(2 * t), period=np.pi), 1.0

    boundaries = solve.boundaries(problem, (near - 0.15, near - 1e-3, near + 1e-3, near + 0.15), multiplier)
    return min((each.value for each in boundaries), key=lambda value: abs(value - near))


def mathieu_case(source, place, family, order, q, printed):
    def computed():
        return mathieu(q, 1 if order % 2 == 0 else -1, float(printed))

    within = max(half_a_digit(printed), MATHIEU_ERROR)
    return Case(source, place, f"Mathieu, {family}{order}({q})", printed, computed, within)


HANDBOOK_VALUES = [
    ("a", 0, 5, "-5.800046020851508"), ("a", 0, 25, "-40.25677954656679"),
    ("a", 1, 20, "-14.49130142517482"), ("a", 2, 15, "5.077983197543472"),
    ("a", 5, 5, "25.54997174998161"), ("a", 5, 10, "27.70376873393928"),
    ("a", 5, 15, "31.95782125217288"), ("a", 5, 20, "36.64498973413284"),
    ("a", 5, 25, "40.05019098580771"),
]  # fmt: skip
ZHANG_JIN_VALUES = [
    ("a", 1, "-21.314899691"), ("a", 2, "-3.522164727"), ("a", 3, "12.964079444"),
    ("a", 6, "48.975786716"), ("b", 1, "-40.256778985"), ("b", 2, "-21.314860622"),
    ("b", 3, "-3.520941527"), ("b", 5, "28.062765899"), ("b", 10, "103.225680042"),
]  # fmt: skip


def andrews_potential(t):
    return t**2 * (np.pi - t)


def andrew(multiplier, index, printed, within=None):
    computed = partial(band_edge, andrews_potential, np.pi, multiplier, float(printed), 1e-3, (0.0,))
    kind, place = ("periodic", "Periodic Andrews asymmetric")
    if multiplier < 0:
        kind, place = ("antiperiodic", "Antiperiodic Andrew")
    return Case(ANDREW, place, f"x²(π − x), {kind}, λ{index}", printed, computed, within)


def quadrupoles(s):
    focusing, defocusing = (s >= 0.25) & (s < 1.25), (s >= 1.75) & (s < 2.75)
    return focusing * 1.0 - defocusing * 1.0


def phase_advance():
    """Return the phase advance (degrees) of the betatron oscillation in a cell of 3 m."""
    cell = oscillator(quadrupoles, period=3.0, breaks=(0.25, 1.25, 1.75, 2.75))
    return np.degrees(np.angle(solve.floquet(cell, 1.0).multipliers[0]))


CASES = [
    *(mathieu_case(HANDBOOK, "mathieu_even_values", *value) for value in HANDBOOK_VALUES),
    *(
        mathieu_case(ZHANG_JIN, "example in the head", family, order, 25, printed)
        for family, order, printed in ZHANG_JIN_VALUES
    ),
    mathieu_case(MATHEMATICA, "exactA25", "a", 8, 25, "69.524065165941372023"),
    mathieu_case(MATHEMATICA, "exactA25", "a", 4, 25, "27.805240580928440859"),
    mathieu_case(WOLFRAM, "Dwolfram", "a", 0, 2, "-1.513956885056520"),
    mathieu_case(WOLFRAM, "Dwolfram", "b", 1, 2, "-1.390676501225323"),
    mathieu_case(WOLFRAM, "Dwolfram", "a", 2, 2, "5.172665133358294"),
    mathieu_case(NAG, "s22cace.r", "a", 3, 2, "9.3703"),
    mathieu_case(NAG, "s22cace.r", "b", 4, 2, "16.1277"),
    andrew(1, 0, "2.02942"),
    andrew(1, 1, "6.50049"),
    andrew(1, 2, "7.01506"),
    andrew(1, 4, "18.66548"),
    andrew(-1, 0, "2.3342987", within=1.5e-6),
    andrew(-1, 3, "11.7198869"),
    Case(IMPACTX, "README", "FODO cell, phase advance in degrees", "67.8", phase_advance),
]
