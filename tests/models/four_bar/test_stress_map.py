"""Stress map compared with single solutions, also between its lengths and with other options."""

import numpy as np
import pytest

import solve
from models.four_bar.stress_map import StressMap, stress_rows

SPEEDS = np.array([11.0, 24.5, 26.1, 30.4, 33.0])
LENGTHS = np.array([0.5351, 0.58, 0.6273])


def worst(model, speed, L4, places):
    """Largest |stress| per link at the given fractions of its length, among 20 000 crank angles."""
    orbit = solve.periodic(model.varied({"L4": float(L4)}), float(speed), rtol=1e-7)
    phase = np.linspace(0, 2 * np.pi, 20_000)
    q, *_ = orbit.state(phase)
    system = orbit.system
    return [
        max(
            np.abs(system.stress(link, float(fraction), side, phase, q)).max()
            for fraction in fractions
            for side in ("plus", "minus")
        )
        for link, fractions in places
    ]


@pytest.mark.parametrize(
    "options",
    [
        {},
        pytest.param({"terms": "full", "stiffening": "on"}, marks=pytest.mark.slow),
        pytest.param({"elements": "1,2,1"}, marks=pytest.mark.slow),
    ],
)
def test_stress_map_matches_single_solutions(options):
    model = solve.load("four_bar", options=options)
    stress_map = StressMap(model, 0.53, 0.63)
    peaks = stress_map.peaks(SPEEDS, LENGTHS)
    assert peaks.stress.shape == (5, 3, 3)
    assert peaks.error.max() < 5e-3
    for point, speed in ((1, 24.5), (3, 30.4)):
        for place, L4 in enumerate(LENGTHS):
            single = worst(model, speed, L4, zip(stress_map.links, stress_map.positions, strict=True))
            assert peaks.stress[point, place] == pytest.approx(single, rel=3e-3)


def test_stress_map_weights_are_bitwise_reproducible():
    """SciPy's interpolator processes its nodes in random sequence unless a sequence is given."""
    stress_map = StressMap(solve.load("four_bar"), 0.53, 0.63)
    first, *others = (stress_map.weights(LENGTHS) for _ in range(20))
    assert all(np.array_equal(first, other) for other in others)


def test_map_error_bounds_the_change_by_refinement():
    model = solve.load("four_bar")
    coarse, fine = (StressMap(model, 0.52, 0.63, count).peaks(SPEEDS, LENGTHS) for count in (5, 9))
    change = np.abs(coarse.stress / fine.stress - 1).max(axis=(1, 2))
    assert (change <= coarse.error + fine.error).all()
    assert (fine.error < coarse.error).all()


def test_growth_bounds_the_spectral_radius():
    model = solve.load("four_bar")
    bound = StressMap(model, 0.547, 0.547, 1).peaks(SPEEDS, np.array([0.547])).radius_bound[:, 0]
    true = np.array([solve.floquet(model, float(speed)).spectral_radius for speed in SPEEDS])
    assert (bound >= true * (1 - 1e-6)).all()
    assert bound == pytest.approx(true, rel=0.2)


def test_rows_give_the_stresses_of_the_model():
    model = solve.load("four_bar", options={"elements": 2})
    stress_map = StressMap(model, 0.547, 0.547, 1)
    phase = np.array([0.3, 2.0])
    q = np.random.default_rng(1).standard_normal((model.n, 2))
    rows = stress_rows(model.beams, model.beams.angle(phase))
    axial, bending = np.einsum("kasn,nk->ask", rows, q)
    at = 0
    for link, fractions in zip(stress_map.links, stress_map.positions, strict=True):
        for fraction in fractions:
            for side, sign in (("plus", 1), ("minus", -1)):
                expected = model.stress(link, float(fraction), side, phase, q)
                assert axial[at] + sign * bending[at] == pytest.approx(expected, rel=1e-9)
            at += 1
    assert at == axial.shape[0]
