"""Which parameters affect the cam's output most? Do the elasticities sum to zero, as scaling requires?"""

import solve
from solve.labels import unit_of
from solve.views.style import BLUE, VERMILION, page

cam = solve.load("cam")
found = solve.sensitivities(cam, "100 rpm", of="q3.max_abs").elasticities("q3.max_abs")

# Masses, dampers, springs and the load, all larger by one factor, change forces but no motion: the sum of
# their elasticities is 0 (Euler's theorem on homogeneous functions).
scaled = [name for name in found if name in cam.parameters and unit_of(cam, name).name[:1] in "kN"]
total = sum(found[name] for name in scaled)

ranked = sorted((name for name in found if abs(found[name]) > 0.05), key=lambda name: abs(found[name]))
with page(3.6, "Cam at 100 rpm: change of max|q3| in % if a parameter increases by 1 %") as figure:
    axes = figure.subplots()
    colours = [BLUE if found[name] > 0 else VERMILION for name in ranked]
    axes.barh(ranked, [found[name] for name in ranked], color=colours)
    axes.set_xlabel(f"elasticity; sum over masses, springs, dampers and loads: {abs(total):.0e}")
    figure.savefig("elasticities.png", dpi=150)
