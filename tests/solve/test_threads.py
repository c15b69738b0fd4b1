"""BLAS uses one thread for small matrices and the previous number of threads otherwise; threads may share a
model."""

import gc
import subprocess
import sys
import weakref
from concurrent.futures import ThreadPoolExecutor

import casadi
import numpy as np
import pytest
import scipy.linalg  # noqa: F401 - SciPy's library of BLAS is one of those that are counted.
from threadpoolctl import threadpool_info, threadpool_limits

import solve
from solve import threads
from solve.arguments import SMALL
from solve.model.sampling import Sampler
from solve.threads import one_thread
from tests.solve import systems


def number_of_threads():
    return {each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    with threadpool_limits(limits=2, user_api="blas"):
        if number_of_threads() != {2}:
            pytest.skip("BLAS has one thread here")
        yield


def test_last_overlapping_call_restores_the_threads():
    with one_thread(SMALL):
        assert number_of_threads() == {1}
    assert number_of_threads() == {2}
    first, second = one_thread(1), one_thread(1)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert number_of_threads() == {1}
    second.__exit__(None, None, None)
    assert number_of_threads() == {2}


def test_large_systems_use_all_threads():
    with one_thread(SMALL + 1):
        assert number_of_threads() == {2}


@pytest.mark.parametrize(
    "study", [lambda it: solve.periodic(it, 1.0), lambda it: solve.sweep(it, [1.0, 1.1])]
)
def test_solves_use_one_thread_and_restore_the_others(study):
    computed = set()

    def matrices(phase, speed):
        computed.update(number_of_threads())
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 2.0 * one, np.cos(phase)[:, None]

    study(systems.system(matrices, 1))
    assert 1 in computed
    assert number_of_threads() == {2}


def test_error_restores_the_threads():
    resonant = systems.constant([[1.0]], [[0.0]], [[1.0]], lambda phase: np.cos(phase)[:, None])
    with pytest.raises(solve.SolveError):
        solve.periodic(resonant, 1.0)
    assert number_of_threads() == {2}


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
import casadi
from solve.model.sampling import folded
x, p = casadi.SX.sym("x"), casadi.SX.sym("p", 20)
product = casadi.Function("product", [x, p], [x * p], ["x", "p"], ["y"])
values, end = [0.1 + k / 7 for k in range(20)], time.monotonic() + 8
def build(_):
    while time.monotonic() < end:
        folded(product, values)
with ThreadPoolExecutor(3) as pool:
    list(pool.map(build, range(3)))
print("built")
"""


@pytest.mark.slow
def test_functions_may_be_built_and_released_in_several_threads():
    """Without the lock, or if the lock does not cover the release of functions, about half of the runs end
    with a segmentation fault or an abort."""
    ended = subprocess.run([sys.executable, "-c", BUILDING], capture_output=True, text=True)
    assert ended.stdout == "built\n", (ended.returncode, ended.stderr[-2000:])


class Result:
    """Object that can be referenced weakly."""


class Owner(threads.FunctionOwner):
    def __init__(self, result):
        self.result = result


def test_next_symbolic_call_releases_memory_of_unused_functions():
    build = threads.symbolic(Result)
    used, unused = build(), build()
    reference, owned = weakref.ref(unused), Owner(Result())
    inner = weakref.ref(owned.result)
    del unused, owned
    assert reference() is not None
    assert inner() is not None
    build()
    assert reference() is None
    assert inner() is None
    assert used is not None


def test_results_that_are_returned_repeatedly_are_released():
    stored = [Result()]
    build = threads.symbolic(lambda: stored[0])
    build()
    build()
    reference = weakref.ref(stored.pop())
    threads.symbolic(Result)()
    assert reference() is None


def expressions_in(owner):
    """Expressions to which objects other than results of symbolic functions refer, directly or through the
    attributes and containers of `owner`."""
    seen, left, found = {id(each) for each in threads._results}, [owner], []
    while left:
        each = left.pop()
        if isinstance(each, casadi.SX | casadi.Function):
            found.append(each)
        elif isinstance(each, dict | list | tuple | set) or type(each).__module__.startswith("solve."):
            new = [part for part in gc.get_referents(each) if id(part) not in seen]
            seen.update(map(id, new))
            left += [part for part in new if not isinstance(part, type | Sampler)]
    return found


@pytest.mark.parametrize("name", ["slider_crank", "gear_pair"])
def test_models_store_no_expressions_that_are_released_unprotected(name):
    """Without the lock, the release of an expression may free a constant that another thread is using."""
    model = solve.load(name)
    solve.sensitivities(model, model.labels.case_speed or 10.0, rtol=1e-4)
    assert expressions_in(model) == []


def test_samplers_do_not_release_functions_themselves():
    function = casadi.Function("f", [casadi.SX.sym("x")], [casadi.SX(1.0)])
    sampler = Sampler(function)
    memory = weakref.ref(sampler._result)
    del sampler
    assert memory() is not None
    threads.symbolic(Result)()
    assert memory() is None


def test_samplers_are_released_after_their_module(monkeypatch):
    """At the end of a process, the names of a module are removed before some objects."""
    sampler, raised = Sampler(casadi.Function("f", [casadi.SX.sym("x")], [casadi.SX(1.0)])), []
    monkeypatch.setattr(threads, "_results", None)
    monkeypatch.setattr(sys, "unraisablehook", raised.append)
    del sampler
    assert raised == []
