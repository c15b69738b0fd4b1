"""The four-bar with one to three modes per link: estimated and true errors of the reduction."""

import numpy as np

import solve
from solve.views.style import BLUE, GREEN, VERMILION, page

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
with page(3.6, "Reduced four-bar: estimated errors (lines), true errors (dots)") as figure:
    axes = figure.subplots(1, 2, sharex=True)
    for modes, colour in zip((1, 2, 3), (BLUE, VERMILION, GREEN), strict=True):
        model = solve.load("four_bar", options=elements, reduce=modes)
        reduced = solved(model)
        true = np.array([differences(*ours, *exact) for ours, exact in zip(reduced, truth, strict=True)])
        errors = [orbit.reduction_error for orbit, _ in reduced]
        estimated = np.array([[getattr(error, name) for name in names] for error in errors])
        ratios[modes] = true / estimated
        for axis, line, dots in zip(axes, estimated.T, true.T, strict=True):
            axis.semilogy(speeds, line, color=colour, label=f"{modes} per link: {model.n} coordinates")
            axis.semilogy(speeds, dots, "o", color=colour, markersize=4)
    for axis, name in zip(axes, names, strict=True):
        axis.set(title=name, xlabel="speed (rad/s)", ylabel="relative error")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.savefig("four_bar_reduced.png", dpi=150)
