"""Stability region of Newmark's method compared with the amplification matrix and with the method itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solve import Newmark
from solve.methods.newmark import spectral_radius, stability_limit
from solve.period.grid import Grid
from solve.views.comparison import newmark_region_figure
from tests.solve.systems import chain_of, constant

gammas, betas = st.floats(0.0, 1.0), st.floats(0.0, 1.0)
OSCILLATOR = constant(np.eye(1), np.zeros((1, 1)), np.eye(1), lambda phase: np.ones((len(phase), 1)))


def printed_matrix(gamma, beta, angle):
    """Amplification matrix, Eq. (6.9), for ω = 1, so that Δt equals the angle."""
    mu2 = angle**2 / (1 + beta * angle**2)
    return np.array(
        [
            [1 - mu2 / 2, angle / (1 + beta * angle**2)],
            [-angle * (1 - gamma / 2 * mu2), 1 - gamma * mu2],
        ]
    )


def oscillation_limit(gamma, beta):
    """Largest ω Δt with complex eigenvalues, Eq. (6.11)."""
    rest = (gamma + 0.5) ** 2 - 4 * beta
    return np.inf if rest <= 0 else 2 / np.sqrt(rest)


def radius_of_a_step(gamma, beta, angle):
    step = Grid(np.array([0.0, angle, 2 * angle]), np.zeros(2, dtype=bool))
    return np.abs(np.linalg.eigvals(chain_of(Newmark(gamma, beta), OSCILLATOR, 1.0, step).A[0])).max()


@given(gammas, betas, st.floats(1e-2, 50.0))
@settings(max_examples=200, deadline=None)
def test_spectral_radius_matches_the_printed_matrix_and_the_method(gamma, beta, angle):
    computed = spectral_radius(gamma, beta, angle)
    for other in (
        np.abs(np.linalg.eigvals(printed_matrix(gamma, beta, angle))).max(),
        radius_of_a_step(gamma, beta, angle),
    ):
        assert computed == pytest.approx(other, rel=1e-5)  # a double eigenvalue splits by a root of rounding


@given(st.floats(0.5, 1.0), betas)
@settings(max_examples=100, deadline=None)
def test_step_amplifies_only_beyond_the_stability_limit(gamma, beta):
    limit = stability_limit(gamma, beta)
    top = min(limit, 1e3)
    inside = np.linspace(1e-3, 0.999 * top, 200)
    assert (spectral_radius(gamma, beta, inside) <= 1 + 1e-7).all()
    if limit < 1e3:
        assert spectral_radius(gamma, beta, 1.01 * limit) > 1 + 1e-7


@pytest.mark.parametrize("gamma", [0.0, 0.25, 0.45])
@pytest.mark.parametrize("beta", [0.0, 1 / 6, 0.25, 1.0])
def test_every_step_amplifies_if_gamma_is_below_one_half(gamma, beta):
    assert stability_limit(gamma, beta) == 0.0
    assert (spectral_radius(gamma, beta, np.geomspace(1e-2, 1.0, 20)) > 1).all()


@pytest.mark.parametrize(
    ("beta", "limit"), [(0.0, 2.0), (1 / 12, np.sqrt(6)), (1 / 6, np.sqrt(12)), (0.25, np.inf)]
)
def test_limits_of_the_named_methods(beta, limit):
    assert stability_limit(0.5, beta) == pytest.approx(limit)
    assert oscillation_limit(0.5, beta) == pytest.approx(limit)


@given(st.floats(0.5, 1.0), betas)
@settings(max_examples=100, deadline=None)
def test_eigenvalues_become_real_at_the_oscillation_limit(gamma, beta):
    """Eq. (6.11) of the thesis, where it is called the limit of stability. It is sufficient but not
    necessary."""
    limit = oscillation_limit(gamma, beta)
    assert limit <= stability_limit(gamma, beta) * (1 + 1e-12)
    if limit < 1e3 and gamma > 0.51:
        below, above = (np.linalg.eigvals(printed_matrix(gamma, beta, s * limit)) for s in (0.99, 1.01))
        assert np.abs(below.imag).max() > 0
        assert np.abs(above.imag).max() == 0


def test_oscillatory_parameters_between_both_conditions_are_unconditionally_stable():
    gamma, beta = 0.9, 0.46
    assert gamma / 2 < beta < (gamma + 0.5) ** 2 / 4
    assert stability_limit(gamma, beta) == np.inf
    assert np.isfinite(oscillation_limit(gamma, beta))
    assert spectral_radius(gamma, beta, np.geomspace(1e-2, 1e6, 200)).max() < 1


def test_figure_shows_stability_regions():
    (axes,) = newmark_region_figure().axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("γ", "β")
    texts = " ".join(text.get_text() for text in axes.texts)
    for words in ("average acceleration", "central differences", "unstable at any step", "up to the ω h"):
        assert words in texts
