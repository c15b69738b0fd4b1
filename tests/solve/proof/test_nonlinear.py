"""Proved nonlinear orbits: existence, uniqueness and stability."""

import dataclasses
from functools import cache, partial

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

pytest.importorskip("flint")

import solve
from solve.errors import LinearModelError
from solve.proof import existence as of_existence
from solve.proof import nonlinear as of_nonlinear
from solve.proof.balls import arb
from tests.solve.newton.mechanisms import duffing, model_of, stop
from tests.solve.proof.taylor import duffing_orbit

NUMBERS = {"zeta": 0.1, "k": 1.0, "alpha": 1.0, "f": 1.0}
SPEED = 1.6


@cache
def orbit():
    return solve.nonlinear(model_of(duffing(), **NUMBERS), SPEED)


@cache
def proof():
    return solve.prove(orbit())


@cache
def rounded_proof():
    return solve.prove(orbit(), rounded=True)


def harmonics(place, derivative=0):
    """Return q̄, or its derivative with respect to the phase, at phase 0 in exact arithmetic."""
    rates = (1j * np.arange(place.harmonics.shape[1])) ** derivative
    return sum(mpmath.mpf(x) for x in np.real(place.harmonics[0] * rates).tolist())


def distance(found, numbers=NUMBERS, speed=SPEED):
    """Return the distances of q and q̇ at phase 0 from the true orbit, and the true monodromy matrix."""
    place = found.orbit
    start = round(float(harmonics(place)), 4), round(speed * float(harmonics(place, 1)), 4)
    with mpmath.workdps(40):
        state, Phi = duffing_orbit(**numbers, speed=speed, start=start)
        apart = abs(state[0] - harmonics(place)), abs(state[1] - mpmath.mpf(speed) * harmonics(place, 1))
        return apart, Phi


def contained(found, Phi):
    """Whether the discs contain the eigenvalues of a matrix."""
    with mpmath.workdps(40):
        eigenvalues = mpmath.eig(Phi)[0]
        discs = [*zip(found.multipliers.tolist(), found.radii.tolist(), strict=True)]
        return all(any(abs(rho - center) <= radius for center, radius in discs) for rho in eigenvalues)


def test_true_orbit_lies_within_the_radius():
    found = proof()
    assert found.verdict == "asymptotically stable"
    apart, Phi = distance(found)
    radius, unique = found.orbit.radius["q"], found.orbit.unique["q"]
    assert apart[0] <= radius[0] < 1e-12
    assert apart[1] <= radius[1] < 1e-12
    assert contained(found, Phi)
    assert found.radii.max() < 1e-8
    assert all(inner < outer for inner, outer in zip(radius, unique, strict=True))
    assert found.true_error["orbit"] <= orbit().error_estimate.orbit
    low, high = found.statistics("q")
    assert high - low < 1e-11
    assert low - 1e-7 < orbit().statistics("q").max_abs < high + 1e-7


@pytest.mark.parametrize("moved", [1e-9, 1e-6])
def test_perturbed_polynomial_has_a_larger_radius(monkeypatch, moved):
    usual = of_nonlinear.corrected

    def disturbed(*given):
        motion = usual(*given)
        cosines = motion.cosines.copy()
        cosines[0, 3] += moved
        return dataclasses.replace(motion, cosines=cosines)

    monkeypatch.setattr(of_nonlinear, "corrected", disturbed)
    found = solve.prove(orbit())
    apart, Phi = distance(found)
    assert moved / 2 < apart[0] <= found.orbit.radius["q"][0] < 100 * moved
    assert contained(found, Phi)


def test_omission_of_the_defect_is_detected(monkeypatch):
    usual = of_existence.Linear.from_maps
    monkeypatch.setattr(
        of_existence.Linear,
        "from_maps",
        classmethod(lambda cls, *given: dataclasses.replace(usual(*given), eta=arb(0))),
    )
    found = solve.prove(orbit())
    apart, _ = distance(found)
    assert apart[0] > found.orbit.radius["q"][0]


def test_omission_of_the_linearisation_change_is_detected(monkeypatch):
    usual = of_nonlinear.existence
    monkeypatch.setattr(
        of_nonlinear, "existence", lambda *given: dataclasses.replace(usual(*given), change=arb(0))
    )
    found = solve.prove(orbit())
    _, Phi = distance(found)
    assert not contained(found, Phi)


@pytest.mark.slow
def test_coexisting_orbits_are_unique_in_disjoint_regions():
    """There are three orbits at one speed. The middle one is unstable."""
    numbers = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.5}
    system, speed, found = model_of(duffing(), **numbers), 1.8, []
    # Harmonic balance with one harmonic of amplitude a: |k − Ω² + 3αa²/4 + 2iζΩ| a = f.
    real, imaginary = np.polynomial.Polynomial([1 - speed**2, 0.75]), 0.1 * speed
    square = (real**2 + imaginary**2) * np.polynomial.Polynomial([0, 1]) - 0.5**2
    for amplitude in np.sqrt(np.sort(square.roots().real)):
        angle = -np.angle(complex(real(amplitude**2), imaginary))
        start = partial(lambda a, b, phase: a * np.cos(phase + b)[None], amplitude, angle)
        proof = solve.prove(solve.nonlinear(system, speed, start))
        apart, Phi = distance(proof, numbers, speed)
        assert apart[0] <= proof.orbit.radius["q"][0]
        assert contained(proof, Phi)
        found.append(proof)
    assert [each.verdict for each in found] == [
        "asymptotically stable",
        "unstable",
        "asymptotically stable",
    ]
    for one in found:
        for other in found:
            if one is not other:
                apart = abs(harmonics(one.orbit) - harmonics(other.orbit))
                assert apart > one.orbit.unique["q"][0]


def test_uniqueness_ends_at_a_kink_of_the_equations():
    """The second derivatives at an elastic stop are zero on both sides. A second orbit touches the stop."""
    numbers, speed = {"zeta": 0.02, "k": 1.0, "kappa": 10.0, "gap": 1.0, "f": 0.5}, 1.35
    found = solve.prove(solve.nonlinear(model_of(stop(), **numbers), speed))
    amplitude = 0.5 / abs(1 - speed**2 + 0.04j * speed)
    low, high = found.statistics("q")
    assert low <= amplitude * (1 + 1e-14)
    assert high >= amplitude * (1 - 1e-14)

    def rates(t, y):
        return y[1], 0.5 * np.cos(speed * t) - 0.04 * y[1] - y[0] - 10 * max(0.0, y[0] - 1)

    period = 2 * np.pi / speed
    settled = solve_ivp(rates, (0, 200 * period), [1.3, 0.0], rtol=1e-8, max_step=period / 50)
    other = settled.y[0][settled.t > 199 * period]
    assert other.max() > 2
    # The deviation of the other orbit at its highest point is at least the difference of the maxima.
    assert 1e-3 < found.orbit.unique["q"][0] < other.max() - amplitude
    assert found.orbit.unique["q"][0] <= 1 - amplitude


def test_orbit_of_equations_with_jumps_is_refused():
    with pytest.raises(LinearModelError, match="without jumps or kinks"):
        solve.prove(solve.nonlinear(solve.load("meissner"), 1.0))


def test_proof_covers_rounding_of_parameters():
    """The neighbouring system differs by two units in the last place in the damping and the speed, the only
    numbers that are rounded."""
    found = rounded_proof()
    assert found.verdict == "asymptotically stable"
    assert "within two units in the last place" in found.assumed
    neighbour = NUMBERS | {"zeta": NUMBERS["zeta"] - 2 * np.spacing(NUMBERS["zeta"])}
    place = found.orbit
    start = round(float(harmonics(place)), 4), round(SPEED * float(harmonics(place, 1)), 4)
    with mpmath.workdps(40):
        speed = SPEED + 2 * np.spacing(SPEED)
        state, Phi = duffing_orbit(**neighbour, speed=speed, start=start, digits=16)
        assert abs(state[0] - harmonics(place)) <= place.radius["q"][0] < 1e-6
        assert contained(found, Phi)
    assert found.orbit.radius["q"][0] > proof().orbit.radius["q"][0]


def test_multipliers_over_two_periods_are_squares():
    twice = solve.prove(solve.nonlinear(orbit().system.model, SPEED, start=orbit(), periods=2))
    low, high = (float(bound) ** 2 for bound in proof().spectral_radius)
    assert float(twice.spectral_radius[0]) <= high
    assert float(twice.spectral_radius[1]) >= low


@pytest.mark.slow
def test_all_orbits_of_a_branch_through_folds_are_proved():
    system = model_of(duffing(), zeta=0.05, k=1.0, alpha=1.0, f=0.5)
    branch = solve.branch(system, (1.2, 2.4), rtol=1e-4)
    assert len(branch.turning) == 2
    # The orbits at the turning points are not isolated. Between them the orbits are unstable.
    first, last = np.flatnonzero(branch.turns)
    for point in (~branch.turns).nonzero()[0].tolist():
        orbit = solve.nonlinear(system, branch.speeds[point], start=branch.curve(point))
        found = solve.prove(orbit)
        low, high = found.statistics("q")
        assert low * (1 - 1e-3) < branch.peaks[point, 0] < high * (1 + 1e-3)
        assert found.proved
        assert (found.verdict == "unstable") == (first < point < last)


def test_orbit_of_a_linear_system_is_unique_everywhere():
    """Without curvature, the orbit of the residual is that of the linear equations."""
    numbers = {"zeta": 0.1, "k": 2.0, "alpha": 0.0, "f": 1.0}
    found = solve.prove(solve.nonlinear(model_of(duffing(), **numbers), 1.0))
    amplitude = 1 / abs(1 + 0.2j)
    low, high = found.statistics("q")
    assert low - 1e-15 <= amplitude <= high + 1e-15
    assert found.orbit.unique["q"][0] > 1e6


@pytest.mark.parametrize("ending", [".nc", ".npz"])
def test_proof_is_saved_and_reopened(tmp_path, ending):
    path = tmp_path / f"proof{ending}"
    proof().save(path)
    opened = solve.open(path)
    assert isinstance(opened, solve.Proof)
    assert opened.record == proof().record
    assert np.array_equal(opened.orbit.harmonics, proof().orbit.harmonics)
    assert np.array_equal(opened.result.q, orbit().q)
