"""How does a longer ground link affect the follower of a rigid four-bar? (thesis Fig. 7.12)"""

import numpy as np

import solve
from models.four_bar.linkage import Linkage
from solve.views.style import BLUE, GREEN, ORANGE, VERMILION, page

SPEED = 30.0  # rad/s
L1, L2, L3 = (solve.case_numbers("four_bar").parameters[name] for name in ("L1", "L2", "L3"))
t1 = np.radians(np.arange(361))

with page(3.2, "Acceleration of the follower at 30 rad/s") as figure:
    axes = figure.subplots()
    for L4, colour in ((0.53, VERMILION), (0.57, ORANGE), (0.61, GREEN), (0.65, BLUE)):
        linkage = Linkage(L1, L2, L3, L4)
        gamma = np.degrees(linkage.transmission_angle([0, np.pi]))
        label = f"$L_4$ = {L4} m, γ {gamma[0]:.0f}° to {gamma[1]:.0f}°"
        axes.plot(np.degrees(t1), linkage.motion(t1, SPEED).alpha[2], color=colour, label=label)
    axes.set(xlabel="crank angle (°)", ylabel="$α_3$ (rad/s²)", xticks=range(0, 361, 60))
    axes.legend()
    figure.savefig("follower_acceleration.png", dpi=150)
