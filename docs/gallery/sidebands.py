"""Which sidebands surround a gear pair's mesh frequency? The rotation of the shafts modulates it."""

import numpy as np

import solve
from solve.views.style import BLUE, GREY, VERMILION, page

lines = {}
for load in ("tracking", "constant"):  # whether the load follows the tooth error, chapter (71), or not
    gears = solve.load("gear_pair", options={"load": load})
    orbit = solve.periodic(gears, "1800 rpm")
    lines[load], _ = orbit.harmonics("transmission_error_rate", 80)

hertz = 30 * np.arange(81)  # 1800 rpm are 30 turns a second, and 14 teeth mesh at 420 Hz
mesh = lines["tracking"][[14, 28]]  # amplitudes at 420 and at 840 Hz, m/s

with page(3.2, "Gear pair at 1800 rpm: rate of the transmission error") as figure:
    axes = figure.subplots()
    for load, colour, shift in (("tracking", BLUE, 0), ("constant", VERMILION, 8)):
        label = "load that follows the tooth error" if load == "tracking" else "constant load"
        axes.vlines(hertz + shift, 1e-7, lines[load], color=colour, label=label)
    for k in range(1, 6):
        axes.annotate(f"{k} × mesh", (420 * k, 0.03), ha="center", color=GREY)
    axes.annotate("sidebands,\n30 Hz apart", (560, 2e-3), color=GREY)
    axes.set(
        yscale="log", ylim=(1e-7, 0.2), xlim=(0, 2400), xlabel="frequency (Hz)", ylabel="amplitude (m/s)"
    )
    figure.legend(loc="outside lower center", ncols=2)
    figure.savefig("sidebands.png", dpi=150)
