"""Mechanisms derived in memory give the same model as those derived from files."""

import pickle
import re
import runpy
from pathlib import Path

import numpy as np
import pytest

import derive
import solve
from derive import public
from derive.errors import UnitError
from solve.errors import CaseFileError, MissingValueError, ModelFileError, ValueOutOfBoundsError

ROOT = Path(__file__).resolve().parents[2]
PHASE = np.linspace(0.0, 6.0, 7)


def stated(name):
    """Return the function that defines a mechanism of the package."""
    return runpy.run_path(str(ROOT / "models" / name / "mechanism.py"))["mechanism"]


@pytest.fixture(scope="module")
def cam():
    return stated("cam")


def test_mechanism_in_memory_equals_the_model_of_the_file(cam):
    of_file = solve.load("cam")
    for given in (cam, cam()):
        model = solve.load(given, **of_file.parameters)
        assert (model.labels.name, model.labels.case, model.outputs) == ("cam", "", of_file.outputs)
        for ours, theirs in zip(model.at(PHASE, 60.0), of_file.at(PHASE, 60.0), strict=True):
            np.testing.assert_array_equal(ours, theirs)


def test_identical_statement_is_derived_only_once(cam, monkeypatch):
    first = cam().code()

    def derived_again(*_):
        raise AssertionError("derived again")

    monkeypatch.setattr(public, "generated_text", derived_again)
    assert cam().code() is first
    other = cam()
    other.potential = other.potential * derive.Rational(10**20 + 1, 10**20)
    with pytest.raises(AssertionError, match="derived again"):
        other.code()


def test_shapes_of_a_field_are_part_of_the_statement():
    """A deleted function may have the same memory address, and therefore the same text, as a new one."""

    def stated(shape):
        beam = derive.Mechanism("beam", "Pinned beam")
        length, mu, stiffness = beam.parameters(
            L=("m", "length"), mu=("kg/m", "mass a length"), EI=("N m^2", "bending stiffness")
        )
        modes = beam.option("modes", range(1, 3))
        w = beam.field("w", "m", "deflection", length=length, shape=shape, modes=modes)
        beam.kinetic = w.integral(mu * derive.rate(w.deflection) ** 2) / 2
        beam.potential = w.integral(stiffness * w.curvature**2) / 2
        return "\n".join(public._statement(beam))

    whole, half, again = (
        stated(lambda k, xi, c=c: derive.sin((k - c) * derive.pi * xi)) for c in (0, derive.Rational(1, 2), 0)
    )
    assert whole == again != half
    assert " at 0x" not in whole


def test_model_pickles(cam):
    model = solve.load(cam, **solve.load("cam").parameters)
    again = pickle.loads(pickle.dumps(model))
    assert again.parameters == model.parameters
    for ours, theirs in zip(again.at(PHASE, 60.0), model.at(PHASE, 60.0), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert again.varied({"k1": 1e5}).parameters["k1"] == 1e5


def test_structure_is_derived_in_memory():
    of_file = solve.load("portal_frame")
    model = solve.load(stated("portal_frame"), **of_file.parameters)
    position = np.zeros(1)
    np.testing.assert_array_equal(model.frequencies(position, 3), of_file.frequencies(position, 3))


def test_invalid_mechanisms_and_missing_values_are_refused(cam):
    for given in (3, None):
        with pytest.raises(ValueOutOfBoundsError, match="allowed: str, Path, Mechanism or callable"):
            solve.load(given)
    with pytest.raises(ModelFileError, match="given as int; give a name, the path"):
        solve.load(lambda: 3)
    with pytest.raises(MissingValueError, match="cam has no case and gives no value for I0"):
        solve.load(cam)
    with pytest.raises(CaseFileError, match="cam was derived in memory and has no case file for case '1'"):
        solve.load(cam, case=1)


def test_energy_with_wrong_unit_is_refused(cam):
    wrong = cam()
    wrong.kinetic = wrong.potential / wrong.speed
    with pytest.raises(UnitError, match="kinetic energy must be in"):
        solve.load(wrong)


def test_options_may_be_given_as_keyword_arguments():
    named = solve.load("gear_pair", load="constant", zeta=0.03)
    assert named.labels.options == solve.load("gear_pair", options={"load": "constant"}).labels.options
    assert named.parameters["zeta"] == 0.03
    with pytest.raises(ValueOutOfBoundsError, match="option load is given twice"):
        solve.load("gear_pair", options={"load": "constant"}, load="constant")


def test_derive_lists_its_public_names():
    assert {"Mechanism", "Piecewise", "rate", "wrapped"} <= set(dir(derive))


def test_pendulum_of_the_page_runs(capsys, tmp_path):
    page = (ROOT / "docs" / "own_mechanism.md").read_text(encoding="utf-8")
    match = re.search(r"```python\n# in_memory.py\n(.*?)```", page, re.DOTALL)
    assert match
    path = tmp_path / "in_memory.py"
    path.write_text(match.group(1), encoding="utf-8")
    runpy.run_path(str(path))
    assert capsys.readouterr().out == "190 rad/s unstable\n210 rad/s stable\n"
