"""What public functions cannot take as their first argument is refused in words."""

import inspect
import pickle

import pytest

import solve
from solve import public
from solve.errors import SolveError

FUNCTIONS = [name for name in public.__all__ if inspect.isfunction(getattr(solve, name))]
OF_OTHERS = {"boundaries", "chart", "signal_statistics", "sweeps"}
"""Those whose first argument may be a function or a mapping."""


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - OF_OTHERS))
def test_a_number_is_refused_by_every_public_function(name):
    function = getattr(solve, name)
    first, *others = inspect.signature(function).parameters.values()
    needed = {each.name: None for each in others if each.default is each.empty}
    with pytest.raises(SolveError, match=r"3|int"):
        function(3, **needed)
    with pytest.raises(SolveError, match=r"3|int"):
        function(**{first.name: 3}, **needed)


def test_the_name_of_a_model_is_answered_by_how_to_load_it():
    message = r"^system is 'cam'; allowed: PeriodicSystem, such as solve\.load\('cam'\)$"
    with pytest.raises(SolveError, match=message):
        solve.periodic("cam", "600 rpm")  # type: ignore[arg-type]


def test_what_is_missing_is_python_s_own_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'system'"):
        solve.periodic(speed=1.0)  # type: ignore[call-arg]


def test_a_public_function_keeps_its_signature_and_can_be_sent_to_other_processes():
    assert next(iter(inspect.signature(solve.sweep).parameters)) == "system"
    assert pickle.loads(pickle.dumps(solve.sweep)) is solve.sweep
