"""Machines of the page, run as printed and compared with the literature or a second derivation."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import solve

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "machines.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"```python\n# (\w+)\.py\n(.*?)```", PAGE, re.DOTALL))
HAMMOND = {"M": 8026.6, "K": 1240481.8, "m": 94.9, "S": 289.1, "I": 1084.7, "e": 0.3048}


def stated(name):
    namespace = {}
    exec(BLOCKS[name], namespace)
    return namespace["mechanism"]


@pytest.mark.parametrize("name", BLOCKS)
def test_machine_definitions_have_at_most_forty_lines(name):
    assert len(BLOCKS[name].splitlines()) <= 40


@pytest.mark.slow
@pytest.mark.parametrize("name", BLOCKS)
def test_commands_on_the_page_run(name, tmp_path):
    (tmp_path / f"{name}.py").write_text(BLOCKS[name], encoding="utf-8")
    lines = re.findall(rf"python -m (\w+ .*\b{name}\.py.*|\w+ {name}\.py.*)\n", PAGE)
    assert [line.split()[0] for line in lines] == ["derive", "solve"]
    for line in lines:
        command = [sys.executable, "-m", *shlex.split(line)]
        environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
        subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)


SHAFT = {"m": 10.0, "g": 9.81, "k1": 9e4, "k2": 1.44e5}
LOW, HIGH = np.sqrt(SHAFT["k1"] / SHAFT["m"]), np.sqrt(SHAFT["k2"] / SHAFT["m"])


def test_shaft_of_two_stiffnesses_is_unstable_between_its_natural_frequencies():
    """The natural frequencies are 94.868… and 120 rad/s."""
    model = solve.load(stated("flat_shaft"), c=0, **SHAFT)
    sides = np.ravel([[edge * (1 - 1e-6), edge * (1 + 1e-6)] for edge in (LOW, HIGH)])
    assert [point.stable for point in solve.sweep(model, sides).points] == [True, False, False, True]


def test_gravity_excites_the_shaft_at_half_the_critical_speed():
    """In rotating coordinates, ζ = A sin φ, η = B cos φ: (ω1² − 2Ω²)A + 2Ω²B = −g = (ω2² − 2Ω²)B + 2Ω²A. The
    determinant is zero at ω1ω2/√(2(ω1² + ω2²)). The vertical displacement of the disc is A sin² φ + B cos² φ.
    """
    model = solve.load(stated("flat_shaft"), c=0, **SHAFT)
    secondary = LOW * HIGH / np.sqrt(2 * (LOW**2 + HIGH**2))
    for speed in (0.7 * secondary, 0.999 * secondary, 1.3 * secondary):
        square = 2 * speed**2
        matrix = [[LOW**2 - square, square], [square, HIGH**2 - square]]
        A, B = np.linalg.solve(matrix, [-SHAFT["g"]] * 2)
        y = solve.periodic(model, speed).at(np.linspace(0, 6, 9))[1]
        phase = np.linspace(0, 6, 9)
        np.testing.assert_allclose(y, A * np.sin(phase) ** 2 + B * np.cos(phase) ** 2, rtol=1e-6)
    assert abs(A + B) < 1e-2 < abs(y).max() * 1e2


def test_speed_ratio_of_hookes_joint_has_the_known_limits():
    numbers = {"J": 0.1, "k": 1e5, "c": 0.5, "alpha": 30.0}
    orbit = solve.periodic(solve.load(stated("hooke"), **numbers), 5.0)
    ratio = orbit.statistics("ratio")
    assert (ratio.min, ratio.max) == (pytest.approx(np.sqrt(3) / 2), pytest.approx(2 / np.sqrt(3)))


def test_spectral_radius_of_hookes_joint_matches_time_integration():
    """u(φ) = cos α/(1 − sin²α cos²φ) is the ratio of the speeds: d/dt ∂T/∂q̇ − ∂T/∂q of T = J u²(1 + q′)²Ω²/2
    gives J(u²q″ + 2uu′q′ + (uu″ + u′²)q) + (c/Ω)q′ + (k/Ω²)q about the rigid motion."""
    J, k, c, alpha = 0.1, 1000.0, 0.02, np.radians(30)
    model = solve.load(stated("hooke"), J=J, k=k, c=c, alpha=30.0)

    def ratio(x):
        below = 1 - np.sin(alpha) ** 2 * np.cos(x) ** 2
        first = np.sin(alpha) ** 2 * np.sin(2 * x)
        second = 2 * np.sin(alpha) ** 2 * np.cos(2 * x)
        u = np.cos(alpha) / below
        return u, -u * first / below, u * (2 * first**2 / below**2 - second / below)

    for speed in (80.0, 100.0, 115.0):

        def flow(x, state, speed=speed):
            u, u1, u2 = ratio(x)
            q, v = state.reshape(2, 2)
            force = (2 * J * u * u1 + c / speed) * v + (J * (u * u2 + u1**2) + k / speed**2) * q
            return np.concatenate([v, -force / (J * u**2)])

        end = scipy.integrate.solve_ivp(flow, (0, 2 * np.pi), np.eye(2).ravel(), rtol=1e-11, atol=1e-12).y[
            :, -1
        ]
        radius = abs(np.linalg.eigvals(end.reshape(2, 2))).max()
        assert solve.floquet(model, speed).spectral_radius == pytest.approx(radius, rel=1e-7)


@pytest.mark.parametrize("dampers", [(0.0, 0.0), (51078.7, 4067.5)])
def test_ground_resonance_matches_colemans_equations(dampers):
    """With z = x + iy and Z = Σ ζ_k exp(iψ_k), the coefficients are constant: (M + 3m)z̈ + Cż + Kz + iSZ̈ =
    0, I(Z̈ − 2iΩŻ − Ω²Z) + c(Ż − iΩZ) + Ω²eSZ − (3i/2)Sz̈ = 0. The mean lag is uncoupled."""
    C, cz = dampers
    M, K, m, S, inertia, e = HAMMOND.values()
    model = solve.load(stated("ground"), **HAMMOND, C=C, cz=cz)
    for rpm in (160, 230, 300):
        speed = rpm * np.pi / 30
        mass = np.array([[M + 3 * m, 1j * S], [-1.5j * S, inertia]])
        damping = np.array([[C, 0], [0, cz - 2j * speed * inertia]])
        stiffness = np.array([[K, 0], [0, speed**2 * (e * S - inertia) - 1j * speed * cz]])
        inverse = np.linalg.inv(mass)
        matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
        whirls = np.linalg.eigvals(matrix)
        mean = np.roots([inertia, cz, speed**2 * e * S])
        exponents = np.concatenate([whirls, whirls.conj(), mean])
        expected = np.exp(exponents * 2 * np.pi / speed)
        computed = solve.floquet(model, speed, rtol=1e-10).multipliers
        for multiplier in expected:
            assert abs(computed - multiplier).min() < 1e-6
        assert len(computed) == len(expected)
    verdicts = [solve.floquet(model, speed).stable for speed in ("160 rpm", "230 rpm")]
    assert verdicts == [any(dampers), True]


def test_flapping_blade_matches_hover_and_forward_flight_solutions():
    """In hover, the exponents are Johnson's. In forward flight, |det Φ| = exp(−2πγ/8), and Φ is compared with
    time integration."""
    gamma, nu, speed = 8.0, 1.1, 30.0
    hover = solve.floquet(solve.load(stated("flapping"), I=1, gamma=gamma, mu=0, nu=nu), speed)
    assert hover.exponents[0].real == pytest.approx(-gamma / 16 * speed, rel=1e-8)
    turns = abs(hover.multipliers[0]), np.exp(2j * np.pi * np.sqrt(nu**2 - (gamma / 16) ** 2)).real
    assert hover.multipliers[0].real == pytest.approx(turns[0] * turns[1], rel=1e-7)
    mu = 0.3
    flight = solve.floquet(solve.load(stated("flapping"), I=1, gamma=gamma, mu=mu, nu=nu), speed)

    def flow(x, state):
        q, v = state.reshape(2, 2)
        damping = gamma / 8 * (1 + 4 / 3 * mu * np.sin(x))
        stiffness = nu**2 + gamma / 8 * (4 / 3 * mu * np.cos(x) + mu**2 * np.sin(2 * x))
        return np.concatenate([v, -damping * v - stiffness * q])

    end = scipy.integrate.solve_ivp(flow, (0, 2 * np.pi), np.eye(2).ravel(), rtol=1e-11, atol=1e-13).y[:, -1]
    expected = np.linalg.eigvals(end.reshape(2, 2))
    np.testing.assert_allclose(np.sort_complex(flight.multipliers), np.sort_complex(expected), rtol=1e-7)
    assert abs(np.prod(flight.multipliers)) == pytest.approx(np.exp(-2 * np.pi * gamma / 8), rel=1e-7)


WHIRL = {"I": 2.0, "Ib": 1.0, "h": 0.3, "R": 1.0, "gamma": 4.0}


def whirl_map(speed, V, ka, kb):
    """Monodromy matrix of the propeller by small rotation vectors θ = (0, a, b): every blade has the torque
    Ib e × (θ̈ × e + 2θ̇ × ė), and w = (θ × n)·V + n·(θ̇ × r) across its chord."""
    inertia, blade, h, R, gamma = WHIRL.values()
    axes = np.eye(3)[1:]
    nodes, weights = np.polynomial.legendre.leggauss(3)

    def flow(phase, state):
        e, rim = np.array([[0, np.sin(phase), np.cos(phase)], [0, np.cos(phase), -np.sin(phase)]])
        M, C, K = inertia * np.eye(2), np.zeros((2, 2)), np.diag([ka, kb])
        for j, axis in enumerate(axes):
            M[:, j] += 2 * blade * (axes @ np.cross(e, np.cross(axis, e)))
            C[:, j] += 4 * blade * (axes @ np.cross(e, np.cross(axis, speed * rim)))
        for sign in (1, -1):
            for s, weight in zip((nodes + 1) / 2 * R, weights / 2 * R, strict=True):
                U = np.hypot(V, speed * s)
                n = np.array([speed * s, 0, 0]) / U - V / U * sign * rim
                r = np.array([h, 0, 0]) + s * sign * e
                lever = np.array([n @ np.cross(axis, r) for axis in axes])
                tilt = np.array([V * np.cross(axis, n)[0] for axis in axes])
                lift = weight * gamma * blade / (2 * R**4) * U
                C += lift * np.outer(lever, lever)
                K += lift * np.outer(lever, tilt)
        q, v = state.reshape(2, 2, 4)
        acceleration = -np.linalg.solve(M, C @ v + K @ q)
        return np.concatenate((v.ravel(), acceleration.ravel())) / speed

    end = scipy.integrate.solve_ivp(flow, (0, 2 * np.pi), np.eye(4).ravel(), "DOP853", rtol=1e-10, atol=1e-12)
    return end.y[:, -1].reshape(4, 4)


@pytest.mark.slow
def test_whirl_flutter_of_two_blades_matches_a_second_derivation():
    model = solve.load(stated("whirl"), c=0.0, V=100.0, ka=8e3, kb=8e3, **WHIRL)
    for V, ka, kb in ((100.0, 8e3, 8e3), (60.0, 3e4, 5e4), (100.0, 2e5, 2e5)):
        found = solve.floquet(model.varied({"V": V, "ka": ka, "kb": kb}), 100.0)
        expected = np.linalg.eigvals(whirl_map(100.0, V, ka, kb))
        distance = np.abs(found.multipliers[:, None] - expected) / np.abs(expected).max()
        np.testing.assert_allclose([*distance.min(axis=0), *distance.min(axis=1)], 0, atol=1e-7)


@pytest.mark.slow
def test_page_states_the_largest_multipliers_of_the_propeller():
    for stiffness, is_real, printed in ((3e4, True, "1.526"), (5e4, False, "1.170"), (1e5, False, "0.950")):
        rho = np.linalg.eigvals(whirl_map(100.0, 100.0, stiffness, stiffness))
        largest = rho[np.abs(rho).argmax()]
        assert (abs(largest.imag) < 1e-9) == is_real
        assert f"{abs(largest):.3f}" == printed
        assert printed in PAGE


TRAIN = dict(zip([f"J{i}" for i in range(1, 6)], (3.5e-3, 3.5e-3, 3.5e-3, 0.15, 0.05), strict=True))
TRAIN |= dict(zip([f"k{i}" for i in range(1, 5)], (12e3, 12e3, 14e3, 10e3), strict=True))


def test_free_drive_train_matches_the_page():
    """Amplitudes (K − 4Ω²J)⁻¹T, and the drift T0/b due to the drag of disc 3."""
    orbit = solve.periodic(solve.load(stated("drive_train"), c=0, b=0, T=10, T0=0, **TRAIN), "1000 rpm")
    computed = [1e3 * orbit.harmonics(name)[0][2] for name in orbit.coordinates]
    np.testing.assert_allclose(computed, [1.3488, 0.4982, 0.3588, 1.0894, 1.3954], atol=5e-5)
    assert orbit.verdict == "stable"
    machine = solve.load(stated("drive_train"), c=1e-5, b=0, T=10, T0=3, **TRAIN)
    assert solve.floquet(machine, "1000 rpm").verdict == "asymptotically stable"
    with pytest.raises(solve.errors.UnbalancedLoadError, match="is 3 N m"):
        solve.periodic(machine, "1000 rpm")
    dragged = solve.periodic(machine.varied({"b": 0.07}), "1000 rpm")
    assert dragged.rigid_body_modes[0].drift == pytest.approx(3 / 0.07, rel=1e-9)


def is_unstable_within(system, middle, half_width):
    """Whether the system is unstable at speeds inside `middle` ± `half width` and stable outside."""
    inside, outside = (
        [solve.floquet(system, middle + sign * part * half_width).stable for sign in (-1, 1)]
        for part in (0.8, 1.2)
    )
    return inside == [False, False] and outside == [True, True]


def test_anisotropic_bearings_split_the_unstable_band():
    """The modes of both planes follow with D = 0, and the widths to first order from Hsu."""
    numbers = {"m": 10.0, "mb": 1.0, "k": 1e5, "kx": 4e5, "ky": 8e5}
    m, mb, k, *bearings = numbers.values()
    planes = []
    for bearing in bearings:
        squares, shapes = scipy.linalg.eigh([[k, -k], [-k, k + bearing]], np.diag([m, mb]))
        planes.append((np.sqrt(squares[0]), shapes[0, 0] - shapes[1, 0]))
    D = 200.0
    model = solve.load(stated("soft_bearings"), D=D, **numbers)
    for one, other in ((0, 0), (1, 1), (0, 1)):
        (first, bend), (second, bent) = planes[one], planes[other]
        width = D * abs(bend * bent) / (4 * np.sqrt(first * second))
        assert is_unstable_within(model, (first + second) / 2, width)


def test_variable_inertia_of_a_crank_train_matches_perturbation_theory():
    """The boundaries agree to first order in e, and the harmonics to relative errors proportional to e²."""
    J, k, errors = 0.5, 5000.0, []
    omega = np.sqrt(k / J)
    for e in (0.04, 0.02):
        model = solve.load(stated("crank_train"), J=J, e=e, k=k, c=0.0)
        assert is_unstable_within(model, omega, omega * e / 4)
        speed = 0.23 * omega
        square = (omega / speed) ** 2
        second, fourth = solve.periodic(model, speed, rtol=1e-10).harmonics("q")[0][[2, 4]]
        assert second == pytest.approx(e / (square - 4), rel=2 * e**2)
        errors.append(fourth / (5 * e**2 / ((square - 4) * (square - 16))) - 1)
    assert abs(errors[0]) < 0.01
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("slider", [0.0, 0.02])
def test_elastic_rod_is_unstable_at_twice_its_frequency(slider):
    """With λ = 0.004, second-order terms are several per cent of the width."""
    numbers = {"r": 1.6e-3, "L": 0.4, "EI": 0.8, "mu": 0.12}
    r, length, bending, mass = numbers.values()
    omega = np.pi**2 * np.sqrt(bending / mass) / length**2
    half_width = np.pi**2 * r / length * omega * (1 + 2 * slider / (mass * length))
    model = solve.load(stated("slider_crank"), ms=slider, **numbers)
    assert is_unstable_within(model, 2 * omega, half_width)


@pytest.mark.slow
def test_teetering_removes_the_yaw_instability_of_two_blades():
    numbers = {"J": 1000.0, "k": 5e5}
    for rotor in (50.0, 100.0):
        e, omega = rotor / (2 * numbers["J"] + rotor), np.sqrt(numbers["k"] / (numbers["J"] + rotor / 2))
        rigid = solve.load(stated("teeter"), I=rotor, kt=1e7, **numbers)
        assert is_unstable_within(rigid, omega, omega * e / 4)
        teetering = rigid.varied({"kt": 0.0})
        for speed in (5.0, omega, 30.0):
            found = solve.floquet(teetering, speed)
            expected = np.exp(2j * np.pi * np.array([0, np.sqrt(numbers["k"] / numbers["J"]) / speed]))
            assert found.stable
            distance = np.abs(found.multipliers[:, None] - np.append(expected, expected[1].conj()))
            np.testing.assert_allclose([*distance.min(axis=1), *distance.min(axis=0)], 0, atol=1e-6)


PLANETARY = next(
    block for block in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "planetary" in block
)
LIN_PARKER = [1475.7, 1930.3, 2658.3, 7462.8, 11775.3], [743.2, 1102.4, 1896.0, 2276.4, 6986.3, 9647.9]
PLANETS = [1808.2, 5963.8, 6981.7]


@pytest.fixture(scope="module")
def planetary():
    names = {}
    exec(PLANETARY, names)
    return names["planetary"]


def planetary_by_kind(planets):
    """Natural frequencies in Hz by the symmetry of equal planets: rotational, translational and of planets.

    A translational mode has the displacements z = x + iy of carrier, ring and sun, and Re(w exp(-iψ)) of the
    planet at ψ, whose square summed over the planets is |w|² times half their number. In a rotational mode,
    all planets move alike. Planets alone have closed forms.
    """
    m, inertia, k, bearing, ring = 0.66, 0.61, 5e8, 1e8, 1e9
    s, c, turn = np.sin(np.radians(24.6)), np.cos(np.radians(24.6)), np.exp(1j * np.radians(24.6))

    def frequencies(masses, springs):
        rows = np.array([row for _, row in springs])
        K = rows.conj().T @ np.diag([value for value, _ in springs]) @ rows
        return np.sqrt(scipy.linalg.eigh(K, np.diag(masses), eigvals_only=True).clip(0)) / (2 * np.pi)

    # Coordinates: carrier, ring, sun, then radial, tangential and rotation of the planets.
    own, meshes = np.eye(6), ((0, 0, 1, -s, -c, 1), (0, 1, 0, s, -c, -1))
    springs = [(planets * k, row) for row in meshes]
    springs += [(planets * bearing, own[3]), (planets * bearing, own[0] - own[4]), (ring, own[1])]
    rotational = frequencies([6.29, 3.0, 0.39, *(planets * np.array([m, m, inertia]))], springs)
    half = planets / 2
    springs = [(half * k, (0, 0, 1j * turn, -s, -c, 1)), (half * k, (0, 1j / turn, 0, s, -c, -1))]
    springs += [(half * bearing, own[0] - own[3]), (half * bearing, 1j * own[0] - own[4])]
    springs += [(bearing, row) for row in own[:3]]
    translational = frequencies([5.43, 2.35, 0.4, *(half * np.array([m, m, inertia]))], springs)
    tangential = (bearing + 2 * k * c**2) / m
    # (bearing + 2 k s² − m ω²)(2 k − I ω²) = 4 k² s²
    radial = np.roots([m * inertia, -2 * k * m - inertia * (bearing + 2 * k * s**2), 2 * k * bearing])
    return rotational, translational, np.sqrt(np.sort([tangential, *radial])) / (2 * np.pi)


@pytest.mark.parametrize("planets", [3, 4, 5])
def test_planetary_gear_has_the_frequencies_of_its_symmetry(planetary, planets):
    """The published frequencies are recomputed from the stated data."""
    rotational, translational, alone = planetary_by_kind(planets)
    expected = np.sort([*rotational, *np.repeat(translational, 2), *np.repeat(alone, planets - 3)])
    found = solve.frequencies(planetary(planets), count=9 + 3 * planets).values[0] / (2 * np.pi)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-2)
    np.testing.assert_allclose(alone, PLANETS, atol=0.051)
    if planets == 3:
        np.testing.assert_allclose(rotational[1:], LIN_PARKER[0], atol=0.051)
        np.testing.assert_allclose(translational, LIN_PARKER[1], atol=0.051)
    for row in (*LIN_PARKER, PLANETS):
        assert all(f"{frequency}" in PAGE for frequency in row)


@pytest.mark.slow
def test_planetary_gear_has_the_expected_parametric_resonances(planetary):
    """There is a resonance of one rotational mode and of two rotational modes, but none of a rotational with
    a translational mode."""
    M, _, K, _ = planetary(3).at(np.zeros(1), 1.0)
    meshes = planetary(3, 1.0).at(np.zeros(1), 1.0)[2][0] - K[0]
    squares, shapes = scipy.linalg.eigh(K[0], M[0])
    omega, epsilon = np.sqrt(squares.clip(0)), 0.02
    coupling = np.abs(shapes.T @ meshes @ shapes)
    numbers = {hertz: np.abs(omega / (2 * np.pi) - hertz).argmin() for row in LIN_PARKER for hertz in row}
    gear = planetary(3, epsilon)
    for first, second in ((7462.8, 7462.8), (2658.3, 7462.8)):
        p, q = numbers[first], numbers[second]
        width = epsilon * coupling[p, q] / (2 * np.sqrt(omega[p] * omega[q]))
        assert is_unstable_within(gear, omega[p] + omega[q], width)
    p, q = numbers[2658.3], numbers[6986.3]
    assert coupling[p, q] < 1e-6 * coupling[p, p]
    assert solve.floquet(gear, omega[p] + omega[q]).stable
