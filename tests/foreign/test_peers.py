"""What peers calculate in closed form or hold in their own tests, without printed digits.

SKHiPPR (F. Bayer, R. Leine, University of Stuttgart; inm-unistuttgart/SKHiPPR): Hill's equation with constant
and with rectangular stiffness by matrix exponentials (test_closed_form_fundamental_matrix.py), and Duffing's
orbits of one and of five periods (test_shooting.py). WELIB (E. Branlard; ebranlard/welib,
welib/system/wtmodels/model5CS.py): a wind turbine of three blades and a nacelle, with its matrices in turning
and, analytically, in fixed coordinates.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import solve
from derive import Mechanism, cos, pi, rate, sin
from tests.foreign.wall import oscillator

SPEED = np.sqrt(2)
"""Of SKHiPPR's equations of Hill."""


def meissner(a, b, damping):
    """In phase time: q'' + (damping/ω) q' + (a + b sign(cos φ))/ω² q = 0."""

    def stiffness(phase):
        first = (phase < np.pi / 2) | (phase >= 3 * np.pi / 2)
        return np.where(first, a + b, a - b) / SPEED**2

    return oscillator(
        stiffness, lambda phase: np.full_like(phase, damping / SPEED), breaks=(np.pi / 2, 3 * np.pi / 2)
    )


def closed(a, b, damping):
    """Return the monodromy matrix in closed form."""
    turn = 2 * np.pi / SPEED

    def piece(stiffness, share):
        return expm(np.array([[0.0, 1.0], [-stiffness, -damping]]) * turn * share)

    return piece(a + b, 0.25) @ piece(a - b, 0.5) @ piece(a + b, 0.25)


@pytest.mark.parametrize("damping", [0.0, 0.1])
@pytest.mark.parametrize("a", [-2.0, 0.0, 2.0])
@pytest.mark.parametrize("b", [-2.0, 0.0, 2.0])
def test_multipliers_of_meissners_equation_match_skhippr(a, b, damping):
    """SKHiPPR compares them to 5e-5. Here, the trace and the determinant agree to 1e-9 of the largest
    multiplier."""
    Phi = closed(a, b, damping)
    computed = solve.floquet(meissner(a, b, damping), 1.0, rtol=1e-10).multipliers
    largest = max(1.0, np.abs(np.linalg.eigvals(Phi)).max())
    assert abs(computed.sum() - np.trace(Phi)) < 1e-9 * largest
    assert abs(np.prod(computed) - np.exp(-damping * 2 * np.pi / SPEED)) < 1e-9 * largest


def duffing():
    made = Mechanism("duffing", "Duffing's oscillator")
    q = made.coordinate("q", "m", "deflection")
    m, delta = made.parameters(m=("kg", "mass", "> 0"), delta=("N s/m", "damper", ">= 0"))
    alpha, beta = made.parameters(alpha=("N/m", "spring"), beta=("N/m^3", "cubic spring"))
    F = made.parameter("F", "N", "force")
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = alpha * q**2 / 2 + beta * q**4 / 4
    made.dissipation = delta * rate(q) ** 2 / 2
    made.force(F * cos(made.phase), along=q)
    return made


@pytest.mark.parametrize(
    ("periods", "speed", "numbers"),
    [
        (1, 1.3, {"alpha": 1.0, "beta": 3.0, "F": 1.0, "delta": 1.0}),
        (5, 1.2, {"alpha": -1.0, "beta": 1.0, "F": 0.37, "delta": 0.3}),
    ],
)
def test_orbits_of_duffings_equation_match_skhippr(periods, speed, numbers):
    """Stable; of as many periods and of no fewer; the one that 100 of its periods lead to from (1, 0), but
    for the turn at which it begins."""
    orbit = solve.nonlinear(solve.load(duffing, m=1.0, **numbers), speed, periods=periods)
    assert orbit.stable
    starts = orbit.at(2 * np.pi * np.arange(periods))[0]
    assert all(abs(a - b) > 0.05 for a, b in pairwise(np.sort(starts)))

    def flow(t, y):
        force = numbers["F"] * np.cos(speed * t) - numbers["delta"] * y[1]
        return [y[1], force - numbers["alpha"] * y[0] - numbers["beta"] * y[0] ** 3]

    end = 100 * periods * 2 * np.pi / speed
    marched = solve_ivp(flow, (0, end), [1.0, 0.0], "DOP853", rtol=1e-10, atol=1e-12).y[0, -1]
    assert np.abs(starts - marched).min() < 1e-7


TURBINE = {"M": 5e4, "m": 500.0, "L": 30.0, "kx": 2e5, "ky": 2e4, "kb": 500.0 * 30.0**2 * (1.6 * np.pi) ** 2}


def turbine():
    made = Mechanism("turbine", "Nacelle on its tower and three blades that swing in the rotor's plane")
    x, y = made.coordinates(x=("m", "nacelle, sideways"), y=("m", "nacelle, upwards"))
    blades = made.coordinates(b1=("rad", "blade 1"), b2=("rad", "blade 2"), b3=("rad", "blade 3"))
    M, m, L = made.parameters(M=("kg", "nacelle", "> 0"), m=("kg", "blade", "> 0"), L=("m", "blade", "> 0"))
    kx, ky = made.parameters(kx=("N/m", "tower", "> 0"), ky=("N/m", "tower", "> 0"))
    kb = made.parameter("kb", "N m/rad", "root of a blade", "> 0")
    made.kinetic = M * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = (kx * x**2 + ky * y**2) / 2
    for k, swing in enumerate(blades):
        angle = made.phase + 2 * pi * k / 3 + swing
        made.kinetic += m * (rate(x + L * cos(angle)) ** 2 + rate(y + L * sin(angle)) ** 2) / 2
        made.potential += kb * swing**2 / 2
    return made


def in_fixed_coordinates(speed):
    """Return the exponents (1/s) of the turbine from its matrices in multi-blade coordinates, as in WELIB."""
    M, m, L, kx, ky, kb = (TURBINE[name] for name in ("M", "m", "L", "kx", "ky", "kb"))
    ml, mll = m * L, m * L**2
    mass = np.diag([mll, mll, mll, M + 3 * m, M + 3 * m])
    mass[1, 3], mass[2, 4], mass[3, 1], mass[4, 2] = ml, -ml, 1.5 * ml, -1.5 * ml
    damping = np.zeros((5, 5))
    damping[1, 2], damping[2, 1] = 2 * mll * speed, -2 * mll * speed
    stiffness = np.diag([kb, kb - mll * speed**2, kb - mll * speed**2, kx, ky])
    inverse = np.linalg.inv(mass)
    return np.linalg.eigvals(
        np.block([[np.zeros((5, 5)), np.eye(5)], [-inverse @ stiffness, -inverse @ damping]])
    )


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.8, 1.7, np.pi, 6.0])
def test_wind_turbine_has_the_multipliers_of_fixed_coordinates(speed):
    """The coefficients are periodic here and constant in fixed coordinates. The multipliers are equal."""
    computed = solve.floquet(solve.load(turbine, **TURBINE), speed, rtol=1e-10).multipliers
    expected = np.exp(in_fixed_coordinates(speed) * 2 * np.pi / speed)
    scale = np.abs(expected).max()
    assert len(computed) == len(expected)
    for multiplier in expected:
        assert np.abs(computed - multiplier).min() < 1e-7 * scale
