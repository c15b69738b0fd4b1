"""How many operations do a periodic solution and a time integration take? (thesis Fig. 6.6)"""

import math

import numpy as np

import solve
from solve.studies.flops import algorithm_1, algorithm_2, time_marching
from solve.views.style import BLUE, GREEN, ORANGE, VERMILION, page

INTERVALS = np.arange(90, 721, 10)  # a turn
four_bar = solve.load("four_bar")


def cycles(zeta):
    """Until a perturbation at 62 rad/s has fallen to 1e-4."""
    rho = solve.floquet(four_bar.varied({"zeta": zeta}), "62 rad/s", rtol=1e-6).spectral_radius
    return math.ceil(math.log(1e-4) / math.log(rho))


with page(3.2, "Operations to the steady state of a four-bar") as figure:
    axes = figure.subplots()
    for zeta, colour in ((0.02, VERMILION), (0.05, ORANGE)):
        count = cycles(zeta)
        operations = time_marching(INTERVALS, four_bar.n, count, stored=False)
        axes.plot(INTERVALS, operations / 1e6, color=colour, label=f"integrated {count} cycles, ζ {zeta:.0%}")
    for name, algorithm, colour in (("2", algorithm_2, GREEN), ("1", algorithm_1, BLUE)):
        operations = algorithm(INTERVALS, four_bar.n, stored=False)
        axes.plot(INTERVALS, operations / 1e6, color=colour, label=f"algorithm {name}")
    axes.set(xlabel="intervals per revolution", ylabel="million operations", xlim=(90, 720), ylim=(0, None))
    axes.legend()
    figure.savefig("operations.png", dpi=150)
