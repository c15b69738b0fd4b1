"""BLAS uses one thread for small matrices and the previous number of threads otherwise; threads may share a
model."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.linalg  # noqa: F401 - SciPy's library of BLAS is one of those that are counted.
from threadpoolctl import threadpool_info, threadpool_limits

import solve
from solve.arguments import SMALL
from solve.threads import one_thread
from tests.solve import systems


def threads():
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("BLAS has one thread here")
        yield


def test_last_overlapping_call_restores_the_threads():
    with one_thread(SMALL):
        assert threads() == {1}
    assert threads() == {2}
    first, second = one_thread(1), one_thread(1)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert threads() == {1}
    second.__exit__(None, None, None)
    assert threads() == {2}


def test_large_systems_use_all_threads():
    with one_thread(SMALL + 1):
        assert threads() == {2}


@pytest.mark.parametrize(
    "study", [lambda it: solve.periodic(it, 1.0), lambda it: solve.sweep(it, [1.0, 1.1])]
)
def test_solves_use_one_thread_and_restore_the_others(study):
    computed = set()

    def matrices(phase, speed):
        computed.update(threads())
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 2.0 * one, np.cos(phase)[:, None]

    study(systems.system(matrices, 1))
    assert 1 in computed
    assert threads() == {2}


def test_error_restores_the_threads():
    resonant = systems.constant([[1.0]], [[0.0]], [[1.0]], lambda phase: np.cos(phase)[:, None])
    with pytest.raises(solve.SolveError):
        solve.periodic(resonant, 1.0)
    assert threads() == {2}


def test_threads_may_share_a_model():
    """Generated functions write to separate memory in each thread."""
    model, speeds = solve.load("cam"), np.linspace(20.0, 90.0, 24).tolist()
    alone = [solve.periodic(solve.load("cam"), speed, rtol=1e-4).q for speed in speeds]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda speed: solve.periodic(model, speed, rtol=1e-4).q, speeds))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_array_equal(one, other)


BUILDING = """
import time
from concurrent.futures import ThreadPoolExecutor
import solve
from solve.model.sampling import folded, tangent
setup = solve.load("cam").setup
residual, end = setup.function("residual"), time.monotonic() + 8
def build(_):
    while time.monotonic() < end:
        tangent(residual, setup.p), folded(residual, setup.p)
with ThreadPoolExecutor(3) as pool:
    list(pool.map(build, range(3)))
print("built")
"""


@pytest.mark.slow
def test_functions_may_be_built_in_several_threads():
    """Without the lock, half of the runs of 10 s ended with a segmentation fault or an abort."""
    ended = subprocess.run([sys.executable, "-c", BUILDING], capture_output=True, text=True)
    assert ended.stdout == "built\n", ended.stderr[-2000:]
