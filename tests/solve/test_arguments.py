"""Invalid arguments of public functions are refused with clear messages."""

import inspect
import pickle
import typing
from collections.abc import Callable, Mapping
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from types import UnionType
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import solve
from solve.arguments import require_index
from solve.errors import SolveError, ValueOutOfBoundsError
from solve.results.bands import Bands
from solve.system import PeriodicSystem
from tests.solve.systems import random_system

FUNCTIONS = [name for name in solve.__all__ if inspect.isfunction(getattr(solve, name))]
OF_OTHERS = {"boundaries", "chart", "signal_statistics", "sweeps"}
"""Those whose first argument may be a function or a mapping."""


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS) - OF_OTHERS))
def test_every_public_function_refuses_a_number(name):
    function = getattr(solve, name)
    first, *others = inspect.signature(function).parameters.values()
    needed = {other.name: None for other in others if other.default is other.empty}
    with pytest.raises(SolveError, match=r"3|int"):
        function(3, **needed)
    with pytest.raises(SolveError, match=r"3|int"):
        function(**{first.name: 3}, **needed)


class Wrong:
    """Object of an invalid type."""


ACCEPTED = {
    PeriodicSystem: solve.load("mathieu", delta=1.0),
    solve.Model: solve.load("mathieu", delta=1.0),
    Bands: Bands.__new__(Bands),
    str: "cam",
    Mapping: {},
    Callable: np.cos,
}
"""Values of the first argument by type."""


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_argument_of_wrong_type_is_refused_by_name(name):
    """Lists and mappings with invalid entries are refused, and None if it is not allowed. The model checks
    the parameter values that are passed to `load`."""
    function, wrong = getattr(solve, name), Wrong()
    hints = typing.get_type_hints(function)
    first, *others = list(hints)[: -2 if name == "load" else -1]
    kinds = typing.get_args(hints[first]) if typing.get_origin(hints[first]) is UnionType else (hints[first],)
    kinds = [typing.get_origin(each) or each for each in kinds]
    given = next(value for kind, value in ACCEPTED.items() if kind in kinds)
    for parameter in others:
        values = [wrong, [wrong], {3: "1"}, b"k1"]
        values += [] if type(None) in typing.get_args(hints[parameter]) else [None]
        values += [] if parameter == "options" else [{"k1": wrong}]
        for value in values:
            with pytest.raises(ValueOutOfBoundsError) as caught:
                function(**{first: given, parameter: value})
            (message,) = str(caught.value).splitlines()
            assert message.startswith(f"{parameter} is "), message
            assert message.endswith(f"; see help(solve.{name})"), message


def test_error_for_a_model_name_suggests_load():
    message = r"^system is 'cam'; allowed: PeriodicSystem, such as solve\.load\('cam'\)$"
    with pytest.raises(SolveError, match=message):
        solve.periodic("cam", "600 rpm")  # type: ignore[arg-type]


@pytest.mark.parametrize("given", [object(), lambda: None, solve])
def test_messages_print_no_address_of_an_object(given):
    with pytest.raises(SolveError) as caught:
        solve.tolerances(given)
    assert "0x" not in str(caught.value)
    assert "allowed: Model, such as solve.load('cam')" in str(caught.value)


@pytest.mark.parametrize("steps", [0, -1, 2.5, np.nan])
def test_steps_of_a_nonlinear_orbit_are_integers(steps):
    with pytest.raises(SolveError, match=r"steps is .*; allowed: whole numbers of at least 1"):
        solve.nonlinear(solve.load("cam"), "100 rpm", steps=steps)


def test_missing_arguments_raise_a_type_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'system'"):
        solve.periodic(speed=1.0)  # type: ignore[call-arg]


def test_public_function_keeps_its_signature_and_can_be_pickled():
    assert next(iter(inspect.signature(solve.sweep).parameters)) == "system"
    assert pickle.loads(pickle.dumps(solve.sweep)) is solve.sweep


def plane():
    return random_system(3, 2)


def orbit():
    return solve.periodic(plane(), 2.0)


CHARTED = {"x": "delta=1:2:2", "y": "epsilon=0:1:2", "speed": 1.0}
REFUSED = {
    "orders is 2.5; allowed: whole numbers of at least 1": lambda: solve.critical_speeds(
        plane(),
        [1.0, 2.0],
        orders=2.5,  # type: ignore[arg-type]
    ),
    "orders is '3'; allowed": lambda: solve.critical_speeds(plane(), [1.0, 2.0], orders="3"),  # type: ignore[arg-type]
    "the function that builds systems returns 3; it must return a PeriodicSystem": lambda: solve.chart(
        lambda delta, epsilon: 3,
        **CHARTED,  # type: ignore[arg-type, return-value]
    ),
    "x is {'delta': 1.0}; allowed: str or mapping": lambda: solve.chart(
        "mathieu",
        {"delta": 1.0},  # type: ignore[dict-item]
        "epsilon=0:1:2",
    ),
    r"position is \[\]; allowed": lambda: solve.frequencies(plane(), []),
    "count is 1.5; allowed": lambda: solve.frequencies(plane(), 0.0, 1.5),  # type: ignore[arg-type]
    "0 values at 1 positions": lambda: solve.frequencies_over(solve.load("cam"), "k1", [], np.zeros(1)),
    r"coordinates is \[1\]; allowed: sequence of str": lambda: solve.PeriodicSystem(plane().at, [1]),  # type: ignore[list-item]
    "'targets' is empty": lambda: solve.compare(plane(), 2.0, targets=[]),
    "period is '2'; allowed": lambda: solve.PeriodicSystem(plane().at, ["q"], "2"),  # type: ignore[arg-type]
    "1e\\+09 turns; allowed: up to 43690, or more with": lambda: solve.transient(plane(), 2.0, 10**9),
    "start is 3; allowed: 'rest', 'orbit'": lambda: solve.transient(plane(), 2.0, 3, 3),  # type: ignore[arg-type]
    "k1 is 'stiff'; give a number, such as 1.5, in N m/rad": lambda: solve.variants(
        solve.load("cam"), "k1", ["stiff"]
    ),
    "1e\\+30 periods; allowed": lambda: solve.nonlinear(solve.load("cam"), "100 rpm", periods=10**30),
    "'problem' returns 0.0; it must return a PeriodicSystem and a speed": lambda: solve.boundaries(
        float,  # type: ignore[arg-type]
        [0.0, 1.0],
    ),
    "'signal' returns 1.0; it must return a real value for each": lambda: solve.signal_statistics(
        lambda phase: 1.0,  # type: ignore[arg-type, return-value]
        1.0,
    ),
    "period is nan; allowed: finite": lambda: solve.signal_statistics(np.cos, np.nan),
    "no harmonics above the mean are stored": lambda: solve.sweep(
        plane(), 2.0, spectra="q1", harmonics=0
    ).waterfall("q1"),
    "the phases have the shape \\(1, 2\\); allowed: \\(k,\\)": lambda: plane().at(np.ones((1, 2)), 2.0),
    "shape \\(2, 1\\); allowed: \\(k,\\)": lambda: solve.lqr(
        solve.load("cam"), "600 rpm", Q=np.eye(6), R=np.eye(1)
    ).gain(np.ones((2, 1))),
    "place is -4; allowed: whole numbers from -3 to 2": lambda: require_index("place", -4, 3),
    "a phase is NaN": lambda: solve.periodic(plane(), 2.0).at(np.array([0.0, np.nan])),
    "a phase is NaN or infinite; give": lambda: solve.periodic(plane(), 2.0).state(np.array([np.inf])),
    "the start has coordinates q1, q2; cam has q1, q2, q3": lambda: solve.nonlinear(
        solve.load("cam"), "100 rpm", solve.periodic(plane(), 2.0)
    ),
}


METHODS = {
    "phase is 'x'; allowed: float or (k,) array; see help(solve.Orbit.at)": lambda: orbit().at("x"),
    "path is 3; allowed: str or Path; see help(solve.Orbit.save)": lambda: orbit().save(3),
    "name is 3; allowed: str; see help(solve.Orbit.harmonics)": lambda: orbit().harmonics(3),
    "1e+30 harmonics; allowed: up to": lambda: orbit().harmonics("q1", 10**29 * 10 // 8),
    "figure is None; allowed: ": lambda: solve.sweep(plane(), [1.0, 2.0]).figures("q1", None),
    "phase is [None]; allowed: ndarray; see help(solve.PeriodicSystem.at)": lambda: plane().at([None], 1.0),
    "options is 3; allowed: mapping; see help(solve.Model.varied)": lambda: solve.load("cam").varied({}, 3),
    "gamma of newmark is a; allowed: 0 … 1": lambda: solve.Newmark("a"),
    "beta of newmark is [0.2]; allowed: 0 … 1": lambda: solve.Newmark(beta=[0.2]),
    "order of radau is 9.0; allowed: 3, 5": lambda: solve.Radau(9.0),
    "matrices is 3; allowed: callable; see help(solve.PeriodicSystem)": lambda: solve.PeriodicSystem(
        3, ["q"]
    ),
    "inputs is 3; allowed: sequence of str": lambda: solve.FirstOrderSystem(np.cos, ["x"], inputs=3),
    "steps is 'a'; allowed": lambda: solve.PeriodicCurves(plane(), steps="a"),
    "method is 3; allowed: Method; see help(solve.PeriodicCurves)": lambda: solve.PeriodicCurves(plane(), 3),
    "harmonics is -1; allowed: whole numbers of at least 0": lambda: solve.sweep(
        plane(), [1.0, 2.0], harmonics=-1
    ),
}


@pytest.mark.parametrize("words", METHODS)
def test_methods_and_constructors_refuse_arguments_of_wrong_type(words):
    with pytest.raises(SolveError) as caught:
        METHODS[words]()
    assert str(caught.value).startswith(words)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("study", "settings", "words"),
    [
        (solve.validity, {"method": "trapezoid"}, "method 'trapezoid'"),
        (solve.validity, {"rtol": 2.0}, "rtol is 2.0"),
        (solve.sensitivities_over, {"method": "trapezoid"}, "method 'trapezoid'"),
        (solve.sensitivities_over, {"method": "newmark"}, "method is newmark; sensitivities support"),
        (solve.sensitivities_over, {"engine": "gpu"}, "engine 'gpu'"),
        (solve.sensitivities_over, {"steps": 2.5}, "steps is 2.5"),
        (solve.sensitivities_over, {"rtol": 2.0}, "rtol is 2.0"),
    ],
)
def test_invalid_settings_are_refused_before_the_first_speed(monkeypatch, study, settings, words):
    def solved(*_, **__):
        raise AssertionError("a speed was solved")

    for module in ("solve.studies.sweep.periodic", "solve.studies.sensitivities.sensitivities"):
        monkeypatch.setattr(module, solved)
    with pytest.raises(SolveError, match=words):
        study(solve.load("cam"), "100:200:3 rpm", **settings)


def test_methods_accept_sequences_and_numbers_of_numpy():
    motion, system = orbit(), plane()
    np.testing.assert_array_equal(motion.at([0.1, 0.2]), motion.at(np.array([0.1, 0.2])))
    assert motion.at(np.float64(0.1)).shape == (2, 1)
    np.testing.assert_array_equal(system.at([0.1], 2)[2], system.at(np.array([0.1]), 2.0)[2])
    assert solve.Gauss(np.int64(8)).nodes.shape == (4,)


@pytest.mark.parametrize("words", REFUSED)
def test_arguments_of_wrong_type_are_refused(words):
    with pytest.raises(ValueOutOfBoundsError, match=words):
        REFUSED[words]()


def test_method_may_be_text_and_numbers_may_be_arrays():
    rows = solve.compare(plane(), 2.0, "gauss", np.array([20]), np.array([0.1])).rows
    assert {row.method for row in rows} == {"gauss"}


@pytest.mark.parametrize("kind", [np.array, pd.Series, xr.DataArray, list, iter])
def test_arrays_of_other_libraries_are_accepted(kind):
    system, cam = plane(), solve.load("cam")
    assert [*solve.sweep(system, kind([1.0, 2.0])).speeds] == [1.0, 2.0]
    assert [*solve.variants(cam, "k1", kind([1e4, 2e4]))] == ["10000", "20000"]
    if kind is not iter:
        state = kind([0.1, 0.0]), kind([0.0, 0.2])
        assert solve.transient(system, 2.0, 2, state).q[0, 0] == 0.1


def test_arrays_without_dimension_are_accepted_as_numbers():
    speed: Any = xr.DataArray(2.0)
    rtol: Any = np.array(1e-6)
    count: Any = np.array(1)
    state: Any = np.array([[0.1, 0.0], [0.0, 0.2]])
    assert solve.periodic(plane(), speed, rtol=rtol).speed == 2.0
    assert solve.transient(plane(), 2.0, 2, state).q[0, 0] == 0.1
    with pytest.raises(ValueOutOfBoundsError, match=r"^count is array\(1\); allowed"):
        solve.frequencies(plane(), 0.0, count)
    with pytest.raises(ValueOutOfBoundsError, match=r"^values is array\(1\.e-06\)"):
        solve.variants(solve.load("cam"), "k1", rtol)


@pytest.mark.parametrize("given", [np.eye(2), pd.DataFrame({"a": [1, 2]}), xr.Dataset({"a": ("x", [1.0])})])
def test_messages_about_tables_have_one_line(given):
    with pytest.raises(ValueOutOfBoundsError) as caught:
        solve.periodic(plane(), given)
    assert len(str(caught.value).splitlines()) == 1


def test_numeric_cases_and_path_objects_are_accepted():
    file = Path(solve.__file__).parents[1] / "models" / "cam" / "cases.toml"
    assert solve.case_numbers("cam", 1, file) == solve.case_numbers("cam", "1", str(file))
    chart = solve.chart("cam", "k1=6e4:9e4:2", "k2=6e4:9e4:2", "100 rpm", 1, rtol=1e-3, boundaries=False)
    assert chart.system.labels.case == "1"


@pytest.mark.parametrize("kind", [Fraction, Decimal, np.float32])
def test_phases_of_any_number_type_give_the_same_values(kind):
    orbit = solve.periodic(plane(), 2.0)
    expected = orbit.at([0.5, 1.25])
    for given in ([kind(0.5), kind(1.25)], np.array([kind(0.5), kind(1.25)], dtype=object)):
        assert (orbit.at(given) == expected).all()
    with pytest.raises(ValueOutOfBoundsError, match="phase is"):
        orbit.at(np.array([kind(0.5), True], dtype=object))
