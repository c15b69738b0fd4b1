"""How fast must a pivot oscillate to hold a pendulum upright? Kapitza's pendulum, derived in memory."""

import numpy as np
from scipy.special import mathieu_a, mathieu_b

import solve
from derive import Mechanism, cos, rate, sin
from solve.views.style import BLACK, VERMILION, styled


def pendulum():
    swing = Mechanism("pendulum", "Inverted pendulum with a vertically oscillating pivot")
    q = swing.coordinate("q", "rad", "angle from the upright position")
    m, L = swing.parameters(m=("kg", "bob", "> 0"), L=("m", "length", "> 0"))
    g, A = swing.parameters(g=("m/s^2", "gravity"), A=("m", "amplitude of the pivot"))
    height = A * cos(swing.phase) + L * cos(q)
    swing.kinetic = m * (rate(height) ** 2 + rate(L * sin(q)) ** 2) / 2
    swing.potential = m * g * height
    return swing


g, L = 9.81, 0.2
upright = solve.load(pendulum, m=1, L=L, g=g, A=0.01)
chart = solve.chart(upright, "A=0.005:0.12:60", "speed=10:200:60 rad/s")
edge = chart.cut(x=0.02).crossings[0][0]

A = np.linspace(0.005, 0.12, 200)
limits = np.transpose(
    [-mathieu_a(0, 2 * A / L), -mathieu_b(1, 2 * A / L)]
)  # 4g/(LΩ²) where it falls, and swings
exact = np.sqrt(4 * g / (L * np.where(limits > 0, limits, np.nan)))

with styled():
    figure = chart.plot()
    axes = figure.axes[0]
    axes.plot(A, exact, ":", color=VERMILION, linewidth=3, label=["Mathieu's a0 and b1", None])
    axes.plot(A, np.sqrt(2 * g * L) / A, color=BLACK, linewidth=0.8, label="Kapitza's Ω = √(2gL)/A")
    axes.set(ylim=(10, 200))
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    figure.savefig("kapitza.png", dpi=150)
