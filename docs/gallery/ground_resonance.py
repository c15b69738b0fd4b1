"""Which rotor speeds must a helicopter on its landing gear pass quickly? Coleman's ground resonance."""

import numpy as np

import solve
from derive import Mechanism, cos, pi, rate, sin
from solve.views.style import BLUE, VERMILION, page


def helicopter():
    rotor = Mechanism("ground", "Hub on its landing gear, three blades that lag, no dampers")
    x, y = rotor.coordinates(x=("m", "hub, forwards"), y=("m", "hub, to the left"))
    lags = rotor.coordinates(z1=("rad", "lag, blade 1"), z2=("rad", "blade 2"), z3=("rad", "blade 3"))
    M, m, J = rotor.parameters(M=("kg", "hub"), m=("kg", "blade"), J=("kg m^2", "blade"))
    K, S, e = rotor.parameters(K=("N/m", "gear"), S=("kg m", "blade"), e=("m", "hinge from the axis"))
    rotor.kinetic = M * (rate(x) ** 2 + rate(y) ** 2) / 2
    rotor.potential = K * (x**2 + y**2) / 2
    for k, lag in enumerate(lags):
        root = rotor.phase + 2 * pi * k / 3
        vx, vy, blade = rate(x + e * cos(root)), rate(y + e * sin(root)), root + lag
        rotor.kinetic += m * (vx**2 + vy**2) / 2 + J * rate(blade) ** 2 / 2
        rotor.kinetic += S * rate(blade) * (cos(blade) * vy - sin(blade) * vx)
    return rotor


M, K, m, S, J, e = 8026.6, 1240481.8, 94.9, 289.1, 1084.7, 0.3048  # Hammond 1974, three of his blades
rotor = solve.load(helicopter, M=M, K=K, m=m, S=S, J=J, e=e)
speeds = np.linspace(60, 320, 261) * np.pi / 30
growth = np.log(solve.sweep(rotor, speeds).spectral_radius) * speeds / (2 * np.pi)
exact = []
for w in speeds:  # z = x + iy and Z = Σ ζk exp(iψk) see constant coefficients (NACA Report 1351)
    blades = np.polymul([1, -1j * w], [1, -1j * w]) * J + [0, 0, e * S * w**2]
    whirl = np.polysub(np.polymul([M + 3 * m, 0, K], blades), [1.5 * S**2, 0, 0, 0, 0])
    exact.append(np.roots(whirl).real.max())

with page(3.0, "Ground resonance, without dampers") as figure:
    axes, rpm = figure.subplots(), speeds * 30 / np.pi
    axes.plot(rpm, growth, color=BLUE, label="five coordinates, periodic coefficients")
    axes.plot(rpm[::4], exact[::4], "o", color=VERMILION, label="Coleman's polynomial, rotating axes")
    axes.set(xlabel="speed (rpm)", ylabel="growth (1/s)")
    axes.legend(loc="upper right")
    figure.savefig("ground_resonance.png", dpi=150)
