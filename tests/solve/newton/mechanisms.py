"""Nonlinear models that have closed forms or can be solved by harmonic balance or time integration."""

from functools import cache

import numpy as np

from derive import Heaviside, Max, Mechanism, acos, asin, cos, rate, sin
from solve.model.cases import Case
from solve.model.model import Model
from solve.model.setup import Setup
from solve.period.curve import FourierCurve
from tests.derive.modules import module_of


def model_of(module, **numbers):
    """Model of a generated module with the given numbers."""
    return Model.from_setup(Setup.checked(module, Case("", None, numbers), {}))


@cache
def duffing():
    """Duffing's oscillator q̈ + 2ζ q̇ + k q + α q³ = f cos φ."""
    made = Mechanism("duffing", "Duffing's oscillator", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    zeta, k, alpha, f = made.parameters(
        zeta=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        alpha=("1/s^2", "cubic stiffness"),
        f=("1/s^2", "amplitude of the load"),
    )
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, zeta * rate(q) ** 2
    made.potential = k * q**2 / 2 + alpha * q**4 / 4
    made.force(f * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def cubic_rotor():
    """Rotor z̈ + c ż + (k + α |z|²) z = f e^{iφ} for z = x + iy, with the orbit z = A e^{iφ}, where (k - Ω² +
    α |A|² + i c Ω) A = f."""
    made = Mechanism("cubic_rotor", "Unbalance on a cubic spring", energy="1/s^2")
    x, y = made.coordinates(x=("1", "across"), y=("1", "up"))
    c, k, alpha, f = made.parameters(
        c=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        alpha=("1/s^2", "cubic stiffness"),
        f=("1/s^2", "load"),
    )
    made.kinetic, made.dissipation = (rate(x) ** 2 + rate(y) ** 2) / 2, c * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = k * (x**2 + y**2) / 2 + alpha * (x**2 + y**2) ** 2 / 4
    made.force(f * cos(made.phase), along=x)
    made.force(f * sin(made.phase), along=y)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def pendulum():
    """Pendulum whose pivot moves vertically, y = b cos φ: q̈ + c q̇ + (g - b Ω² cos φ) sin q = 0."""
    made = Mechanism("pendulum", "Pendulum on a moving pivot", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "angle"))
    c, b, g = made.parameters(c=("1/s", "damping"), b=("1", "stroke"), g=("1/s^2", "gravity by length"))
    x, y = sin(q), b * cos(made.phase) - cos(q)
    made.kinetic = (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential, made.dissipation = g * y, c * rate(q) ** 2 / 2
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def absorber():
    """Mass on a cubic spring with an absorber: m ẍ + c ẋ + k x + k3 x³ + ka (x - y) = F cos φ, ma ÿ + ka (y -
    x) = 0. At Ω² = ka/ma the mass is at rest, and y = -F/ka cos φ."""
    made = Mechanism("absorber", "Mass on a cubic spring with an absorber", energy="1/s^2")
    x, y = made.coordinates(x=("1", "mass"), y=("1", "absorber"))
    m, ma, c, k, k3, ka, F = made.parameters(
        m=("1", "mass"),
        ma=("1", "mass of the absorber"),
        c=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        k3=("1/s^2", "cubic stiffness"),
        ka=("1/s^2", "stiffness of the absorber"),
        F=("1/s^2", "load"),
    )
    made.kinetic, made.dissipation = (m * rate(x) ** 2 + ma * rate(y) ** 2) / 2, c * rate(x) ** 2 / 2
    made.potential = k * x**2 / 2 + k3 * x**4 / 4 + ka * (x - y) ** 2 / 2
    made.force(F * cos(made.phase), along=x)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def torsional_absorber():
    """Slide on a cubic spring and a disc coupled to it by a torsion spring and a lever r: at Ω² = kt/J the
    slide is at rest, and the disc rotates by -F r/kt cos φ."""
    made = Mechanism("torsional_absorber", "Slide with a torsional absorber")
    x, theta = made.coordinates(x=("m", "slide"), theta=("rad", "disc"))
    m, J, c, k, k3, kt, r, F = made.parameters(
        m=("kg", "mass"),
        J=("kg m^2", "inertia"),
        c=("N s/m", "damping"),
        k=("N/m", "stiffness"),
        k3=("N/m^3", "cubic stiffness"),
        kt=("N m/rad", "torsional stiffness"),
        r=("m", "lever"),
        F=("N", "load"),
    )
    made.kinetic = (m * rate(x) ** 2 + J * rate(theta) ** 2) / 2
    made.potential = k * x**2 / 2 + k3 * x**4 / 4 + kt * (theta - x / r) ** 2 / 2
    made.dissipation = c * rate(x) ** 2 / 2
    made.force(F * cos(made.phase), along=x)
    made.decline_drive_torque("a test of vibration")
    return module_of(made)


@cache
def bead():
    """Bead on a hoop that rotates at the speed, measured from its equilibrium cos q0 = g/Ω²: q̈ + c q̇ - Ω²
    sin(q0 + q) cos(q0 + q) + g sin(q0 + q) = F cos φ."""
    made = Mechanism("bead", "Bead on a hoop", energy="1/s^2")
    (q,) = made.coordinates(q=("rad", "angle"))
    c, g, F = made.parameters(
        c=("1/s", "damping"), g=("1/s^2", "gravity by radius"), F=("1/s^2", "load by mass and radius")
    )
    made.fundamental(q=acos(g / made.speed**2))
    made.kinetic = (rate(q) ** 2 + (made.speed * sin(q)) ** 2) / 2
    made.potential, made.dissipation = -g * cos(q), c * rate(q) ** 2 / 2
    made.force(F * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def held_pendulum():
    """Pendulum held by a torque t at sin q0 = t/g: q̈ + c q̇ + g sin(q0 + q) = t + F cos φ."""
    made = Mechanism("held_pendulum", "Pendulum held by a torque", energy="1/s^2")
    (q,) = made.coordinates(q=("rad", "angle"))
    c, g, t, F = made.parameters(
        c=("1/s", "damping"), g=("1/s^2", "gravity by length"), t=("1/s^2", "torque"), F=("1/s^2", "load")
    )
    made.fundamental(q=asin(t / g))
    made.kinetic, made.potential = rate(q) ** 2 / 2, -g * cos(q)
    made.dissipation = c * rate(q) ** 2 / 2
    made.force(t + F * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


KNOWN = dict.fromkeys(("m1", "m2", "m12", "mu"), "1") | dict.fromkeys(("c1", "c2"), "1/s")
KNOWN |= dict.fromkeys(("k1", "k2", "k12", "a1", "a2", "kappa"), "1/s^2")
ORDERS = 6


@cache
def known():
    """Two coordinates with cubic stiffness, and inertia and stiffness that vary, under any load with six
    harmonics."""
    made = Mechanism("known", "Two masses on cubic springs", energy="1/s^2")
    q1, q2 = made.coordinates(q1=("1", "first"), q2=("1", "second"))
    p = dict(
        zip(
            KNOWN,
            made.parameters(**{name: (unit, f"number {name}") for name, unit in KNOWN.items()}),
            strict=True,
        )
    )
    v1, v2 = rate(q1), rate(q2)
    made.kinetic = (p["m1"] * v1**2 + p["m2"] * v2**2 + 2 * p["m12"] * v1 * v2 + p["mu"] * (q1 * v2) ** 2) / 2
    made.potential = (
        (p["k1"] + p["kappa"] * cos(made.phase)) * q1**2 / 2
        + (p["k2"] * q2**2 + p["k12"] * (q1 - q2) ** 2) / 2
        + (p["a1"] * q1**4 + p["a2"] * (q1 - q2) ** 4) / 4
    )
    made.dissipation = (p["c1"] * v1**2 + p["c2"] * v2**2) / 2
    for name, q in (("F", q1), ("G", q2)):
        made.force(made.series(name, harmonics=ORDERS, unit="1/s^2", meaning="load")(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


def known_system(seed, speed=1.0, size=0.7):
    """Return a random model and a random orbit of two harmonics, as a motion. The load required for the orbit
    is computed from the hand-coded equations of `known`."""
    rng = np.random.default_rng(seed)
    low = {"m12": -0.3, "kappa": -0.5}
    high = {"m1": 2, "m2": 2, "m12": 0.3, "mu": 0.3, "c1": 0.6, "c2": 0.6, "k1": 6, "k2": 6, "k12": 3}
    least = {"m1": 1, "m2": 1, "c1": 0.1, "c2": 0.1, "k1": 1, "k2": 1}
    p = {name: rng.uniform(low.get(name, least.get(name, 0.0)), high.get(name, 0.6)) for name in KNOWN}
    orbit = trigonometric(size * (rng.standard_normal((2, 3)) + 1j * rng.standard_normal((2, 3))) / [1, 1, 2])
    phase = 2 * np.pi * np.arange(64) / 64
    (q1, q2), (v1, v2), (w1, w2) = (speed**k * orbit(phase, k) for k in range(3))
    apart = p["k12"] * (q1 - q2) + p["a2"] * (q1 - q2) ** 3
    stiffness = (p["k1"] + p["kappa"] * np.cos(phase)) * q1 + p["a1"] * q1**3
    loads = {
        "F": p["m1"] * w1 + p["m12"] * w2 - p["mu"] * q1 * v2**2 + p["c1"] * v1 + stiffness + apart,
        "G": p["m2"] * w2 + p["m12"] * w1 + p["mu"] * (q1**2 * w2 + 2 * q1 * v1 * v2) + p["c2"] * v2
        + p["k2"] * q2 - apart,
    }  # fmt: skip
    numbers = dict(p)
    for name, load in loads.items():
        series = 2 * np.fft.rfft(load) / len(load)
        assert np.abs(series[ORDERS + 1 :]).max() < 1e-12
        numbers[name] = series[0].real / 2
        for k in range(1, ORDERS + 1):
            numbers[f"{name}a{k}"], numbers[f"{name}b{k}"] = series[k].real, -series[k].imag
    return model_of(known(), **numbers), orbit


def trigonometric(coefficients, period=2 * np.pi):
    """Motion Re Σ_k c_k exp(ikφ) with the coefficients (n, orders)."""
    return FourierCurve(np.array([0.0, period]), np.atleast_2d(np.asarray(coefficients, dtype=complex)))


@cache
def autoparametric():
    """Two modes of the potential x y² (A. H. Nayfeh, D. T. Mook, Nonlinear Oscillations, 6.5): ẍ + c ẋ + k x
    + α y² = F cos φ, ÿ + c ẏ + ky y + 2 α x y = 0."""
    made = Mechanism("autoparametric", "Two modes that exchange energy", energy="1/s^2")
    x, y = made.coordinates(x=("1", "driven mode"), y=("1", "other mode"))
    c, k, ky, alpha, F = made.parameters(
        c=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        ky=("1/s^2", "stiffness of the other mode"),
        alpha=("1/s^2", "coupling"),
        F=("1/s^2", "load"),
    )
    made.kinetic, made.dissipation = (rate(x) ** 2 + rate(y) ** 2) / 2, c * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = k * x**2 / 2 + ky * y**2 / 2 + alpha * x * y**2
    made.force(F * cos(made.phase), along=x)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def dashpot():
    """Mass that hits a stop with a preloaded spring and a dashpot, whose force is discontinuous: q̈ + z q̇ +
    q + (f + κ (q - gap) + c q̇) H(q - gap) = cos φ."""
    made = Mechanism("dashpot", "Mass with a damped stop", energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    z, c, kappa, gap, f = made.parameters(
        z=("1/s", "damping"),
        c=("1/s", "damping of the stop"),
        kappa=("1/s^2", "stiffness of the stop"),
        gap=("1", "clearance"),
        f=("1/s^2", "preload of the stop"),
    )
    one = made.parameter("one", "1/s^2", "stiffness and load")
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, z * rate(q) ** 2 / 2
    made.potential = one * q**2 / 2 + kappa * Max(0, q - gap) ** 2 / 2 + f * Max(0, q - gap)
    made.force(one * cos(made.phase) - Heaviside(q - gap) * c * rate(q), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def stop():
    """Mass that hits an elastic stop beyond a clearance: q̈ + 2ζ q̇ + k q + κ (q - gap)⁺ = f cos φ."""
    return _with_stops("stop", "Mass with a stop", lambda q, gap: Max(0, q - gap) ** 2)


@cache
def two_stops():
    """Mass between two elastic stops: q̈ + 2ζ q̇ + k q + κ (q - gap)⁺ - κ (-q - gap)⁺ = f cos φ."""
    return _with_stops(
        "two_stops", "Mass between two stops", lambda q, gap: Max(0, q - gap) ** 2 + Max(0, -q - gap) ** 2
    )


def _with_stops(name, title, squared_depth):
    """Mass with elastic stops.

    squared_depth: function of the displacement and the gap. It returns the sum of the squared deformations of
    the stops."""
    made = Mechanism(name, title, energy="1/s^2")
    (q,) = made.coordinates(q=("1", "displacement"))
    zeta, k, kappa, gap, f = made.parameters(
        zeta=("1/s", "damping"),
        k=("1/s^2", "stiffness"),
        kappa=("1/s^2", "stiffness of a stop"),
        gap=("1", "clearance"),
        f=("1/s^2", "amplitude of the load"),
    )
    made.kinetic, made.dissipation = rate(q) ** 2 / 2, zeta * rate(q) ** 2
    made.potential = k * q**2 / 2 + kappa * squared_depth(q, gap) / 2
    made.force(f * cos(made.phase), along=q)
    made.decline_drive_torque("an equation without units")
    return module_of(made)


@cache
def tuned_absorber():
    """Mass on a cubic spring with a tuned absorber: m1 x1'' + c1 x1' + k1 x1 + n1 x1³ + f = F cos φ,
    m2 x2'' = f with y = x1 - x2 and f = c2 y' + k2 y + n2 y³ (G. Habib et al., Mech. Syst. Signal Process.,
    2014, doi:10.1016/j.ymssp.2014.08.009)."""
    made = Mechanism("tuned_absorber", "Mass on a cubic spring with a nonlinear tuned absorber")
    x1, x2 = made.coordinates(x1=("m", "mass"), x2=("m", "absorber"))
    m1, m2, F = made.parameters(m1=("kg", "mass"), m2=("kg", "absorber"), F=("N", "load"))
    c1, c2 = made.parameters(c1=("N s/m", "damper"), c2=("N s/m", "damper of the absorber"))
    k1, k2 = made.parameters(k1=("N/m", "spring"), k2=("N/m", "spring of the absorber"))
    n1, n2 = made.parameters(n1=("N/m^3", "cubic spring"), n2=("N/m^3", "cubic spring of the absorber"))
    y = x1 - x2
    made.kinetic = (m1 * rate(x1) ** 2 + m2 * rate(x2) ** 2) / 2
    made.potential = (k1 * x1**2 + k2 * y**2) / 2 + (n1 * x1**4 + n2 * y**4) / 4
    made.dissipation = (c1 * rate(x1) ** 2 + c2 * rate(y) ** 2) / 2
    made.force(F * cos(made.phase), along=x1)
    made.decline_drive_torque("a test of vibration")
    return module_of(made)
