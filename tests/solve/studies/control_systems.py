"""First-order systems for tests of control."""

import numpy as np

import solve

PHASES = np.array([0.1, 1.3, 2.9, 4.4, 6.0])


def constant(A, B, C=None):
    """First-order system with constant matrices."""
    N, r = B.shape
    C = np.eye(N)[:1] if C is None else C

    def matrices(phase, speed):
        arrays = A, np.zeros(N), B, C, np.zeros((len(C), r))
        return [np.broadcast_to(each, (len(phase), *each.shape)) for each in arrays]

    names = [f"x{k}" for k in range(N)]
    outputs = [f"y{k}" for k in range(len(C))]
    return solve.FirstOrderSystem(matrices, names, inputs=[f"u{k}" for k in range(r)], outputs=outputs)


def varying(A, B, period=2 * np.pi, breaks=()):
    """First-order system with A (k, N, N) and B (k, N, r) as functions of the phase."""
    N, r = B(np.zeros(1)).shape[1:]

    def matrices(phase, speed):
        m = len(phase)
        return A(phase), np.zeros((m, N)), B(phase), np.zeros((m, 0, N)), np.zeros((m, 0, r))

    inputs = [f"u{k}" for k in range(r)]
    return solve.FirstOrderSystem(matrices, [f"x{k}" for k in range(N)], period, breaks, inputs)


A0, B0 = np.array([[1.0, 0.5], [3.0, 5.0]]), np.array([[3.0], [1.0]])


def rotation(phase):
    c, s = np.cos(2 * phase), np.sin(2 * phase)
    return np.moveaxis(np.array([[c, s], [-s, c]]), 2, 0)


def in_rotating_frame(breaks=()):
    """Constant system in rotating coordinates x = P(t) z, for which X = P X₀ Pᵀ (Johansson et al. 2007)."""

    def A(phase):
        P = rotation(phase)
        return P @ A0 @ np.swapaxes(P, 1, 2) + 2 * np.array([[0.0, 1.0], [-1.0, 0.0]])

    return varying(A, lambda phase: rotation(phase) @ B0, np.pi, breaks)


def random_system(seed, most=20):
    """Periodic system with N states up to `most`, two inputs, and entries with three harmonics."""
    rng = np.random.default_rng(seed)
    N = int(rng.integers(1, most + 1))
    a, b = rng.normal(size=(7, N, N)) / np.sqrt(N), rng.normal(size=(7, N, 2))

    def series(coefficients):
        def at(phase):
            waves = [np.ones(len(phase))]
            waves += [wave(k * phase) / (1 + k) for k in (1, 2, 3) for wave in (np.cos, np.sin)]
            return np.einsum("wk,w...->k...", waves, coefficients)

        return at

    return varying(series(a), series(b)), N


def slope_of(found, phase):
    """dX/dφ by central differences of order 8."""
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
    steps = 1e-3 * np.arange(-4, 5)
    return sum(w * found.riccati(phase + h) for w, h in zip(weights, steps, strict=True)) / 1e-3
