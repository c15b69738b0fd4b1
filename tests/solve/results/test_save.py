"""Files contain the orbit: each kind is read with the tools of its users."""

import csv
import json

import numpy as np
import pytest
import xarray
from numpy.testing import assert_allclose, assert_array_equal

import solve
from derive import Mechanism, cos, rate
from solve import PeriodicSystem
from solve.errors import FileError, ValueOutOfBoundsError
from solve.results.files import write_atomic
from tests.solve.results.problems import chain, orbit, x_of


@pytest.fixture(scope="module")
def result():
    return orbit()


def test_npz_file_contains_the_arrays(result, tmp_path):
    result.save(tmp_path / "orbit.npz")
    with np.load(tmp_path / "orbit.npz") as file:
        read = dict(file)
    m = result.steps
    assert read["phase"].shape == read["time"].shape == (m + 1,)
    assert read["q"].shape == read["qd"].shape == read["qdd"].shape == (2, m + 1)
    for name in ("phase", "time", "q", "qd", "qdd", "multipliers", "exponents"):
        assert_array_equal(read[name], getattr(result, name))
    assert read["coordinates"].tolist() == ["x", "phi"]
    assert read["outputs"].tolist() == ["power"]
    assert_array_equal(read["output_values"], [result.outputs["power"]])
    assert_allclose(read["q"][0], x_of(read["phase"]), atol=1e-8)
    metadata = json.loads(str(read["metadata"]))
    assert metadata["model"] == "two oscillators"
    assert metadata["speed"] == 3.0
    assert metadata["units"] == {"x": "m", "phi": "rad", "power": "W"}
    assert metadata["verdict"] == "asymptotically stable"


@pytest.mark.parametrize("names", [["time", "y"], ["phase", "y"], ["y", "yd"], ["multiplier_re", "y"]])
def test_names_used_by_the_file_format_are_refused(names, tmp_path):
    """Otherwise, one of the two columns would be lost, for example the time."""
    alike = chain(2)
    twice = solve.periodic(PeriodicSystem(alike.at, names), 3.0, rtol=1e-3)
    with pytest.raises(ValueOutOfBoundsError, match=r"is the name of two quantities .*rename the coordinate"):
        twice.save(tmp_path / "orbit.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a/b", "", "state", "state1", "seal", "metadata"])
def test_names_unsuitable_for_files_are_refused(name, tmp_path):
    alike = chain(2)
    orbit = solve.periodic(PeriodicSystem(alike.at, [name, "y"]), 3.0, rtol=1e-3)
    for ending in (".nc", ".npz"):
        with pytest.raises(ValueOutOfBoundsError, match=f"'{name}' cannot be the name of a column"):
            orbit.save(tmp_path / f"orbit{ending}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".nc", ".npz"])
def test_coordinate_names_resembling_internal_names_are_read_back(ending, tmp_path):
    alike = chain(2)
    sweep = solve.sweep(PeriodicSystem(alike.at, ["seal_gap", "state_of_valve"]), [3.0, 4.0], rtol=1e-3)
    sweep.save(tmp_path / f"sweep{ending}")
    assert solve.open(tmp_path / f"sweep{ending}").record() == sweep.record()


def test_csv_file_contains_the_columns(result, tmp_path):
    result.save(tmp_path / "orbit.csv")
    text = (tmp_path / "orbit.csv").read_bytes().decode("utf-8")
    assert "\r" not in text
    header, *rows = csv.reader(text.splitlines())
    assert header == ["time (s)", "phase (rad)", "x (m)", "phi (rad)", "power (W)"]
    expected = (result.time, result.phase, *result.q, result.outputs["power"])
    assert_array_equal(np.array(rows, dtype=float).T, expected)


def test_mat_file_contains_the_arrays(result, tmp_path):
    from scipy.io import loadmat

    result.save(tmp_path / "orbit.mat")
    read = loadmat(tmp_path / "orbit.mat", squeeze_me=True, chars_as_strings=True)
    for name in ("phase", "time", "q", "qd", "qdd", "multipliers", "exponents"):
        assert_array_equal(read[name], getattr(result, name))
    assert read["coordinates"].tolist() == ["x", "phi"]
    assert str(read["outputs"]) == "power"
    assert_array_equal(read["output_values"], result.outputs["power"])
    assert json.loads(str(read["metadata"]))["method"] == result.method


@pytest.mark.parametrize("name", ["φ", "_x"])
def test_names_unsuitable_for_matlab_are_refused(name, tmp_path):
    """SciPy would raise an error for one of the names and omit the other."""
    sweep = solve.sweep(PeriodicSystem(chain(2).at, [name, "y"]), [3.0, 4.0], rtol=1e-3)
    with pytest.raises(
        ValueOutOfBoundsError, match=f"'{name}_max' cannot be the name of a variable in MATLAB"
    ):
        sweep.save(tmp_path / "sweep.mat")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["steps", "verdict", "spectral_radius", "x_max"])
def test_parameter_named_like_a_column_is_refused(name, tmp_path):
    mechanism = Mechanism("lever", "Lever")
    x = mechanism.coordinate("x", "m", "way")
    mass, k = mechanism.parameter(name, "kg", "mass", "> 0"), mechanism.parameter("k", "N/m", "spring", "> 0")
    mechanism.kinetic, mechanism.potential = mass * rate(x) ** 2 / 2, k * x**2 / 2
    mechanism.force(k * cos(mechanism.phase) * x, along=x)
    model = solve.load(mechanism, **{name: 1.0, "k": 4.0})
    sweep = solve.sweep(model, 1.3, over={name: [1.0, 1.2]}, rtol=1e-3)
    assert "1.2" in repr(sweep)
    with pytest.raises(ValueOutOfBoundsError, match=f"'{name}' is the name of two quantities"):
        sweep.save(tmp_path / "sweep.csv")
    charted = solve.chart(model, {name: [1.0, 1.2]}, {"speed": [1.0, 1.3]}, boundaries=False)
    if name in ("verdict", "spectral_radius"):
        with pytest.raises(ValueOutOfBoundsError, match=f"'{name}' is the name of two quantities"):
            charted.to_pandas()
    else:
        assert list(charted.to_pandas()[name]) == [1.0, 1.2, 1.0, 1.2]


def test_dataset_has_dimensions_units_and_names(result):
    dataset = result.to_xarray()
    assert dataset["x"].dims == ("phase",)
    assert_array_equal(dataset["phase"], result.phase)
    assert_array_equal(dataset["time"], result.time)
    for name, row in (("x", result.q[0]), ("phid", result.qd[1]), ("xdd", result.qdd[0])):
        assert_array_equal(dataset[name], row)
    assert_array_equal(dataset["power"], result.outputs["power"])
    assert_array_equal(dataset["multiplier_re"] + 1j * dataset["multiplier_im"], result.multipliers)
    assert dataset["x"].attrs == {"units": "m", "long_name": "slide"}
    assert dataset["phid"].attrs["units"] == "rad/s"
    assert dataset["xdd"].attrs["units"] == "m/s^2"
    assert dataset["time"].attrs["units"] == "s"
    assert dataset.attrs["speed"] == 3.0


def test_nc_file_equals_the_dataset(result, tmp_path):
    result.save(tmp_path / "orbit.nc")
    with xarray.open_dataset(tmp_path / "orbit.nc", engine="h5netcdf") as read:
        xarray.testing.assert_identical(read.load(), result.to_xarray())


@pytest.mark.parametrize("name", ["orbit", "orbit.txt", "none/orbit.csv", "."])
def test_invalid_file_name_is_refused_and_writes_nothing(result, tmp_path, name):
    with pytest.raises(FileError):
        result.save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_interrupted_save_leaves_no_file(tmp_path):
    file = tmp_path / "orbit.csv"
    file.write_text("before")

    def interrupted(stream):
        stream.write(b"half")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_atomic(file, interrupted)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("orbit.csv", "before")]
    write_atomic(file, lambda stream: stream.write(b"after"))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("orbit.csv", "after")]


def test_commands_save_all_file_types(tmp_path):
    from solve.commands.app import run

    problem = ["manipulator", "--method", "radau", "--steps", "64", "--json"]
    for kind in (".npz", ".csv", ".mat"):
        for command in ("periodic", "floquet"):
            file = tmp_path / f"{command}{kind}"
            assert run([command, *problem, "--save", str(file)]) == 0
            assert file.stat().st_size > 100
    header = (tmp_path / "floquet.csv").read_text().splitlines()[0]
    assert header == (
        "multiplier_re (1),multiplier_im (1),exponent_re (1/s),exponent_im (rad/s),multiplier_error (1),"
        "mode_frequency (rad/s),mode_order (1),participation (1)"
    )
    header = (tmp_path / "periodic.csv").read_text().splitlines()[0]
    assert header.startswith("time (s),phase (rad),q1 (rad),q2 (m),drive_torque (N m)")
