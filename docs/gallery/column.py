"""Which pulsating loads make a column unstable? Bolotin's regions of its first two modes."""

import itertools

import numpy as np
from scipy.special import mathieu_a, mathieu_b

import solve
from derive import Mechanism, cos, pi, rate, sin
from solve.views.style import VERMILION, styled


def pinned_column():
    column = Mechanism("column", "Pinned column under a load that pulsates twice per revolution")
    L, mu, EI = column.parameters(
        L=("m", "length", "> 0"), mu=("kg/m", "mass per length", "> 0"), EI=("N m^2", "bending", "> 0")
    )
    P0, P1 = column.parameters(P0=("N", "mean load"), P1=("N", "amplitude of the load"))
    modes = column.option("modes", range(1, 6), default=2)
    beam = column.field("w", "m", "deflection", length=L, shape=lambda k, xi: sin(k * pi * xi), modes=modes)
    column.kinetic = beam.integral(mu * rate(beam.deflection) ** 2) / 2
    column.potential = beam.integral(EI * beam.curvature**2) / 2
    column.force(P0 + P1 * cos(2 * column.phase), along=beam.total_shortening)
    column.period = pi
    return column


L, mu, EI, P0 = 2.0, 3.0, 500.0, 100.0
model = solve.load(pinned_column, L=L, mu=mu, EI=EI, P0=P0, P1=0)
chart = solve.chart(model, "speed=24:140:120 rad/s", "P1=0:800:60")

with styled():
    figure = chart.plot()
    axes = figure.axes[0]
    q = np.linspace(0, 0.85, 200)
    for k in (1, 2):
        wave, euler = k * np.pi / L, EI * (k * np.pi / L) ** 2
        for n, edge in itertools.product((1, 2, 3), (mathieu_a, mathieu_b)):
            square = wave**2 * (euler - P0) / mu / edge(n, q)  # Ω² at which an edge has that q
            axes.plot(np.sqrt(square), 2 * q * square * mu / wave**2, ":", color=VERMILION, linewidth=2.5)
    axes.set(xlim=(26, 140), ylim=(0, 650))
    axes.plot([], [], ":", color=VERMILION, linewidth=2.5, label="Mathieu's characteristic values")
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1))
    figure.savefig("column.png", dpi=150)
