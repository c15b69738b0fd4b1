"""Eigenvalues of products of matrices, compared with prescribed spectra, exact arithmetic and closed
forms."""

import mpmath
import numpy as np
import pytest
from scipy.linalg import block_diag, expm
from scipy.optimize import linear_sum_assignment

import solve
from solve.period.blocks import balanced_blocks
from solve.period.grid import Grid
from solve.period.product_eigenvalues import product_eigenvalues
from tests.solve.systems import chain_of, constant, system


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def orthogonal(rng, N):
    return np.linalg.qr(rng.standard_normal((N, N)))[0]


def bases(rng, N, m, condition):
    """Matrices (m, N, N) with the given condition number."""
    scales = condition ** np.linspace(-0.5, 0.5, N)
    return np.array(
        [orthogonal(rng, N) @ np.diag(rng.permutation(scales)) @ orthogonal(rng, N) for _ in range(m)]
    )


def transformed(S, cores):
    """Factors S_{k+1} D_k S_k⁻¹, whose product is similar to the product of the cores D_k."""
    return np.roll(S, -1, axis=0) @ cores @ np.linalg.inv(S)


def chain(rng, N, m, logarithms, angles, unevenness, condition):
    """Factors (m, N, N) of a product with eigenvalues exp(logarithms) (N,). The first pairs have equal moduli
    and the arguments ± angles. Each eigenvalue grows unevenly along the chain."""
    steps = unevenness * rng.standard_normal((m, N)) / np.sqrt(m)
    steps += (logarithms - steps.sum(axis=0)) / m
    pairs = len(angles)
    steps[:, 1 : 2 * pairs : 2] = steps[:, 0 : 2 * pairs : 2]
    cores = np.array([np.diag(row) for row in np.exp(steps)])
    for p, angle in enumerate(angles):
        two = slice(2 * p, 2 * p + 2)
        cores[:, two, two] = cores[:, two, two] @ rotation(angle / m)
    return transformed(bases(rng, N, m, condition), cores)


def spectrum(logarithms, angles):
    exact = logarithms.astype(complex)
    for p, angle in enumerate(angles):
        exact[2 * p : 2 * p + 2] = logarithms[2 * p] + 1j * np.array([angle, -angle])
    return exact


def exact_logarithms(factors):
    """log ρ of the product of the factors (m, N, N), computed with 320 digits."""
    with mpmath.workdps(320):
        product = mpmath.eye(factors.shape[-1])
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        return np.array(
            [complex(mpmath.log(value)) for value in mpmath.eig(product, left=False, right=False)]
        )


def differences(computed, exact):
    """|log ρ - log ρ*| (N,) of each computed logarithm and its match, modulo 2πi. The difference of a
    computed ρ = 0 is very large."""
    apart = computed[:, None] - exact
    apart.imag = (apart.imag + np.pi) % (2 * np.pi) - np.pi
    distance = np.minimum(np.abs(apart), 1e9)
    rows, columns = linear_sum_assignment(distance)
    return distance[rows, columns]


def step_maps(given, steps, period=2 * np.pi):
    return chain_of(solve.Radau(order=9), given, 1.0, Grid.uniform(steps, period)).A


def one(factors, **settings):
    """Logarithms (N,) and errors (N,) for a single product."""
    eigenvalues = product_eigenvalues(np.asarray(factors, dtype=float)[None], **settings)
    return eigenvalues.logarithms[0], eigenvalues.errors[0]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("m", [1, 7, 60, 1000])
def test_prescribed_spectra_are_found_down_to_1e_minus_300(m, seed):
    rng = np.random.default_rng([m, seed])
    N = int(rng.integers(2, 7))
    decades = min(300, 3 * m)
    logarithms = -np.log(10) * decades * rng.random(N)
    logarithms[-1] = -np.log(10) * decades
    angles = rng.uniform(0.1, 3.0, rng.integers(0, (N - 1) // 2 + 1))
    exact = spectrum(logarithms, angles)
    exact[1 : 2 * len(angles) : 2].real = exact[0 : 2 * len(angles) : 2].real
    computed, errors = one(chain(rng, N, m, logarithms, angles, 1.0, 10.0))
    assert (differences(computed, exact) <= 1e-9 * np.maximum(1, np.abs(computed))).all()
    assert (np.diff(computed.real) <= 0).all()
    assert (errors < 1e-6).all()


KINDS = ["apart", "wide", "like modulus", "close", "uneven", "defective"]


def member(rng, kind):
    """Factors of one product in the population."""
    N, m = int(rng.integers(2, 5)), int(np.exp(rng.uniform(0, np.log(40))))
    logarithms = rng.uniform(-5, 5, N)
    if kind in ("wide", "uneven", "defective"):
        logarithms = rng.uniform(-600, 0, N)
    if kind == "like modulus":
        logarithms[:] = logarithms[0]
    if kind == "close":
        logarithms = logarithms[0] + rng.uniform(-1, 1, N) * 10.0 ** rng.uniform(-8, 0)
    unevenness = rng.uniform(5, 20) if kind == "uneven" else 1.0
    angles = rng.uniform(0, np.pi, rng.integers(0, N // 2 + 1) * (kind != "defective"))
    factors = chain(rng, N, m, logarithms, angles, unevenness, 10 ** rng.uniform(0, 2))
    if kind == "defective":
        S = bases(rng, N, m, 10 ** rng.uniform(0, 1))
        core = np.diag(np.exp(rng.uniform(-1, 1, N)))
        core[0, 0], core[0, 1] = core[1, 1], rng.standard_normal()
        factors = transformed(S, np.broadcast_to(core, S.shape))
    return factors


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_at_most_ten_times_their_estimates(kind):
    rng = np.random.default_rng([KINDS.index(kind), 5])
    true, estimated = [], []
    for _ in range(55):
        factors = member(rng, kind)
        exact, formed = exact_logarithms(factors), balanced_blocks(factors[None])
        for computed, errors in one(factors), one(formed.factors[0], rounding=formed.rounding):
            true.append(np.minimum(differences(computed, exact), 1.0))
            estimated.append(errors)
    true, estimated = np.concatenate(true), np.concatenate(estimated)
    assert (true <= 10 * estimated).mean() >= 0.99
    assert np.isfinite(estimated).mean() >= 0.5


def test_exponents_zero_and_minus_24():
    def matrices(phase, speed):
        M, C, K = np.ones_like(phase), 24 + 10 * np.sin(phase), 10 * np.cos(phase)
        return *(A[:, None, None] for A in (M, C, K)), np.zeros((len(phase), 1))

    formed = balanced_blocks(step_maps(system(matrices, 1), 800)[None])
    computed, errors = one(formed.factors[0], rounding=formed.rounding)
    assert computed / (2 * np.pi) == pytest.approx([0.0, -24.0], abs=1e-10)
    assert (errors < 1e-10).all()


def test_scaling_does_not_hide_instability():
    given = constant(
        np.eye(2),
        np.diag([-0.2, 0.1]),
        np.array([[4.3, 1e18], [0.0, 9.7]]),
        lambda phase: np.zeros((len(phase), 2)),
    )
    formed = balanced_blocks(step_maps(given, 200)[None])
    assert (np.frexp(formed.units)[0] == 0.5).all()
    computed, errors = one(formed.factors[0], rounding=formed.rounding)
    assert computed.real / (2 * np.pi) == pytest.approx([0.1, 0.1, -0.05, -0.05], abs=1e-10)
    assert (errors < 1e-10).all()


@pytest.mark.parametrize("seed", range(4))
def test_logarithms_sum_to_the_log_determinants(seed):
    rng = np.random.default_rng(seed)
    factors = rng.standard_normal((200, 5, 5))
    sign, logarithm = (part.sum() if k else part.prod() for k, part in enumerate(np.linalg.slogdet(factors)))
    computed, _ = one(factors)
    assert computed.sum().real == pytest.approx(logarithm, rel=1e-12)
    assert np.exp(1j * computed.imag.sum()) == pytest.approx(sign)


@pytest.mark.parametrize("damping", [0.1, 1.0, 5.0])
def test_splits_into_1_to_1000_blocks_agree(damping):
    rng = np.random.default_rng(1)
    M, C, K, V = (rng.standard_normal((2, 2)) for _ in range(4))
    M, C, K, V = M @ M.T + np.eye(2), damping * C @ C.T, K @ K.T + np.eye(2), V + V.T

    def matrices(phase, speed):
        varying = K + np.cos(phase)[:, None, None] * V
        return *(np.broadcast_to(A, varying.shape) for A in (M, C)), varying, np.zeros((len(phase), 2))

    A = step_maps(system(matrices, 2), 1000)
    finest, errors = one(A)
    assert finest.sum().real == pytest.approx(-2 * np.pi * np.trace(np.linalg.solve(M, C)), rel=1e-11)
    assert (errors < 1e-11).all()
    formed = balanced_blocks(A[None])
    split = [one(formed.factors[0], rounding=formed.rounding)]
    for blocks in (1, 2, 10, 100):
        groups = A.reshape(blocks, -1, 4, 4)
        product = groups[:, 0]
        for k in range(1, groups.shape[1]):
            product = groups[:, k] @ product
        split.append(one(product))
    for logarithms, errors in split:
        allowed = errors < 1e-11
        assert allowed[:2].all()
        assert np.abs(logarithms - finest)[allowed].max() <= 1e-10
    for _, errors in (split[0], *split[3:]):
        assert (errors < 1e-11).all()


def test_undamped_multipliers_lie_on_the_circle():
    rng = np.random.default_rng(0)
    S, angles = bases(rng, 6, 50, 30.0), rng.uniform(0, 0.06, (3, 50))
    cores = np.array([block_diag(*(rotation(angle) for angle in step)) for step in angles.T])
    computed, errors = one(transformed(S, cores))
    turn = np.sort(angles.sum(axis=1))
    assert np.abs(computed.real).max() < 1e-11
    assert np.sort(computed.imag) == pytest.approx(np.concatenate((-turn[::-1], turn)), abs=1e-11)
    assert (errors < 1e-9).all()


@pytest.mark.parametrize(
    "values", [[1, -1, 1, -1, 0.5, 2], [3, 1 / 3, 1, -1, 0.5, 2], [2, 2, 2, -2, -2, -2], [1, 1, 1, 1, 1, 1]]
)
def test_real_multipliers_of_equal_modulus_and_opposite_sign(values):
    S = bases(np.random.default_rng(1), 6, 49, 30.0)
    computed, errors = one(transformed(S, np.broadcast_to(np.diag(values), S.shape)))
    exact = 49 * np.log(np.abs(values)) + 1j * np.pi * (np.array(values) < 0)
    assert differences(computed, exact).max() < 1e-10
    assert set(computed.imag) <= {0.0, np.pi}
    assert (errors < 1e-8).all()


@pytest.mark.parametrize("N", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("m", [1, 3])
def test_permutations_have_roots_of_unity(N, m):
    factors = np.tile(np.eye(N), (m, 1, 1))
    factors[-1] = np.roll(np.eye(N), 1, axis=0)
    computed, _ = one(factors)
    assert np.exp(computed) ** N == pytest.approx(np.ones(N), abs=1e-12)
    assert sorted(computed.imag % (2 * np.pi)) == pytest.approx(2 * np.pi * np.arange(N) / N, abs=1e-12)


def test_reported_errors_cover_defective_multipliers():
    rng = np.random.default_rng(2)
    for size, split in ((2, 1e-6), (3, 1e-3)):
        core = block_diag(0.5 * np.eye(size) + np.diag(np.ones(size - 1), 1), 0.1 * np.eye(4 - size))
        S = bases(rng, 4, 5, 3.0)
        computed, errors = one(transformed(S, np.broadcast_to(core, S.shape)))
        true = np.abs(computed[:size] - 5 * np.log(0.5))
        assert (true <= 10 * errors[:size]).all()
        assert (errors[:size] < split).all()
        assert (errors[size:] < 1e-10).all()


def test_singular_factors_yield_exact_zeros():
    rng = np.random.default_rng(3)
    factors = rng.standard_normal((5, 4, 4))
    factors[:, :, 3] = 0.0
    computed, errors = one(factors)
    assert computed[3] == -np.inf
    assert errors[3] == np.inf
    assert (errors[:3] < 1e-10).all()
    factors = rng.standard_normal((5, 4, 4))
    factors[2] = np.outer(*rng.standard_normal((2, 4)))
    computed, errors = one(factors)
    u, v = factors[2][:, 0], factors[2][0] / factors[2][0, 0]
    exact = np.log(complex(v @ factors[1] @ factors[0] @ factors[4] @ factors[3] @ u))
    assert computed[0] == pytest.approx(exact, abs=1e-12)
    assert (errors[1:] == np.inf).all()
    nilpotent = np.diag(np.ones(3), 1)
    for factors in ([nilpotent], [np.eye(4), nilpotent, np.eye(4)], np.zeros((3, 4, 4))):
        assert (one(factors)[0].real == -np.inf).all()


def test_eigenvectors_along_the_chain():
    rng, logarithms = np.random.default_rng(4), np.array([0.0, 0.0, -20.0, -50.0, -100.0])
    factors = np.array([chain(rng, 5, 30, logarithms, [1.0], 1.0, 10.0) for _ in range(2)])
    eigenvalues = product_eigenvalues(factors, vectors=True)
    assert eigenvalues.right is not None
    assert eigenvalues.left is not None
    size = np.abs(factors).max()
    along = factors @ eigenvalues.right
    after = np.roll(eigenvalues.right, -1, axis=1)
    growth = (after.conj() * along).sum(axis=-2)
    assert np.abs(along - after * growth[..., None, :]).max() < 1e-12 * size
    assert np.log(growth).sum(axis=1).real == pytest.approx(eigenvalues.logarithms.real, abs=1e-9)
    assert np.linalg.norm(eigenvalues.right, axis=-2) == pytest.approx(1.0, abs=1e-12)
    left = np.swapaxes(eigenvalues.left.conj(), -1, -2)
    assert np.abs(np.roll(left, -1, axis=1) @ factors - growth[..., None] * left).max() < 1e-12 * size
    assert left @ eigenvalues.right == pytest.approx(np.broadcast_to(np.eye(5), left.shape), abs=1e-10)


def test_points_do_not_depend_on_each_other():
    factors = np.random.default_rng(5).standard_normal((3, 20, 4, 4))
    together = product_eigenvalues(factors)
    alone = np.array([one(point)[0] for point in factors])
    assert (together.logarithms == alone).all()


def test_blocks_multiply_to_the_balanced_period():
    A = np.array([expm(0.01 * B) for B in np.random.default_rng(6).standard_normal((64, 4, 4))])[None]
    formed = balanced_blocks(A)
    product, whole = np.eye(4), np.eye(4)
    for factor in formed.factors[0]:
        product = factor @ product
    for factor in A[0]:
        whole = factor @ whole
    units = formed.units[0]
    assert formed.factors.shape[1] == len(formed.starts) < 64
    assert product * units[:, None] / units == pytest.approx(whole, rel=1e-12)
