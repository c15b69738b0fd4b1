"""What stiffness and damping of the cam's shaft follow from a noisy record of its torque?"""

import numpy as np

import solve
from solve.views.style import BLUE, GREY, VERMILION, page

cam, noise = solve.load("cam"), np.random.default_rng(1)
true = {"k1": 90e3, "c1": 15.0}  # for want of a machine, the record is computed
angles = np.arange(0, 360, 2.0)
torque = solve.periodic(cam.varied(true), "400 rpm").signal("shaft_torque")(np.radians(angles))
noisy = torque + 0.05 * np.std(torque) * noise.standard_normal(len(angles))
rows = [f"{angle},{value}" for angle, value in zip(angles, noisy, strict=True)]
with open("torque.csv", "w") as file:
    file.write("\n".join(["phase (deg),shaft_torque (N m)", *rows]))

fit = solve.fit(cam, "torque.csv", ["k1", "c1"], speed="400 rpm")
fine = np.linspace(0, 360, 721)

with page(3.0, "Cam at 400 rpm: shaft fitted to its torque") as figure:
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    left.plot(angles, noisy / 1e3, ".", color=GREY, label="measured, 5 % noise")
    for model, colour, label in ((cam, BLUE, "before"), (fit.system, VERMILION, "fitted")):
        curve = solve.periodic(model, "400 rpm").signal("shaft_torque")(np.radians(fine))
        left.plot(fine, curve / 1e3, color=colour, label=label)
    for name, row in (("k1", 1), ("c1", 0)):
        value, low, high = np.array(fit.parameters[name]) / true[name]
        right.errorbar(value, row, xerr=[[value - low], [high - value]], fmt="o", color=VERMILION, capsize=3)
        right.plot(cam.parameters[name] / true[name], row, "s", color=BLUE)
    right.axvline(1, color=GREY, linestyle="--")
    left.set(xlabel="phase (°)", ylabel="torque of the shaft (kN m)", xticks=range(0, 361, 90))
    right.set(xlabel="fitted / true, 95 % interval", yticks=(0, 1), yticklabels=("c1", "k1"), ylim=(-1, 2))
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig("shaft_fit.png", dpi=150)
