"""Thirty periodic systems of the literature and of practice, each as functions of the phase.

Only `exact.py` uses them, to write `systems.json`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from solve.arrays import Array

Matrix = Callable[[Array], Array] | Array | float


@dataclass(frozen=True)
class Definition:
    """M, C, K, d: functions of phases (m,), constant arrays, or multiples of the unit matrix. Ω in rad/s."""

    name: str
    about: str
    speed: float
    M: Matrix
    C: Matrix
    K: Matrix
    d: Matrix
    n: int = 1

    def values(self, symbol: str, phase: Array) -> Array:
        value = getattr(self, symbol)
        if callable(value):
            return np.asarray(value(phase)).reshape(len(phase), *self._shape(symbol))
        full = np.eye(self.n) * value if symbol != "d" and np.ndim(value) == 0 else value
        return np.broadcast_to(full, (len(phase), *self._shape(symbol)))

    def _shape(self, symbol: str) -> tuple[int, ...]:
        return (self.n,) if symbol == "d" else (self.n, self.n)


def hill(name: str, about: str, damping: float, stiffness: Callable[[Array], Array]) -> Definition:
    """Return q̈ + damping q̇ + stiffness(φ) q = cos φ at 1 rad/s."""
    return Definition(name, about, 1.0, 1.0, damping, stiffness, np.cos)


def definitions() -> Iterator[Definition]:
    yield from _single()
    yield from _coupled()
    yield from _machines()
    yield from _chains()


def _single() -> Iterator[Definition]:
    cos, sin = np.cos, np.sin
    mathieu = "q̈ + 2ζ√δ q̇ + (δ + ε cos 2φ) q = cos φ, "
    for name, zeta, delta, epsilon in (
        ("mathieu_stable", 0.01, 1.7, 0.8),
        ("mathieu_first_tongue", 0.01, 1.02, 0.4),
        ("mathieu_second_tongue", 0.0, 4.05, 1.3),
        ("mathieu_edge", 0.01, 1.0, 0.040000003),
        ("mathieu_strong", 0.02, 3.0, 18.0),
        ("mathieu_inverted", 0.05, -0.2, 1.1),
        ("mathieu_fast_mode", 0.001, 2500.3, 200.0),
        ("mathieu_overdamped", 1.5, 9.0, 4.0),
    ):
        damping = 2 * zeta * abs(delta) ** 0.5

        def stiffness(phase: Array, delta=delta, epsilon=epsilon) -> Array:
            return delta + epsilon * cos(2 * phase)

        about = f"{mathieu}δ = {delta}, ε = {epsilon}, ζ = {zeta}"
        yield hill(name, about, damping, stiffness)
    yield hill(
        "whittaker_hill",
        "Whittaker-Hill equation: q̈ + 0.05 q̇ + (2 + 0.9 cos 2φ + 0.6 cos 4φ) q = cos φ",
        0.05,
        lambda phase: 2 + 0.9 * cos(2 * phase) + 0.6 * cos(4 * phase),
    )
    yield hill(
        "hill_asymmetric",
        "Hill's equation without symmetry in φ: K = 1.2 + 0.5 cos φ + 0.4 sin 2φ - 0.3 cos 3φ, C = 0.02",
        0.02,
        lambda phase: 1.2 + 0.5 * cos(phase) + 0.4 * sin(2 * phase) - 0.3 * cos(3 * phase),
    )
    yield hill(
        "narrow_bump",
        "Stiffness 3.9 + 4 exp(400 (cos(φ - 1) - 1)), a bump about 0.05 rad wide; C = 0.02",
        0.02,
        lambda phase: 3.9 + 4 * np.exp(400 * (cos(phase - 1) - 1)),
    )
    yield hill(
        "mesh_stiffness",
        "Gear mesh: Fourier sum of a rectangular stiffness 6 ± 2 (contact ratio 1.6) up to harmonic 20, "
        "with Lanczos factors; C = 0.1",
        0.1,
        lambda phase: (
            6.4
            + sum(
                8 / (np.pi * k) * np.sin(0.6 * np.pi * k) * np.sinc(k / 21) * cos(k * phase)
                for k in range(1, 21)
            )
        ),
    )
    yield Definition(
        "varying_damping",
        "q̈ + (0.1 + 0.3 cos φ) q̇ + (2.3 + 0.2 sin φ) q = sin 2φ: damping negative over a part of the period",
        1.3,
        1.0,
        lambda phase: 0.1 + 0.3 * cos(phase),
        lambda phase: 2.3 + 0.2 * sin(phase),
        lambda phase: sin(2 * phase),
    )
    yield Definition(
        "crank_inertia",
        "Torsion of a crank train, inertia I = 1 - 0.5 cos 2φ: I q̈ + (I′Ω + 0.02) q̇ + (40 + I″Ω²/2) q = "
        "-I′Ω²/2 (secondary resonance; compare M. S. Pasricha, W. D. Carnegie, J. Sound Vib. 66 (1979) "
        "181-186)",
        6.1,
        lambda phase: 1 - 0.5 * cos(2 * phase),
        lambda phase: 6.1 * sin(2 * phase) + 0.02,
        lambda phase: 40 + 6.1**2 * cos(2 * phase),
        lambda phase: -(6.1**2) * sin(2 * phase) / 2,
    )
    yield Definition(
        "load_of_many_harmonics",
        "q̈ + 0.3 q̇ + (30 + 5 cos φ) q = 10 exp(60 (cos φ - 1)): a pulse load",
        1.0,
        1.0,
        0.3,
        lambda phase: 30 + 5 * cos(phase),
        lambda phase: 10 * np.exp(60 * (cos(phase) - 1)),
    )
    yield Definition(
        "parametric_amplifier",
        "Parametric amplifier below its threshold (D. Rugar, P. Grütter, Phys. Rev. Lett. 67 (1991) "
        "699-702): q̈ + 0.01 q̇ + (1 + 0.018 sin 2φ) q = cos φ",
        1.0,
        1.0,
        0.01,
        lambda phase: 1 + 0.018 * sin(2 * phase),
        cos,
    )


def _matrices(phase: Array, entries) -> Array:
    """Return matrices (m, n, n) from nested rows of numbers and arrays (m,)."""
    return np.stack([np.stack([e + 0 * phase for e in row], axis=-1) for row in entries], axis=-2)


def _coupled() -> Iterator[Definition]:
    cos, sin = np.cos, np.sin
    omega = np.diag([1.0, 2.25])
    for name, speed, coupling, kind in (
        ("sum_combination", 1.25, np.array([[0.0, 1.0], [1.0, 0.0]]), "Ω near (ω1 + ω2)/2"),
        ("difference_combination", 0.25, np.array([[0.0, 1.0], [-1.0, 0.0]]), "Ω near (ω2 - ω1)/2"),
    ):
        yield Definition(
            name,
            f"Two modes, ω = 1 and 1.5, coupled by 0.3 cos 2φ {coupling.tolist()}, {kind} "
            "(C. S. Hsu, J. Appl. Mech. 30 (1963) 367-372)",
            speed,
            1.0,
            0.02,
            lambda phase, coupling=coupling: omega + 0.3 * np.multiply.outer(cos(2 * phase), coupling),
            np.array([1.0, 0.0]),
            n=2,
        )
    yield Definition(
        "rotating_shaft",
        "Disc of 10 kg on a shaft of stiffness 9e4 and 1.44e5 N/m in two rotating directions, under gravity, "
        "with 40 N s/m of drag: constant in the rotating frame, so that multipliers have a closed form",
        100.0,
        10.0,
        40.0,
        lambda phase: _rotating(phase, 9e4, 1.44e5),
        np.array([0.0, -98.1]),
        n=2,
    )
    yield Definition(
        "shaft_in_anisotropic_bearings",
        "The same shaft in bearings that add 2e4 N/m vertically: periodic in every frame",
        118.0,
        10.0,
        40.0,
        lambda phase: _rotating(phase, 9e4, 1.44e5) + np.diag([0.0, 2e4]),
        np.array([0.0, -98.1]),
        n=2,
    )
    yield Definition(
        "twin_oscillators",
        "Two equal Mathieu oscillators coupled by 1e-6: nearly defective multipliers",
        1.0,
        1.0,
        0.05,
        lambda phase: _matrices(phase, [[2 + 0.5 * cos(2 * phase), 1e-6], [0.0, 2 + 0.5 * cos(2 * phase)]]),
        np.array([0.0, 1.0]),
        n=2,
    )
    yield Definition(
        "stiff_and_soft",
        "Modes at 1 and 1000 rad/s, damping ratios 0.02 and 0.0005, axes that sway by 0.3 sin φ",
        1.0,
        1.0,
        lambda phase: _swaying(phase, 0.04, 1.0),
        lambda phase: _swaying(phase, 1.0, 1e6),
        np.array([1.0, 1.0]),
        n=2,
    )
    yield Definition(
        "kapitza_double_pendulum",
        "Inverted double pendulum (linearised) on a pivot that oscillates vertically: "
        "M q̈ + 0.05 q̇ + (0.12 cos φ - 0.001) diag(2, 1) q = 0 with M = ((2, 1), (1, 1)), in units of Ω",
        1.0,
        np.array([[2.0, 1.0], [1.0, 1.0]]),
        0.05,
        lambda phase: np.multiply.outer(0.12 * cos(phase) - 0.001, np.diag([2.0, 1.0])),
        np.zeros(2),
        n=2,
    )
    yield Definition(
        "gyroscopic",
        "Gyroscopic coupling G(1 + 0.4 cos φ), three coordinates, weakly damped",
        0.8,
        1.0,
        lambda phase: (
            np.multiply.outer(1 + 0.4 * cos(phase), np.array([[0, 1, 0], [-1, 0, 0.5], [0, -0.5, 0]]))
            + 0.01 * np.eye(3)
        ),
        np.diag([1.0, 2.0, 5.0]),
        lambda phase: np.stack([cos(phase), sin(phase), 0 * phase], axis=-1),
        n=3,
    )
    yield Definition(
        "strong_decay",
        "Three modes with damping ratios 0.9, 0.3 and 0.01, coupled by 0.5 cos φ: multipliers down to 1e-17",
        1.0,
        1.0,
        np.diag([10.8, 1.2, 0.014]),
        lambda phase: np.diag([36.0, 4.0, 0.49]) + 0.5 * np.multiply.outer(cos(phase), 1 - np.eye(3)),
        np.array([1.0, 1.0, 1.0]),
        n=3,
    )


def _rotating(phase: Array, k1: float, k2: float) -> Array:
    mean, half = (k1 + k2) / 2, (k1 - k2) / 2
    c, s = half * np.cos(2 * phase), half * np.sin(2 * phase)
    return _matrices(phase, [[mean + c, s], [s, mean - c]])


def _swaying(phase: Array, soft: float, stiff: float) -> Array:
    """Return diag(soft, stiff) in axes at the angle 0.3 sin φ."""
    angle = 0.3 * np.sin(phase)
    mean, half = (soft + stiff) / 2, (soft - stiff) / 2
    c, s = half * np.cos(2 * angle), half * np.sin(2 * angle)
    return _matrices(phase, [[mean + c, s], [s, mean - c]])


def _machines() -> Iterator[Definition]:
    for name, dampers, rpm in (
        ("helicopter", [4067.5] * 4, 235),
        ("helicopter_failed_damper", [0.0, 4067.5, 4067.5, 4067.5], 235),
    ):
        speed = rpm * np.pi / 30
        yield Definition(
            name,
            "Rotor with four lagging blades on an elastic hub (C. E. Hammond, J. Am. Helicopter Soc. "
            f"19 (1974) 14-23), lag dampers {dampers} N m s, {rpm} rpm",
            speed,
            lambda phase: _helicopter(phase, 289.1, 0) + np.diag([8406.2, 3663.2, *[1084.7] * 4]),
            lambda phase, dampers=dampers, speed=speed: (
                _helicopter(phase, 2 * speed * 289.1, 1) + np.diag([51078.7, 25539.3, *dampers])
            ),
            lambda phase, speed=speed: (
                _helicopter(phase, speed**2 * 289.1, 2)
                + np.diag([1240481.8, 1240481.8, *[0.3048 * 289.1 * speed**2] * 4])
            ),
            np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            n=6,
        )


def _helicopter(phase: Array, factor: float, order: int) -> Array:
    """Coupling of hub and lag of four blades at angles ψ: derivative of (-sin ψ, cos ψ) of an order."""
    entries = np.zeros((len(phase), 6, 6))
    for blade in range(4):
        angle = phase + blade * np.pi / 2 + order * np.pi / 2
        entries[:, 0, 2 + blade], entries[:, 1, 2 + blade] = -np.sin(angle), np.cos(angle)
    if order == 0:
        entries += np.swapaxes(entries, 1, 2)
    return factor * entries


def _chains() -> Iterator[Definition]:
    for n, depth in ((4, 0.5), (8, 0.6), (12, 0.9)):
        angles = 2 * np.pi * np.arange(n + 1) / (n + 1)

        def stiffness(phase: Array, n=n, depth=depth, angles=angles) -> Array:
            springs = 1 + depth * np.cos(phase[:, None] - angles)
            K, at = np.zeros((len(phase), n, n)), np.arange(n)
            K[:, at, at] = springs[:, :-1] + springs[:, 1:]
            K[:, at[:-1], at[1:]] = K[:, at[1:], at[:-1]] = -springs[:, 1:-1]
            return K

        yield Definition(
            f"chain_{n}",
            f"Chain of {n} masses between walls; springs 1 + {depth} cos(φ - angle), a travelling wave",
            0.9,
            1.0,
            0.03,
            stiffness,
            lambda phase, n=n: np.multiply.outer(np.cos(phase), np.eye(n)[0]),
            n=n,
        )
