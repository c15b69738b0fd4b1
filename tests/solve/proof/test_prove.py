"""Proofs compared with independent references: closed forms, mpmath, and the same proof with more digits."""

import dataclasses
import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

pytest.importorskip("flint")

import solve
from derive import Mechanism, cos, exp, rate, sin
from solve.errors import LinearModelError, MissingValueError, StepsError, ValueOutOfBoundsError
from solve.proof import step as of_step
from solve.proof.balls import arb, precision
from solve.proof.enclosure import _enclosed, equation_of, period_of
from solve.proof.prove import prove
from solve.proof.turn import Marching, turn
from tests.solve.proof.fixed_point import BITS, monodromy, multipliers, trigonometric


def mathieu(**parameters):
    return solve.load("mathieu", **parameters)


def exact_trace(delta, epsilon, zeta, terms=60, steps=16):
    """Return the trace of the monodromy matrix of Mathieu's equation from Taylor series with 40 digits."""
    with mpmath.workdps(40):
        c, h = 2 * mpmath.mpf(zeta) * mpmath.sqrt(mpmath.mpmathify(delta)), mpmath.pi / steps
        product = mpmath.eye(2)
        for step in range(steps):
            stiffness = [
                epsilon
                * mpmath.cos(2 * step * h + k * mpmath.pi / 2)
                * mpmath.mpf(2) ** k
                / mpmath.factorial(k)
                for k in range(terms)
            ]
            stiffness[0] += delta
            columns = []
            for start in ((1, 0), (0, 1)):
                y = list(map(mpmath.mpf, start))
                for k in range(terms - 2):
                    force = (
                        mpmath.fsum(stiffness[j] * y[k - j] for j in range(k + 1)) + c * (k + 1) * y[k + 1]
                    )
                    y.append(-force / ((k + 1) * (k + 2)))
                value = mpmath.fsum(term * h**k for k, term in enumerate(y))
                slope = mpmath.fsum(k * term * h ** (k - 1) for k, term in enumerate(y) if k)
                columns.append((value, slope))
            product = mpmath.matrix(columns).T * product
        return product[0, 0] + product[1, 1]


@pytest.mark.parametrize(
    ("delta", "epsilon", "zeta", "message"),
    [
        (1.0, 1.0, 0.0, "unstable"),
        (2.0, 1.0, 0.0, "stable"),
        (1.3, 0.4, 0.03, "asymptotically stable"),
        (0.9, 1.5, 0.02, "unstable"),
    ],
)
def test_trace_of_mathieus_equation_matches_mpmath(delta, epsilon, zeta, message):
    proof = prove(mathieu(delta=delta, epsilon=epsilon, zeta=zeta), 1.0, digits=25)
    assert proof.verdict == message
    trace = exact_trace(delta, epsilon, zeta)
    with precision(300):
        Phi = _enclosed(
            proof.result.system, equation_of(proof.result.system, 1.0, False), Marching(120, 24.0), False
        ).Phi
        enclosure, exact = Phi[0, 0] + Phi[1, 1], arb(mpmath.nstr(trace, 38))
        assert abs(enclosure - exact) < 1e-30
    low, high = proof.spectral_radius
    with mpmath.workdps(40):
        damping = 2 * mpmath.mpf(zeta) * mpmath.sqrt(mpmath.mpf(delta))
        radius = max(map(abs, mpmath.polyroots([1, -trace, mpmath.exp(-damping * mpmath.pi)])))
        assert mpmath.mpf(low) - mpmath.mpf(10) ** -32 <= radius <= mpmath.mpf(high) + mpmath.mpf(10) ** -32
        assert mpmath.mpf(high) - mpmath.mpf(low) < mpmath.mpf(10) ** -23


@pytest.mark.parametrize("stiffness", [1e16, 1e25])
def test_error_states_that_modes_are_too_fast(stiffness):
    # ω = √δ, over the period π.
    with pytest.raises(
        StepsError, match=r"the fastest mode advances by .* rad in a period; allowed"
    ) as caught:
        solve.prove(solve.load("mathieu", delta=stiffness, epsilon=0.1, zeta=0.01), 1.0)
    stated = float(str(caught.value).split("advances by ")[1].split()[0])
    assert 0.5 < stated / (np.pi * np.sqrt(stiffness)) < 2


def test_enclosures_with_more_digits_lie_within_those_with_fewer():
    system = mathieu(delta=3.3, epsilon=2.2, zeta=0.01)
    coarse, fine = (prove(system, 1.0, digits=digits).spectral_radius for digits in (8, 40))
    assert float(coarse[0]) <= float(fine[0]) <= float(fine[1]) <= float(coarse[1])
    with mpmath.workdps(60):
        widths = [mpmath.mpf(high) - mpmath.mpf(low) for low, high in (coarse, fine)]
        assert widths[1] < 1e-25 * widths[0]


def test_proof_with_jumps_contains_the_closed_form():
    """For Meissner's equation, the monodromy matrix is a product of two rotations."""
    proof = prove(solve.load("meissner"), 1.0)
    assert proof.verdict == "stable"
    product = np.eye(2)
    given = proof.result.system.labels.parameters
    assert given["share"] == 0.5
    for w in (given["w1"], given["w2"]):
        a, b = math.cos(w * math.pi), math.sin(w * math.pi)
        product = np.array([[a, b / w], [-w * b, a]]) @ product
    assert sum(proof.multipliers).real == pytest.approx(np.trace(product), abs=1e-12)


def test_undeclared_jump_is_refused():
    system = solve.load("meissner")
    with (
        precision(200),
        pytest.raises(StepsError, match=r"beyond phase 3\.1415.*declare the jump as a break"),
    ):
        turn(equation_of(system, 1.0, False), period_of(system), (), Marching(100, 24.0))


@pytest.fixture(scope="module")
def proof_of_the_manipulator():
    return prove(solve.load("manipulator"), "50 rpm")


def test_numerical_result_agrees_with_the_proof_within_its_estimate(proof_of_the_manipulator):
    proof = proof_of_the_manipulator
    estimate = proof.result.error_estimate
    assert proof.verdict == proof.result.verdict == "asymptotically stable"
    assert not proof.contradicted
    assert proof.true_error["multipliers"] <= estimate.multipliers
    assert proof.true_error["orbit"] <= estimate.orbit
    for name in proof.result.coordinates:
        low, high = proof.statistics(name)
        assert high - low < 1e-9 * high
        assert proof.result.statistics(name).max_abs == pytest.approx(low, rel=2 * estimate.orbit + 1e-11)


def test_output_bounds_of_the_manipulator_contain_the_numerical_values(proof_of_the_manipulator):
    ordinary = proof_of_the_manipulator.result
    for name in ordinary.system.outputs:
        low, high = proof_of_the_manipulator.statistics(name)
        assert low * (1 - 1e-6) <= ordinary.statistics(name).max_abs <= high
        assert math.isfinite(high)


@pytest.mark.parametrize("left_out", ["truncated coefficients", "defect"])
def test_omission_of_a_remainder_is_detected(monkeypatch, left_out):
    """Without a remainder, the enclosure is too narrow to contain the known solution. A test that passes with
    remainders and fails without them detects their absence."""
    system = mathieu(delta=1.0, epsilon=1.0, zeta=0.0)
    truth = prove(system, 1.0, digits=40)
    whole = of_step._polynomial

    def coarse(n, W, h, m, r, aim):
        terms, defect = (
            whole(n, W, h, m[:6], r[:6], aim) if left_out != "defect" else whole(n, W, h, m, r, 1e-3)
        )
        return terms, defect if left_out != "defect" else 0 * defect

    monkeypatch.setattr(of_step, "_polynomial", coarse)
    proof = prove(system, 1.0, digits=20)
    with mpmath.workdps(60):
        low, high = map(mpmath.mpf, proof.spectral_radius)
        assert not low <= mpmath.mpf(truth.spectral_radius[0]) <= high


def test_rounded_parameters_widen_the_enclosures():
    system = mathieu(delta=1.3, epsilon=0.4, zeta=0.03)
    exact, rounded = prove(system, 1.0), prove(system, 1.0, rounded=True)
    assert rounded.verdict == "asymptotically stable"
    assert float(rounded.spectral_radius[0]) < float(exact.spectral_radius[0])
    assert float(rounded.spectral_radius[1]) > float(exact.spectral_radius[1])
    assert rounded.radii.max() < 1e-6
    assert "within two units in the last place" in rounded.assumed


def test_result_is_proved_at_its_speed():
    orbit = solve.periodic(mathieu(delta=1.3, epsilon=0.4, zeta=0.03), 1.0)
    assert prove(orbit).result is orbit
    with pytest.raises(ValueOutOfBoundsError, match="omit the speed"):
        prove(orbit, 1.0)
    with pytest.raises(MissingValueError, match="no speed given"):
        prove(orbit.system)


def test_stability_boundary_remains_unproved():
    """Without stiffness, a mass drifts: the multiplier +1 is double."""
    proof = prove(mathieu(delta=0.0, epsilon=0.0, zeta=0.0), 1.0, orbit=False)
    assert proof.verdict == "undetermined"
    assert not proof.proved
    assert any("meet the unit circle" in text for text in proof.warnings)


def test_proof_covers_all_phases_of_a_period():
    """A window ends where the next step starts, even if the sum of steps is rounded: the break then lies
    below 1."""
    system = solve.load("meissner", share=0.15915494309189532)
    (at,) = [each for each in system.breaks if each]
    assert at < 1 < at + 1e-15
    with precision(300):
        computed = turn(equation_of(system, 1.0, False), period_of(system), system.breaks, Marching(60, 24.0))
        for start, length, following in zip(
            computed.starts, computed.lengths, computed.starts[1:], strict=False
        ):
            assert start + length == following
        assert (computed.starts[-1] + computed.lengths[-1]).overlaps(computed.period)


def test_bounds_of_an_orbit_hold_to_all_digits():
    """The amplitudes of two masses with constant coefficients follow from a complex linear system solved with
    50 digits."""
    rng = np.random.default_rng(7)
    made = Mechanism("pair", "Two masses")
    q1, q2 = made.coordinates(q1=("m", "first"), q2=("m", "second"))
    m, c, k1, k2, F = made.parameters(
        m=("kg", "mass"), c=("N s/m", "damping"), k1=("N/m", "spring"), k2=("N/m", "spring"), F=("N", "load")
    )
    made.kinetic = m * (rate(q1) ** 2 + rate(q2) ** 2) / 2
    made.potential = (k1 * q1**2 + k2 * (q2 - q1) ** 2) / 2
    made.dissipation = c * (rate(q1) ** 2 + rate(q2) ** 2) / 2
    made.force(F * cos(made.phase), along=q2)
    for _ in range(3):
        values = dict(zip(("m", "c", "k1", "k2", "F"), rng.uniform(0.5, 2, 5).tolist(), strict=True))
        proof = prove(solve.load(made, **values), 1.0, digits=6)
        with mpmath.workdps(50):
            m_, c_, a, b, F_ = (mpmath.mpf(values[name]) for name in ("m", "c", "k1", "k2", "F"))
            diagonal = 1j * c_ - m_
            amplitude = mpmath.lu_solve(
                mpmath.matrix([[a + b + diagonal, -b], [-b, b + diagonal]]), mpmath.matrix([0, F_])
            )
            for name, exact in zip(("q1", "q2"), map(abs, amplitude), strict=True):
                low, high = proof.statistics(name)
                assert mpmath.mpf(low) <= exact <= mpmath.mpf(high)
                assert high - low < 1e-10 * high


@pytest.mark.parametrize(
    ("ordinary", "proved", "low", "contradicted"),
    [
        ("stable", "asymptotically stable", "0.99999999999", False),
        ("unstable", "asymptotically stable", "0.9", True),
        ("asymptotically stable", "unstable", "1.0000001", True),
        ("stable", "unstable", "1.0000000001", False),
        ("stable", "unstable", "1.001", True),
        ("undetermined", "unstable", "1.5", False),
        ("unstable", "undetermined", "0.9", False),
    ],
)
def test_contradictory_verdicts_are_detected(ordinary, proved, low, contradicted):
    proof = prove(mathieu(delta=1.3, epsilon=0.4, zeta=0.03), 1.0, orbit=False)
    made = dataclasses.replace(
        proof, verdict=proved, spectral_radius=(low, low), result=SimpleNamespace(verdict=ordinary)
    )
    assert made.contradicted is contradicted


def test_step_beyond_a_singular_inertia_is_rejected():
    """The series diverges if a step is longer than the distance to a complex zero of M."""
    made = Mechanism("swing", "A mass that nearly vanishes")
    (q,) = made.coordinates(q=("m", "deflection"))
    m, e, c, k = made.parameters(
        m=("kg", "mass"), e=("1", "share"), c=("N s/m", "damping"), k=("N/m", "spring")
    )
    made.kinetic = m * (e + cos(made.phase)) * rate(q) ** 2 / 2
    made.potential, made.dissipation = k * q**2 / 2, c * rate(q) ** 2 / 2
    proof = prove(solve.load(made, m=1.0, e=1.0017, c=1e-3, k=1e-3), 1.0, digits=3, orbit=False)
    assert proof.result.verdict == proof.verdict


def test_unsupported_proofs_are_refused():
    filtered = solve.FirstOrderSystem(
        lambda phase, speed: (np.full((len(phase), 1, 1), -2.0), np.cos(phase)[:, None]), ["x"]
    )
    with pytest.raises(LinearModelError, match="first-order systems do not have them"):
        prove(filtered, 1.0)
    with pytest.raises(LinearModelError, match="structures, models with modal damping"):
        prove(solve.load("four_bar"), "30 rad/s")
    with pytest.raises(ValueOutOfBoundsError, match="digits is 0; allowed: 1 to 1000"):
        prove(mathieu(), 1.0, digits=0)


def oscillator(stiffness, load=cos):
    """Return q̈ + 0.02 q̇ + stiffness(φ) q = load(φ)."""
    made = Mechanism("oscillator", "One mass")
    (q,) = made.coordinates(q=("m", "deflection"))
    c, k, m, F = made.parameters(
        c=("N s/m", "damping"), k=("N/m", "stiffness"), m=("kg", "mass"), F=("N", "load")
    )
    made.kinetic = m * rate(q) ** 2 / 2
    made.potential = k * stiffness(made.phase) * q**2 / 2
    made.dissipation = c * rate(q) ** 2 / 2
    made.force(F * load(made.phase), along=q)
    return solve.load(made, c=0.02, k=1.0, m=1.0, F=1.0)


def test_response_with_constant_coefficients_matches_the_closed_form():
    proof = prove(oscillator(lambda phase: 3.9, lambda phase: cos(2 * phase)), 1.0)
    low, high = proof.statistics("q")
    response = 1 / abs(3.9 - 4 + 0.04j)
    assert low <= response * (1 + 1e-15)
    assert high >= response * (1 - 1e-15)
    assert high - low < 1e-9 * response
    assert proof.true_error["orbit"] <= proof.result.error_estimate.orbit


@pytest.mark.parametrize("place", [0.7, 2.9, 5.1])
def test_proof_detects_a_very_short_stiffness_pulse(place):
    """The impulse alone makes the motion unstable. The limit of zero length is a product of two maps."""
    width = 2 * math.pi / 5000
    strength = 4.0
    peak = strength / (width * math.sqrt(2 * math.pi))
    system = oscillator(lambda phase: 3.9 + peak * exp(-2 * (sin((phase - place) / 2) / width) ** 2))
    proof = prove(system, 1.0, orbit=False)
    w = math.sqrt(3.9 - 0.01**2)
    T, decay = 2 * math.pi, math.exp(-0.01 * 2 * math.pi)
    smooth = decay * np.array(
        [
            [math.cos(w * T) + 0.01 / w * math.sin(w * T), math.sin(w * T) / w],
            [-3.9 / w * math.sin(w * T), math.cos(w * T) - 0.01 / w * math.sin(w * T)],
        ]
    )
    limit = max(abs(np.linalg.eigvals(smooth @ [[1.0, 0.0], [-strength, 1.0]])))
    assert limit > 1.1
    assert proof.verdict == "unstable"
    assert float(proof.spectral_radius[0]) == pytest.approx(limit, rel=0.02)


def test_proof_decides_a_tongue_undetermined_in_double_precision():
    """The example of docs/believe.md is compared with an integration in fixed-point arithmetic."""
    system = mathieu(delta=0.470654354933842, epsilon=1.0, zeta=0.0)
    found = prove(system, 1.0, orbit=False)
    assert (found.result.verdict, found.verdict) == ("undetermined", "unstable")
    one, zero = np.eye(1), np.zeros((1, 1))
    with mpmath.workprec(BITS):
        nodes = [mpmath.pi * k / 24 for k in range(25)]
        stiffness = trigonometric([(0, 0.470654354933842 * one, zero), (2, one, zero)])
        Phi = monodromy(trigonometric([(0, one, zero)]), trigonometric([(0, zero, zero)]), stiffness, nodes)
        radius = max(abs(rho) for rho in multipliers(Phi))
        low, high = map(mpmath.mpf, found.spectral_radius)
        assert (
            mpmath.mpf("1.0000000961614710115") < low <= radius <= high < mpmath.mpf("1.0000000961614710116")
        )
