"""Fourier series analysis of B. Bahgat and K. D. Willmert (Mech. Mach. Theory 11 (1976) 47-71), as described
in section 6.4 of the thesis. The method is included for comparison; its error is large."""

from dataclasses import dataclass

import numpy as np

from solve.arrays import Array
from solve.errors import ResonanceError
from solve.methods.fourier import Fourier
from solve.period.points import Points, matrices


@dataclass(frozen=True)
class BahgatWillmert(Fourier):
    """Sum of the responses to the harmonics of the load. At each phase, the responses are computed as if the
    matrices were constant: q(φ) = Re Σ_k [K + iω_k C - ω_k² M]⁻¹ d_k exp(iω_k φ)."""

    name = "bahgat-willmert"
    order = 0
    curve_order = 0
    converges = False
    spectral = False
    first_order = False

    def collocated(self, point: Points, phases: Array) -> tuple[Array, float]:
        m = len(phases)
        M, C, K, d = (part[0] for part in matrices(point, phases))
        load = 2.0 * np.fft.rfft(d, axis=0) / m
        load[0] /= 2.0
        q = np.zeros((m, point.n))
        for k, component in enumerate(load):
            rate = 2j * np.pi / point.period * k
            driven = component * np.exp(rate * phases)[:, None]
            try:
                q += np.real(np.linalg.solve(K + rate * C + rate**2 * M, driven[..., None])[..., 0])
            except np.linalg.LinAlgError:
                raise ResonanceError(
                    f"harmonic {k} of the load equals an undamped natural frequency at some fixed "
                    "phase; change the speed, add damping, or use radau"
                ) from None
        return q, np.nan
