"""Bounds on the extrema of outputs, compared with closed forms."""

import pytest

pytest.importorskip("flint")

import solve
from derive import Mechanism, cos, rate
from solve.proof import outputs as of_outputs
from solve.proof.prove import prove


def oscillator():
    """Return 3.9 q + 0.02 q̇ + q̈ = cos 2φ with the outputs q̈ and q q̇."""
    made = Mechanism("oscillator", "One mass")
    (q,) = made.coordinates(q=("m", "deflection"))
    c, k, m, F = made.parameters(
        c=("N s/m", "damping"), k=("N/m", "stiffness"), m=("kg", "mass"), F=("N", "load")
    )
    made.kinetic, made.dissipation = m * rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * q**2 / 2
    made.force(F * cos(2 * made.phase), along=q)
    made.output("inertia", m * rate(rate(q)), "N", "inertia force")
    made.output("power", k * q * rate(q), "W", "power of the spring")
    return solve.load(made, c=0.02, k=3.9, m=1.0, F=1.0)


AMPLITUDE = 1 / abs(3.9 - 4 + 0.04j)
EXACT = {"inertia": 4 * AMPLITUDE, "power": 3.9 * AMPLITUDE**2}


def test_output_bounds_contain_the_closed_form():
    found = prove(oscillator(), 1.0)
    for name, exact in EXACT.items():
        low, high = found.statistics(name)
        assert low <= exact * (1 + 1e-14)
        assert high >= exact * (1 - 1e-14)
        assert high - low < 2e-3 * exact


def test_omission_of_the_variation_within_intervals_is_detected(monkeypatch):
    def at_the_middle(polynomial, start, end):
        middle, (coefficients, _) = (start + end) / 2, polynomial
        return sum(c * middle**k for k, c in enumerate(coefficients))

    monkeypatch.setattr(of_outputs, "_range", at_the_middle)
    found = prove(oscillator(), 1.0)
    assert any(found.statistics(name)[1] < exact for name, exact in EXACT.items())
