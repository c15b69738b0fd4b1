"""One element per link with corrected dynamic stiffness (section 7.4.1 of the thesis)."""

import numpy as np
import pytest
from scipy.linalg import eigh

import solve
from models.four_bar.dynamic_correction import Corrected
from models.four_bar.linkage import Linkage
from solve.equations import output_values
from solve.errors import UnknownNameError

PHASE = np.array([0.3, 1.7, 4.0])
CONVERGED = 123.0
"""Stress at the follower's midpoint at 30 rad/s, + surface, for more and more elements; MPa, ± 0.5."""

LINKS = {"crank": ("", "A", "", "crank_A"), "coupler": ("A", "B", "coupler_A", "coupler_B")}
LINKS["follower"] = ("", "B", "follower_C", "follower_B")
"""Joints of each link, "" where held, and the freedoms by which its ends turn."""


@pytest.fixture(scope="module")
def model():
    return solve.load("four_bar")


@pytest.mark.parametrize(("load", "excess"), [("nodal", 20.0), ("consistent", 2.3)])
def test_stress_at_the_followers_midpoint_at_30_rad_per_s(model, load, excess):
    orbit = solve.periodic(Corrected(model, load), 30.0, rtol=1e-7)
    stress = orbit.statistics("follower_midpoint_stress_plus").max_abs / 1e6
    assert 100 * (stress / CONVERGED - 1) == pytest.approx(excess, abs=0.6)


def test_first_mode_is_exact_and_others_are_approximate(model):
    """Errors of modes 2 to 4 relative to the exact elements, in percent, at every position."""
    M, _, K, _ = Corrected(model).at(PHASE, 30.0)
    corrected = np.sqrt([eigh(k, m, eigvals_only=True)[:4] for k, m in zip(K, M, strict=True)])
    dynamic = solve.load("four_bar", options={"element": "dynamic"})
    exact = solve.frequencies(dynamic, PHASE, 4).values
    assert corrected[:, 0] == pytest.approx(exact[:, 0], rel=1e-9)
    assert (np.abs(corrected / exact - 1)[:, 1:] > 1e-4).all()


def test_iteration_of_the_thesis_converges_to_the_same_frequency(model):
    """The iteration starts from the frequency of the cubic elements and evaluates M and K at each estimate.
    At most five steps are required for 1e-3 at 36 positions."""
    corrected, turn = Corrected(model), np.arange(36) * (2 * np.pi / 36)
    positions = solve.load("four_bar", options={"element": "dynamic"}).at_positions(turn)
    M, _, K, _ = model.at(turn, 30.0)
    omega, every = np.zeros(len(turn)), np.arange(len(turn))
    for iteration in range(5):
        before = omega
        omega = np.sqrt([eigh(k, m, eigvals_only=True)[0] for k, m in zip(K, M, strict=True)])
        if iteration and (np.abs(omega / before - 1) < 1e-3).all():
            break
        M = positions.dynamic_mass(every, omega)
        K = positions.dynamic_stiffness(every, omega) + (omega**2)[:, None, None] * M
    else:
        pytest.fail("more than five iterations")
    assert corrected.lowest(turn) == pytest.approx(omega, rel=1e-6)


def shapes(L, EI, mu, omega, x):
    """Transverse displacement (points, 4) of a beam that vibrates at ω, for unit v1, θ1, v2 and θ2."""
    wave = (mu * omega**2 / EI) ** 0.25

    def functions(x, order):
        parts = (np.sin, np.cos, np.sinh, np.cosh)
        slopes = (np.cos, lambda x: -np.sin(x), np.cosh, np.sinh)
        return np.stack([wave**order * f(wave * x) for f in (parts, slopes)[order]], axis=-1)

    ends = np.array([0.0, L])
    unit = np.stack([functions(ends, order) for order in (0, 1)], axis=1).reshape(4, 4)
    return functions(x, 0) @ np.linalg.inv(unit)


def axial_shapes(L, EA, mu, omega, x):
    wave = omega * np.sqrt(mu / EA)
    return np.sin(wave * np.stack((L - x, x), axis=-1)) / np.sin(wave * L)


def consistent_load(model, phase, speed, omega):
    """Load −∫ ρA Nᵀ a_r dx, by quadrature, plus the inertia forces of the joint masses, per degree of
    freedom."""
    p = model.parameters
    motion = Linkage(p["L1"], p["L2"], p["L3"], p["L4"]).motion(np.array([phase]), speed)
    places, weights = np.polynomial.legendre.leggauss(30)
    load = dict.fromkeys(model.coordinates, 0.0)
    for number, (link, (start, end, *turns)) in enumerate(LINKS.items(), start=1):
        L, mu = p[f"L{number}"], p["rho"] * p[f"A{number}"]
        x, dx = L * (places + 1) / 2, L * weights / 2
        direction = np.exp(1j * motion.t[number - 1][0])
        ends = [motion.acceleration(number, each)[0] for each in (0.0, L)]
        a = (ends[0] + (ends[1] - ends[0]) * x / L) / direction
        transverse = -mu * (a.imag * dx) @ shapes(L, p["E"] * p[f"I{number}"], mu, omega, x)
        axial = -mu * (a.real * dx) @ axial_shapes(L, p["E"] * p[f"A{number}"], mu, omega, x)
        for joint, u, v in zip((start, end), axial, transverse[::2], strict=True):
            if joint:
                force = (u + 1j * v) * direction
                load[f"{joint}_x"] += force.real
                load[f"{joint}_y"] += force.imag
        for turn, moment in zip(turns, transverse[1::2], strict=True):
            if turn:
                load[f"{turn}_turn"] += moment
        assert link in model.beams.freedoms.links[number - 1].name
    for joint, number in (("A", 1), ("B", 3)):
        a = motion.acceleration(number, p[f"L{number}"])[0]
        load[f"{joint}_x"] -= p[f"m{joint}"] * a.real
        load[f"{joint}_y"] -= p[f"m{joint}"] * a.imag
    return np.array(list(load.values()))


def test_consistent_load_equals_the_work_of_rigid_inertia(model):
    corrected = Corrected(model)
    _, _, _, d = corrected.at(PHASE, 30.0)
    for phase, omega, computed in zip(PHASE, corrected.lowest(PHASE), d, strict=True):
        expected = consistent_load(model, phase, 30.0, omega)
        assert computed == pytest.approx(expected, rel=1e-6, abs=1e-6 * np.abs(expected).max())


def test_stresses_follow_from_the_curvature_of_the_deflection(model):
    corrected, p, h = Corrected(model), model.parameters, 1e-3
    orbit = solve.periodic(corrected, 30.0, rtol=1e-6)
    q = orbit.at(PHASE)
    for link, fraction, number in (("follower", 0.5, 3), ("coupler", 0.3, 2), ("crank", 0.6, 1)):
        v = [corrected.deflection(link, fraction + k * h, PHASE, q) for k in (-1, 0, 1)]
        curvature = (v[0] - 2 * v[1] + v[2]) / (h * p[f"L{number}"]) ** 2
        plus, minus = (corrected.stress(link, fraction, side, PHASE, q) for side in ("plus", "minus"))
        bending = -p["E"] * p[f"h{number}"] * curvature
        assert plus - minus == pytest.approx(bending, rel=1e-3, abs=1e-3 * np.abs(bending).max())
    values = output_values(corrected, PHASE, 30.0, *orbit.state(PHASE))
    assert values["follower_midpoint_stress_plus"] == pytest.approx(
        corrected.stress("follower", 0.5, "plus", PHASE, q)
    )
    assert values["crank_tip_deflection"] == pytest.approx(corrected.deflection("crank", 1.0, PHASE, q))


def test_options_outside_the_correction_raise_an_error():
    with pytest.raises(UnknownNameError, match="did you mean 'consistent'"):
        Corrected(solve.load("four_bar"), "constent")
    with pytest.raises(UnknownNameError, match="terms"):
        Corrected(solve.load("four_bar", options={"terms": "full"}))
