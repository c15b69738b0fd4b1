"""Where is q″ + (δ + ε cos 2t) q = 0 unstable? Mathieu's tongues, with their edges computed by SciPy."""

import numpy as np
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.views.style import VERMILION, styled

chart = solve.chart(solve.load("mathieu", zeta=0), "delta=-1:12:70", "epsilon=0:10:60")

epsilon = np.linspace(0, 10, 26)
edges = [mathieu_a(0, epsilon / 2)]  # δ of the solutions of period π or 2π
for n in (1, 2, 3):
    edges += [mathieu_b(n, epsilon / 2), mathieu_a(n, epsilon / 2)]

first_tongue = [delta for delta, kind in chart.cut(y=1.0).crossings if kind == "-1"][:2]

with styled():
    figure = chart.plot()
    axes = figure.axes[0]
    for delta in edges:
        axes.plot(delta, epsilon, "o", color=VERMILION, markersize=2.5)
    for n, at in ((1, (1, 0.7)), (2, (4.25, 3)), (3, (9.75, 7.5))):
        axes.annotate(f"{n}", at, ha="center", va="bottom", fontweight="bold")
    axes.plot([], [], "o", color=VERMILION, markersize=2.5, label="SciPy's characteristic values")
    axes.set(xlim=(-1, 12), ylim=(0, 10))
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1))
    figure.savefig("mathieu.png", dpi=150)
