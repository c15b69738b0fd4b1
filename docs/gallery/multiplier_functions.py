"""Can a few frequencies of a four-bar predict its critical speeds? (thesis Fig. 7.3)"""

from itertools import combinations

import numpy as np
from scipy.linalg import eigh

import solve
from solve.views.style import BLACK, BLUE, GREEN, VERMILION, page

four_bar = solve.load("four_bar")
speeds = 1 / np.linspace(1 / 50, 1 / 20, 121)  # rad/s, even in the period


def lowest_frequency(phase):
    M, _, K, _ = four_bar.at(np.array([phase]), 0.0)
    return np.sqrt(eigh(K[0], M[0], eigvals_only=True)[0])


def J(v, T):
    """Half the trace of the monodromy matrix where the frequencies v hold for T/N each (thesis (7.11))."""
    N, total = len(v), 0.0
    C, S = np.cos(v * T / N), np.sin(v * T / N)
    for count in range(0, N + 1, 2):
        for some in combinations(range(N), count):
            ratio = np.prod(v[list(some[1::2])]) / np.prod(v[list(some[::2])])
            others = np.prod(np.delete(C, some)) * np.prod(S[list(some)])
            total += (-1) ** (count // 2) * (ratio + 1 / ratio) / 2 * others
    return total


functions = {}
for N in (2, 3, 4):
    v = np.array([lowest_frequency(2 * np.pi * (k + 0.5) / N) for k in range(N)])
    functions[N] = np.array([J(v, 2 * np.pi / speed) for speed in speeds])
rho = solve.sweep(four_bar, speeds, rtol=1e-5).multipliers[:, 0]

with page(3.4, "Functions J of the lowest frequencies of a four-bar") as figure:
    axes = figure.subplots()
    for (N, function), colour in zip(functions.items(), (VERMILION, GREEN, BLUE), strict=True):
        axes.plot(speeds, function, color=colour, linewidth=6 - 1.2 * N, label=f"$J_{N}$")
    axes.plot(speeds, rho.real / abs(rho), "--", color=BLACK, label="Re ρ/|ρ| of the dominant multiplier")
    axes.set(xlabel="speed (rad/s)", ylabel="J, Re ρ/|ρ|", xlim=(20, 50), ylim=(-1.5, 1.5))
    axes.legend(loc="lower left", ncols=4)
    figure.savefig("multiplier_functions.png", dpi=150)
