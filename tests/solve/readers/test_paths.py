"""`solve.load` with the paths of all readers, FMI units without a speed, and Python files that define a
system."""

import numpy as np
import pytest

import solve
from solve.errors import FileError, MissingValueError, ModelFileError, UnknownNameError, ValueOutOfBoundsError
from solve.labels import speed_or_usual
from solve.readers.files import is_system_file
from tests.solve.op4_files import text
from tests.solve.readers.fmi2_unit import require_fmu_tools, write_unit
from tests.solve.readers.lin_files import SPEED, A, write_set
from tests.solve.readers.test_formats import second_order, write, write_matrix_market

PYTHON = """
import numpy as np
import solve

def system(k=4.0, depth=0.5, c=0.1):
    def matrices(phase, speed):
        A = np.zeros((len(phase), 2, 2))
        A[:, 0, 1], A[:, 1, 0], A[:, 1, 1] = 1.0, -k * (1 + depth * np.cos(phase)), -c
        return A, np.stack((0 * phase, np.cos(phase)), axis=1)

    return solve.FirstOrderSystem(matrices, ["x", "v"])
"""


@pytest.mark.parametrize("ending", [".mat", ".npz", ".nc", ".mtx", ".op4"])
def test_paths_of_matrices_are_loaded(tmp_path, ending):
    path = str(tmp_path / f"rotor{ending}")
    if ending == ".mtx":
        path = write_matrix_market(tmp_path)
    elif ending == ".op4":
        (tmp_path / "rotor.op4").write_text(text({"MAA": np.eye(2), "KAA": np.diag([4.0, 9.0])}))
    else:
        write(second_order(), tmp_path / f"rotor{ending}")
    expected = np.diag([4.0, 9.0]) if ending == ".op4" else second_order()["K"][0]
    np.testing.assert_allclose(solve.load(path).at(np.zeros(1), 1.0)[2][0], expected, atol=1e-12)
    with pytest.raises(ValueOutOfBoundsError, match="no parameters, cases or options; omit k1"):
        solve.load(path, k1=1.0)
    with pytest.raises(ValueOutOfBoundsError, match="omit reduce"):
        solve.load(path, reduce=2)


@pytest.mark.parametrize(
    "how", [{"options": {"exclude": "GeAz, GeAz_rate"}}, {"exclude": ["GeAz", "GeAz_rate"]}]
)
def test_states_of_openfast_are_excluded_by_an_option(tmp_path, how):
    found = solve.floquet(solve.load(write_set(tmp_path, 12), **how), SPEED).multipliers
    expected = np.exp(np.linalg.eigvals(A) * 2 * np.pi / SPEED)
    np.testing.assert_allclose(np.abs(found[:, None] - expected).min(axis=0), 0.0, atol=1e-9)
    with pytest.raises(UnknownNameError, match="drive"):
        solve.load(str(tmp_path / "run.*.lin"), options={"drive": "w"})


def test_unit_without_a_speed_is_linearised_at_every_speed(tmp_path):
    """The stiffness d of the unit is set to the speed. The multipliers are those of units with this value."""
    require_fmu_tools(exported=False)
    path = str(write_unit(tmp_path))
    unit, swept = solve.load(path, c=0.3), solve.load(path, options={"drive": "d"})
    assert (unit.states, unit.inputs, unit.outputs) == (("x", "v"), ("u",), ("y",))
    for speed in (1.0, 0.8):
        fixed = solve.read_fmu(path, speed, values={"c": 0.3}, period=2 * np.pi * speed)
        alone = solve.read_fmu(path, values={"c": 0.3}, period=2 * np.pi * speed)
        np.testing.assert_array_equal(
            alone.equations_at(np.ones(1), speed)[0], fixed.equations_at(np.ones(1), speed)[0]
        )
    expected = solve.floquet(solve.read_fmu(path, 1.0, values={"c": 0.3}), 1.0).multipliers
    np.testing.assert_allclose(solve.floquet(unit, 1.0).multipliers, expected, atol=1e-9)
    assert swept.equations_at(np.zeros(1), 1.0)[0][0, 1, 0] == pytest.approx(-1.0 - 0.5)
    with pytest.raises(MissingValueError, match="states no speed"):
        speed_or_usual(unit, None)
    with pytest.raises(ValueOutOfBoundsError, match="'motion' applies to one speed"):
        solve.read_fmu(path, motion={})
    with pytest.raises(ValueOutOfBoundsError, match="allowed: numbers"):
        solve.load(path, c="1 N s/m")


def test_python_file_defines_a_system_with_parameters(tmp_path):
    file = tmp_path / "rotor.py"
    file.write_text(PYTHON)
    system = solve.load(str(file), depth=0.0)
    assert (system.labels.name, system.labels.parameters) == ("rotor", {"k": 4.0, "depth": 0.0, "c": 0.1})
    rho = np.exp((-0.05 + 1j * np.sqrt(4 - 0.05**2)) * 2 * np.pi / 3)
    assert np.abs(solve.floquet(system, 3.0).multipliers - rho).min() < 1e-8
    rho = np.exp((-0.05 + 1j * np.sqrt(9 - 0.05**2)) * 2 * np.pi / 3)
    swept = solve.sweep(system, 3.0, over={"k": [4.0, 9.0]})
    assert np.abs(swept.points[1].multipliers - rho).min() < 1e-8
    with pytest.raises(UnknownNameError, match="did you mean 'depth'"):
        solve.load(str(file), dept=1.0)
    with pytest.raises(ValueOutOfBoundsError, match="finite numbers without unit"):
        solve.load(str(file), k="4 N/m")


BAD_PYTHON = {
    "fails": ("import solve\n\n\nsystem = 1 / 0\n", "line 4: ZeroDivisionError"),
    "fails in the function": ("def system():\n    return missing\n", "line 2: NameError"),
    "no system": ("system = 3\n", "system of .* is int; give a PeriodicSystem"),
    "returns none": ("def system():\n    pass\n", r"system\(\) of .* returns NoneType"),
}


@pytest.mark.parametrize(("code", "expected"), BAD_PYTHON.values(), ids=BAD_PYTHON)
def test_python_files_without_a_system_are_refused_in_one_line(tmp_path, code, expected):
    (tmp_path / "rotor.py").write_text(code)
    with pytest.raises(ModelFileError, match=expected) as refused:
        solve.load(str(tmp_path / "rotor.py"))
    assert "\n" not in str(refused.value)


def test_mechanisms_are_not_executed_by_loading(tmp_path):
    (tmp_path / "made.py").write_text("def mechanism(): ...\nsystem = 1 / 0\n")
    assert not is_system_file(str(tmp_path / "made.py"))
    with pytest.raises(ModelFileError, match="no generated code"):
        solve.load(str(tmp_path / "made.py"))


def test_missing_file_is_reported(tmp_path):
    with pytest.raises(FileError, match="there is no file"):
        solve.load(str(tmp_path / "none.fmu"))
