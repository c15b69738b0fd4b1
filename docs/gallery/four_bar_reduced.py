"""The four-bar with one to three modes per link: estimated and true errors of the reduction."""

import matplotlib.pyplot as plt
import numpy as np

import solve

elements, phase = {"elements": 3}, np.linspace(0, 2 * np.pi, 720, endpoint=False)
full = solve.load("four_bar", options=elements)
speeds, names, ratios = np.linspace(10, 90, 17), ("orbit", "multipliers"), {}


def solved(model):
    """Orbits and multipliers at all speeds."""
    points = solve.sweep(model, speeds, rtol=1e-6).points
    return [(solve.periodic(model, at.speed, rtol=1e-6), np.array(at.multipliers)) for at in points]


def differences(reduced, own, orbit, rho):
    """Largest max|error|/max|q| of the coordinates, and error of the multipliers relative to the spectral
    radius."""
    q, ours = orbit.at(phase), reduced.system.expanded(phase, reduced.speed, reduced.at(phase)).q
    of_multipliers = np.abs(own[:, None] - rho).min(axis=1).max() / abs(rho[0])
    return (np.abs(ours - q).max(axis=1) / np.abs(q).max(axis=1)).max(), of_multipliers


truth = solved(full)
figure, axes = plt.subplots(1, 2, figsize=(10, 4.5), sharex=True, layout="constrained")
for modes in (1, 2, 3):
    model = solve.load("four_bar", options=elements, reduce=modes)
    reduced = solved(model)
    true = np.array([differences(*ours, *exact) for ours, exact in zip(reduced, truth, strict=True)])
    estimated = np.array([[getattr(each.reduction_error, name) for name in names] for each, _ in reduced])
    ratios[modes] = true / estimated
    for axis, line, dots in zip(axes, estimated.T, true.T, strict=True):
        (drawn,) = axis.semilogy(speeds, line, label=f"reduce={modes}: {model.n} of {full.n} coordinates")
        axis.semilogy(speeds, dots, "o", color=drawn.get_color(), markersize=4)
for axis, name in zip(axes, names, strict=True):
    axis.set(title=f"{name}: estimated (lines), true (dots)", xlabel="speed (rad/s)", ylabel="relative error")
    axis.grid(alpha=0.3)
axes[0].legend(fontsize="small")
figure.savefig("four_bar_reduced.png", dpi=130)
