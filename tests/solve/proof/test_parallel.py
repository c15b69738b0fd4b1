"""Steps of a proof in other processes."""

import pickle
from concurrent.futures import Executor

import mpmath
import pytest

pytest.importorskip("flint")

import solve
from solve.proof.balls import arb, arb_mat, precision


class Pickling(Executor):
    """Executor that pickles tasks and results, as communication between processes does."""

    def __init__(self):
        self.parts = 0

    def map(self, work, parts, **_):
        for part in parts:
            self.parts += 1
            made = pickle.loads(pickle.dumps(work))(pickle.loads(pickle.dumps(part)))
            yield pickle.loads(pickle.dumps(made))


@pytest.mark.parametrize("bits", [30, 600])
def test_balls_are_restored_with_all_bits(bits):
    with precision(300):
        matrix = arb_mat([[arb.pi() / 3, arb(0, 1e-30)], [arb(-1) / 7, arb.nan()]])
        data = pickle.dumps(matrix)
    with precision(bits):
        restored = pickle.loads(data)
    with precision(600):
        for before, after in zip(matrix.entries()[:3], restored.entries()[:3], strict=True):
            assert (before.mid() - after.mid()).is_zero()
            assert after.contains(before)
            assert after.rad() <= before.rad() * (1 + 1e-8)
        assert not restored[1, 1].is_finite()


@pytest.mark.parametrize("model", ["mathieu", "meissner"])
def test_proofs_from_parts_of_a_period_are_identical(model):
    system, executor = solve.load(model), Pickling()
    alone, together = solve.prove(system, 1.0), solve.prove(system, 1.0, executor=executor)
    assert executor.parts >= 24
    assert together.verdict == alone.verdict
    with mpmath.workdps(40):
        bounds = [tuple(map(mpmath.mpf, each.spectral_radius)) for each in (alone, together)]
        assert max(low for low, _ in bounds) <= min(high for _, high in bounds)
        assert bounds[1][1] - bounds[1][0] < 1e-11
