"""How large is the response of an oscillator to a run-up through resonance? Lewis' problem in closed form."""

import numpy as np
from scipy.special import fresnel

import solve
from derive import Mechanism, cos, rate
from solve.views.style import BLUE, GREY, VERMILION, page


def oscillator():
    machine = Mechanism("oscillator", "Mass on a spring under a load that rotates with the drive")
    q = machine.coordinate("q", "m", "deflection")
    m, k, F = machine.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring", "> 0"), F=("N", "load"))
    machine.kinetic = m * rate(q) ** 2 / 2
    machine.potential = k * q**2 / 2
    machine.force(F * cos(machine.phase), along=q)
    return machine


model = solve.load(oscillator, m=1.0, k=1.0, F=1.0)  # static deflection 1 m, natural frequency 1 rad/s
run = solve.transient(model, turns=36, speeds=[0.0, 2.0])
t, q = run.time, run.q[0]
a = 2.0 / t[-1]  # the speed rises by a rad/s each second: the load is cos(a t²/2)


def integral(s):  # of exp(i a u²/2) over u from 0 to s
    S, C = fresnel(s * np.sqrt(a / np.pi))
    return np.sqrt(np.pi / a) * (C + 1j * S)


rising = np.exp(-0.5j / a) * (integral(t - 1 / a) - integral(-1 / a))
falling = np.exp(0.5j / a) * np.conj(integral(t + 1 / a) - integral(1 / a))
exact = (np.exp(1j * t) * (rising + falling)).imag / 2  # ∫ sin(t - s) cos(a s²/2) ds
error = abs(q - exact).max() / abs(exact).max()

with page(3.2, "Run-up through resonance in 36 revolutions, without damping") as figure:
    axes = figure.subplots()
    speed, steady = a * t, 1 / abs(1 - (a * t) ** 2)
    axes.plot(speed, q, color=BLUE, label="transient")
    axes.plot(speed[::60], exact[::60], ".", color=VERMILION, label="Fresnel's integrals")
    axes.plot(speed, steady, "--", color=GREY, label="amplitude at constant speed")
    axes.set(xlabel="speed / natural frequency", ylabel="deflection / static", ylim=(-17, 25), xlim=(0, 2))
    axes.legend(loc="upper left")
    figure.savefig("run_up.png", dpi=150)
