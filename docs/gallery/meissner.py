"""Where is an oscillator unstable if its stiffness jumps twice per period? Meissner's chart and formula."""

import numpy as np

import solve
from solve.views.style import VERMILION, styled

model = solve.load("meissner", "stable")  # at π rad/s each stiffness lasts one second
chart = solve.chart(model, "w1=0.05:9.5:80", "w2=0.05:9.5:80")

x1, x2 = np.meshgrid(chart.x, chart.y)
J = np.cos(x1) * np.cos(x2) - (x1 / x2 + x2 / x1) / 2 * np.sin(x1) * np.sin(x2)

trace = solve.floquet(model.varied({"w1": 3.0, "w2": 5.0}), model.labels.case_speed).multipliers.sum().real

with styled():
    figure = chart.plot()
    axes = figure.axes[0]
    axes.contour(x1, x2, J, levels=[-1, 1], colors=VERMILION, linewidths=2.5, linestyles=":")
    axes.plot([], [], ":", color=VERMILION, linewidth=2.5, label="|J(w1, w2)| = 1")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1))
    figure.savefig("meissner.png", dpi=130)
