"""Constant systems y″ + C y′ + K(x) y = 0 in periodic coordinates q with y = S(φ) q: the exponents are
eigenvalues of a constant matrix, and which of them belong together follows from the planted coupling."""

from dataclasses import dataclass

import numpy as np

from solve import PeriodicSystem
from tests.solve.certificates.transformed import View


@dataclass(frozen=True)
class Planted:
    """Frequencies (n, 2): ω at x = 1 and slope; damping (n,): 2ζω; couplings (i, j): gap of the frequencies
    of modes i and j where they meet. view: None for rotating coordinates."""

    frequencies: np.ndarray
    damping: np.ndarray
    couplings: dict
    view: View | None = None

    @property
    def n(self):
        return len(self.damping)

    def stiffness(self, x):
        omega = self.frequencies[:, 0] + self.frequencies[:, 1] * (x - 1)
        K = np.diag(omega**2)
        for (i, j), gap in self.couplings.items():
            # ω² ± k gives ω ± k/(2ω): a gap of k/ω, with ω at the meeting.
            K[i, j] = K[j, i] = gap * self.meeting(i, j)[1]
        return K

    def meeting(self, i, j):
        """x and ω at which the uncoupled modes meet."""
        (a, s), (b, t) = self.frequencies[i], self.frequencies[j]
        x = 1 + (b - a) / (s - t)
        return x, a + s * (x - 1)

    def exponents(self, x):
        """Eigenvalues (n,) of positive frequency, ascending."""
        A = np.block(
            [[np.zeros((self.n, self.n)), np.eye(self.n)], [-self.stiffness(x), -np.diag(self.damping)]]
        )
        values = np.linalg.eigvals(A)
        return np.array(sorted(values[values.imag > 0], key=lambda value: value.imag))

    def system(self, names="abcdef"):
        def matrices(phase, speed):
            S, dS, ddS = self.transformation(phase)
            C, W = np.diag(self.damping), np.swapaxes(S, 1, 2)
            M = W @ S
            damping = W @ (2 * speed * dS + C @ S)
            stiffness = W @ (speed**2 * ddS + speed * C @ dS + self.stiffness(speed) @ S)
            return M, damping, stiffness, np.zeros((len(phase), self.n))

        return PeriodicSystem(matrices, list(names[: self.n]))

    def transformation(self, phase):
        if self.view is not None:
            return self.view.at(phase)
        S, dS = (np.tile(each, (len(phase), 1, 1)) for each in (np.eye(self.n), np.zeros((self.n, self.n))))
        c, s = np.cos(phase), np.sin(phase)
        S[:, 0, 0], S[:, 0, 1], S[:, 1, 0], S[:, 1, 1] = c, s, -s, c
        dS[:, 0, 0], dS[:, 0, 1], dS[:, 1, 0], dS[:, 1, 1] = -s, c, -c, -s
        ddS = np.zeros_like(S)
        ddS[:, :2, :2] = -S[:, :2, :2]
        return S, dS, ddS


def pair(gap, seed, place=0.0137, damping=(0.02, 0.02), rotating=True):
    """Two modes that meet at x = 1 + place, and a third one, unless the coordinates rotate."""
    view = None if rotating else View.random(np.random.default_rng(seed), 3)
    rng = np.random.default_rng(seed)
    slope = rng.uniform(0.2, 0.6)
    omega = rng.uniform(2.6, 3.4)
    frequencies = [[omega - slope * place, slope], [omega + slope * place, -slope]]
    damping = list(damping)
    if not rotating:
        frequencies.append([omega + 2.17, 0.1])
        damping.append(0.05)
    return Planted(np.array(frequencies), np.array(damping), {(0, 1): gap}, view)
