"""At which speeds is the whirl of a shaft with a flat unstable? Jeffcott's rotor written by hand."""

import numpy as np

import solve
from solve.views.style import BLUE, VERMILION, page

m, g, k1, k2 = 10.0, 9.81, 90e3, 144e3  # the shaft is softer about its flat, which turns with it
w1, w2 = np.sqrt(k1 / m), np.sqrt(k2 / m)


def matrices(phase, speed):
    one, c, s = np.ones_like(phase), np.cos(2 * phase), np.sin(2 * phase)
    mean, half = (k1 + k2) / 2 * one, (k1 - k2) / 2
    K = np.array([[mean + half * c, half * s], [half * s, mean - half * c]])
    M = m * np.eye(2) * one[:, None, None]
    return M, 0 * M, np.moveaxis(K, -1, 0), np.outer(one, [0, -m * g])


shaft = solve.PeriodicSystem(matrices, ["x", "y"], period=np.pi)
speeds = np.linspace(40, 135, 381)
sweep = solve.sweep(shaft, speeds)
growth = np.log(sweep.spectral_radius) * speeds / np.pi
band = solve.bands(shaft, [85.0, 125.0])[0]

# In coordinates that turn with the shaft: λ⁴ + (ω1² + ω2² + 2Ω²) λ² + (ω1² - Ω²)(ω2² - Ω²) = 0.
b, c = w1**2 + w2**2 + 2 * speeds**2, (w1**2 - speeds**2) * (w2**2 - speeds**2)
exact = np.sqrt(np.maximum(0, -b / 2 + np.sqrt(b**2 / 4 - c)))

with page(4.2, "Disc on a shaft of two stiffnesses") as figure:
    upper, lower = figure.subplots(2, sharex=True)
    upper.plot(speeds, growth, color=BLUE, label="from the multipliers")
    upper.plot(speeds[::4], exact[::4], "o", color=VERMILION, label="constant coefficients, rotating axes")
    lower.semilogy(speeds, 1e3 * sweep.figures("y"), color=BLUE)
    gravity = w1 * w2 / np.sqrt(2 * (w1**2 + w2**2))
    lower.axvline(gravity, color=VERMILION, linestyle=":", label="ω1 ω2/√(2 (ω1² + ω2²))")
    upper.set_ylabel("growth (1/s)")
    lower.set(xlabel="speed (rad/s)", ylabel="max|y| due to gravity (mm)")
    upper.legend(), lower.legend()
    figure.savefig("flat_shaft.png", dpi=150)
