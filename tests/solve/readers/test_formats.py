"""Matrices versus azimuth in .mat, .npz, netCDF and Matrix Market files: round trips, and invalid files."""

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse
import xarray

import solve
from solve.errors import FileError, MatricesError, ValueOutOfBoundsError
from solve.labels import speed_or_usual

COUNT = 16
PHASES = np.arange(COUNT) * 2 * np.pi / COUNT
RNG = np.random.default_rng(7)


def second_order():
    """Return M, C, K and d with the azimuth as the first axis."""
    c, s = np.cos(PHASES)[:, None, None], np.sin(PHASES)[:, None, None]
    base = np.random.default_rng(7).standard_normal((3, 2, 2))
    M = np.eye(2) + 0.1 * c * base[0]
    C = 0.2 * np.eye(2) + 0.1 * s * base[1]
    K = np.diag([4.0, 9.0]) + 0.3 * c * base[2]
    return {"M": M, "C": C, "K": K, "d": np.stack((np.cos(PHASES), np.sin(PHASES)), axis=1)}


def first_order():
    arrays = second_order()
    zero, one = np.zeros((COUNT, 2, 2)), np.broadcast_to(np.eye(2), (COUNT, 2, 2))
    inverse = np.linalg.inv(arrays["M"])
    A = np.block([[zero, one], [-inverse @ arrays["K"], -inverse @ arrays["C"]]])
    b = np.concatenate((np.zeros((COUNT, 2)), np.einsum("kij,kj->ki", inverse, arrays["d"])), axis=1)
    B, D = np.ones((COUNT, 4, 1)), np.zeros((COUNT, 3, 1))
    return {"A": A, "b": b, "B": B, "C": np.ones((COUNT, 3, 4)), "D": D}


NAMES = {
    "second": {"coordinates": np.array(["bending", "torsion"])},
    "first": {
        "states": np.array(["p", "q", "r", "s"]),
        "inputs": np.array(["force"]),
        "outputs": np.array(["y1", "y2", "y3"]),
    },
}
ARRAYS = {"second": second_order(), "first": first_order()}


def write(arrays, file):
    """Write arrays, whose first axis is the azimuth, in the format of the file ending with the conventions of
    its tools."""
    if file.suffix == ".npz":
        np.savez(file, **arrays)
    elif file.suffix == ".nc":
        variables = {
            name: ([f"{name}{axis}" for axis in range(np.ndim(values))], values)
            for name, values in arrays.items()
        }
        xarray.Dataset(variables).to_netcdf(file, engine="h5netcdf")
    else:
        content = {}
        for name, values in arrays.items():
            is_text = np.asarray(values).dtype.kind == "U"
            content[name] = (
                values.astype(object)
                if is_text
                else np.moveaxis(values, 0, -1)
                if np.ndim(values) > 1
                else values
            )
        scipy.io.savemat(file, content)


READERS = {".mat": solve.read_mat, ".npz": solve.read_npz, ".nc": solve.read_netcdf}


@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("kind", ["second", "first"])
def test_files_are_read_back_unchanged(tmp_path, ending, kind):
    arrays, file = ARRAYS[kind], tmp_path / f"machine{ending}"
    write({**arrays, **NAMES[kind], "speed": 2.5}, file)
    system = READERS[ending](file)
    assert system.coordinates == tuple(NAMES[kind]["coordinates" if kind == "second" else "states"])
    assert speed_or_usual(system, None) == 2.5
    assert system.labels.name == f"machine{ending}"
    found = system.at(PHASES, 2.5) if kind == "second" else system.equations_at(PHASES, 2.5)
    order = "MCKd" if kind == "second" else "AbBCD"
    for name, values in zip(order, found, strict=True):
        np.testing.assert_allclose(values, arrays[name], atol=1e-13, err_msg=name)


def test_first_and_second_order_files_give_the_same_solution(tmp_path):
    results = []
    for kind in ARRAYS:
        write(ARRAYS[kind], tmp_path / f"{kind}.npz")
        results.append(solve.periodic(solve.read_npz(tmp_path / f"{kind}.npz", "2.5 rad/s"), 2.5))
    np.testing.assert_allclose(results[0].multipliers, results[1].multipliers, atol=1e-6)
    np.testing.assert_allclose(results[0].at(0.3)[0], results[1].at(0.3)[0][:2], atol=1e-4)


def test_packed_netcdf_variables_are_unpacked(tmp_path):
    """Integers k stand for 0.001 k - 2; the speed is packed as a scalar with an offset only."""
    integers = np.round((ARRAYS["second"]["K"] + 2) / 1e-3).astype(np.int32)
    packed = {"scale_factor": 1e-3, "add_offset": -2.0}
    axes = "azimuth", "row", "column"
    variables = {
        "M": (axes, ARRAYS["second"]["M"]),
        "K": (axes, integers, packed),
        "speed": ((), np.int16(3), {"add_offset": 1.0, "units": "rad s-1"}),
    }
    xarray.Dataset(variables).to_netcdf(tmp_path / "p.nc", engine="h5netcdf")
    system = solve.read_netcdf(tmp_path / "p.nc")
    assert system.labels.case_speed == "4.0 rad/s"
    np.testing.assert_allclose(system.at(PHASES, 4.0)[2], integers * 1e-3 - 2, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "attributes", "words"),
    [
        ("M", {"missing_value": 1.0}, "M has NaN"),
        ("phase", {"units": "degrees"}, "phase has the units 'degrees'; write it in rad"),
        ("speed", {"units": "rpm"}, "speed has the units 'rpm'; write it in rad/s"),
    ],
)
def test_missing_values_and_other_units_of_netcdf_are_refused(tmp_path, name, attributes, words):
    phase = np.arange(8) * np.pi / 4
    variables = {
        "M": (("azimuth", "row", "column"), np.ones((8, 1, 1))),
        "K": (("azimuth", "row", "column"), 4 + np.cos(phase)[:, None, None]),
        "phase": ("azimuth", phase),
        "speed": ((), 2.0),
    }
    dataset = xarray.Dataset(variables)
    dataset[name].attrs.update(attributes)
    dataset.to_netcdf(tmp_path / "m.nc", engine="h5netcdf")
    with pytest.raises(FileError, match=words):
        solve.read_netcdf(tmp_path / "m.nc")


def test_exported_model_is_read_back(tmp_path):
    cam, file = solve.load("cam"), tmp_path / "cam.mat"
    solve.export(cam, file, "600 rpm", samples=256)
    read = solve.read_mat(file)
    assert read.coordinates == cam.coordinates
    expected = solve.floquet(cam, "600 rpm").multipliers
    np.testing.assert_allclose(solve.floquet(read, "600 rpm").multipliers, expected, atol=1e-7)


def test_exported_coordinates_keep_their_names(tmp_path):
    crane = solve.PeriodicSystem.from_samples(
        *(ARRAYS["second"][name] for name in "MCKd"), ["trolley", "hook"]
    )
    solve.export(crane, tmp_path / "crane.mat", 2.5)
    assert solve.read_mat(tmp_path / "crane.mat").coordinates == ("trolley", "hook")


def lagged_inflow(phase, speed):
    one = np.ones(len(phase))
    M = one[:, None, None] * np.diag([2.0, 0.0])
    C = one[:, None, None] * np.array([[0.3, 0.0], [0.4, 1.5]])
    K = np.array([[4.0, -1.0], [0.2, 1.0]]) + 0.3 * np.cos(phase)[:, None, None]
    return M, C, K, np.stack((np.cos(phase), 1 + np.sin(2 * phase)), axis=1)


MIXED = solve.MixedSystem(lagged_inflow, ["flap"], ["inflow"])
STATES = solve.FirstOrderSystem.from_samples(ARRAYS["first"]["A"], ARRAYS["first"]["b"], ["a", "b", "c", "d"])


@pytest.mark.parametrize("system", [MIXED, STATES], ids=["mixed", "first order"])
def test_exported_first_order_states_are_read_back(tmp_path, system):
    solve.export(system, tmp_path / "s.mat", 1.3, samples=32)
    read = solve.read_mat(tmp_path / "s.mat")
    phase = np.array([0.4, 3.0, 5.5])
    expected, found = solve.periodic(system, 1.3), solve.periodic(read, 1.3)
    np.testing.assert_allclose(found.multipliers, expected.multipliers, atol=1e-9)
    rows = [read.states.index(name) for name in system.coordinates]
    np.testing.assert_allclose(found.at(phase)[rows], expected.at(phase), atol=1e-7)


def test_single_azimuth_is_not_taken_for_constant_matrices(tmp_path):
    solve.export(solve.load("cam"), tmp_path / "cam.mat", "600 rpm", samples=1)
    np.savez(tmp_path / "one.npz", M=np.eye(1), K=np.eye(1), phase=[0.3])
    for file in ("cam.mat", "one.npz"):
        with pytest.raises(MatricesError, match="1 azimuth does not determine any harmonic"):
            solve.load(str(tmp_path / file))


def test_irregular_azimuths_and_constant_matrices_are_read(tmp_path):
    phases = np.sort(RNG.uniform(0, 2 * np.pi, 21))
    K = 4 + 0.5 * np.cos(phases)
    np.savez(tmp_path / "k.npz", M=np.eye(1), K=K[:, None, None], phase=phases)
    system = solve.read_npz(tmp_path / "k.npz")
    at = np.array([0.1, 2.0, 5.0])
    np.testing.assert_allclose(system.at(at, 1.0)[2][:, 0, 0], 4 + 0.5 * np.cos(at), atol=1e-9)
    np.testing.assert_allclose(system.at(at, 1.0)[0], np.ones((3, 1, 1)), atol=1e-12)


def test_vector_is_a_constant_load(tmp_path):
    """In .mat files, SciPy writes a vector as a row."""
    arrays = {"M": np.eye(2), "K": np.diag([4.0, 9.0]), "d": np.array([1.0, 2.0])}
    scipy.io.savemat(tmp_path / "a.mat", arrays)
    np.savez(tmp_path / "a.npz", **arrays)
    for read in (solve.read_mat(tmp_path / "a.mat"), solve.read_npz(tmp_path / "a.npz")):
        np.testing.assert_array_equal(read.at(np.array([0.0, 2.0]), 1.0)[3], [[1.0, 2.0]] * 2)


def test_signals_of_a_first_order_system_require_all_matrices(tmp_path):
    np.savez(tmp_path / "a.npz", A=-np.eye(2), B=np.ones((2, 1)))
    with pytest.raises(FileError, match="has no C; give all of B, C and D, or none"):
        solve.read_npz(tmp_path / "a.npz")


def test_coordinates_with_states_form_a_mixed_system(tmp_path):
    M = np.diag([1.0, 0.0])
    C, K = np.array([[0.1, 0.0], [0.0, 0.5]]), np.array([[4.0, -1.0], [0.2, 1.0]])
    file = tmp_path / "mixed.npz"
    np.savez(file, M=M, C=C, K=K, coordinates=["q"], states=["x"])
    assert solve.floquet(solve.read_npz(file), 1.0).multipliers.shape == (3,)


def bad(name, **changes):
    """Write a second-order file with some arrays changed; None removes an array."""
    arrays = {**ARRAYS["second"], **changes}
    return {key: value for key, value in arrays.items() if value is not None}


BAD = {
    "no K": (bad("no K", K=None), "has no K"),
    "nothing": ({"x": np.ones(3)}, "give M and K, or A"),
    "vector": (bad("vector", K=np.ones(3)), "expected"),
    "shape": (bad("shape", C=np.ones((COUNT, 2, 3))), "C has 2 × 3 entries; expected 2 × 2"),
    "load": (bad("load", d=np.ones((COUNT, 5))), "d has shape"),
    "complex": (bad("complex", K=1j * ARRAYS["second"]["K"]), "expected real numbers"),
    "NaN": (bad("NaN", K=np.nan * ARRAYS["second"]["K"]), "NaN or infinite"),
    "two speeds": (bad("speeds", speed=np.ones(2)), "expected one"),
    "negative speed": (bad("speed", speed=-1.0), "finite speed"),
    "names": (bad("names", coordinates=np.array(["a"])), "expected 2, one for each row"),
}


@pytest.mark.parametrize("ending", [".mat", ".npz"])
@pytest.mark.parametrize(("arrays", "expected"), BAD.values(), ids=BAD)
def test_inconsistent_arrays_are_refused_in_one_line(tmp_path, ending, arrays, expected):
    file = tmp_path / f"bad{ending}"
    write(arrays, file)
    with pytest.raises(FileError, match=f"bad{ending}") as refused:
        READERS[ending](file)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("ending", READERS)
def test_files_of_other_kinds_are_refused_in_one_line(tmp_path, ending):
    file = tmp_path / f"damaged{ending}"
    file.write_bytes(b"not a file of this kind" * 20)
    with pytest.raises(FileError, match="damaged") as refused:
        READERS[ending](file)
    assert "\n" not in str(refused.value)
    with pytest.raises(FileError, match="there is no file"):
        READERS[ending](tmp_path / f"none{ending}")
    with pytest.raises(FileError, match="ends in"):
        READERS[ending](tmp_path / "none.txt")


def test_pickles_are_not_loaded(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was executed",))

    np.savez(tmp_path / "trap.npz", M=np.array([Trap()], dtype=object), K=np.eye(1))
    with pytest.raises(FileError, match="cannot be read"):
        solve.read_npz(tmp_path / "trap.npz")


def write_matrix_market(folder, symbols="MCKd"):
    arrays = ARRAYS["second" if "K" in symbols else "first"]
    for symbol in symbols:
        for k, values in enumerate(arrays[symbol]):
            matrix = np.atleast_2d(values).T if values.ndim == 1 else values
            sparse = scipy.sparse.coo_array(matrix) if symbol == "K" else matrix
            scipy.io.mmwrite(folder / f"run.{symbol}.{k:03d}.mtx", sparse, precision=17)
    return str(folder / "run.*.mtx")


@pytest.mark.parametrize("symbols", ["MCKd", "AbBCD"])
def test_matrix_market_files_are_read_back(tmp_path, symbols):
    system = solve.read_matrix_market(write_matrix_market(tmp_path, symbols), "2.5 rad/s")
    kind = "second" if "K" in symbols else "first"
    found = system.at(PHASES, 2.5) if kind == "second" else system.equations_at(PHASES, 2.5)
    for name, values in zip(symbols, found, strict=True):
        np.testing.assert_allclose(values, ARRAYS[kind][name], atol=1e-13, err_msg=name)
    assert system.labels.name == "run"


def test_matrix_market_reader_accepts_names_and_azimuths(tmp_path):
    scipy.io.mmwrite(tmp_path / "M.mtx", np.eye(1))
    phases = [0.0, 1.0, 2.5, 4.0, 5.5]
    for number, phase in enumerate(phases):
        scipy.io.mmwrite(tmp_path / f"K{number}.mtx", np.array([[4 + np.cos(phase)]]), precision=17)
    files = sorted(tmp_path.glob("*.mtx"))
    system = solve.read_matrix_market(files, 1.0, phases, ["bending"])
    assert system.coordinates == ("bending",)
    np.testing.assert_allclose(system.at(np.array([3.0]), 1.0)[2], [[[4 + np.cos(3.0)]]], atol=1e-12)


def test_inconsistent_matrix_market_files_are_refused(tmp_path):
    pattern = write_matrix_market(tmp_path)
    (tmp_path / "run.K.003.mtx").unlink()
    with pytest.raises(FileError, match="same azimuths"):
        solve.read_matrix_market(pattern)
    (tmp_path / "run.K.003.mtx").write_text("%%MatrixMarket matrix array real general\n2 2\n1\n2\n")
    with pytest.raises(FileError, match=r"run\.K\.003\.mtx.* cannot be read"):
        solve.read_matrix_market(pattern)
    scipy.io.mmwrite(tmp_path / "run.K.003.mtx", np.eye(3))
    with pytest.raises(FileError, match="matrices of different sizes"):
        solve.read_matrix_market(pattern)
    with pytest.raises(ValueOutOfBoundsError, match=r"paths is \[3\]"):
        solve.read_matrix_market([3])  # type: ignore[list-item]
    (tmp_path / "run.other.mtx").write_text("")
    with pytest.raises(FileError, match="lacks the symbol"):
        solve.read_matrix_market(pattern)


@pytest.mark.parametrize("count", [7, 22, 100])
def test_files_numbered_by_rounded_degrees_are_read(tmp_path, count):
    phase = 2 * np.pi * np.arange(count) / count
    scipy.io.mmwrite(tmp_path / "run.M.mtx", np.eye(1))
    for angle in phase:
        stiffness = np.array([[5 + np.cos(angle)]])
        scipy.io.mmwrite(tmp_path / f"run.K.{round(np.degrees(angle))}.mtx", stiffness)
    system = solve.read_matrix_market(str(tmp_path / "run.*.mtx"))
    np.testing.assert_allclose(system.at(np.array([0.7]), 1.0)[2].ravel(), 5 + np.cos(0.7), rtol=1e-12)


@pytest.mark.parametrize(
    "units",
    [
        {"phase": "1", "speed": "rad.s-1"},
        {"phase": "radian", "speed": "radians per second"},
        {"phase": np.array(["rad"], dtype=object), "speed": np.bytes_("rad/sec")},
        {"phase": h5py.Empty("S1")},
    ],
)
def test_spellings_of_radians_in_netcdf_are_read(tmp_path, units):
    phase = np.arange(8) * np.pi / 4
    with h5py.File(tmp_path / "s.nc", "w") as file:
        file["M"], file["K"] = np.eye(1), 4 + np.cos(phase)[:, None, None]
        file["phase"], file["speed"] = phase, 2.0
        for name, unit in units.items():
            file[name].attrs["units"] = unit
    assert solve.read_netcdf(tmp_path / "s.nc").labels.case_speed == "2.0 rad/s"


def test_empty_phase_of_constant_matrices_is_ignored(tmp_path):
    scipy.io.savemat(tmp_path / "e.mat", {"M": np.eye(2), "K": 3 * np.eye(2), "phase": np.zeros((0, 0))})
    assert solve.read_mat(tmp_path / "e.mat").n == 2


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["M", "K.0", "K.33", "K.98", "K.131"], "not equidistant: 33 is followed by 98"),
        (["M", "K.1", "K.2", "K.3", "K.5"], "not equidistant: 3 is followed by 5"),
        (["M.1", "M.2", "M.3", "K.1", "K.2", "K.4"], "a file with number 3"),
        (["M.1", "M.2", "M.3", "K.2"], "the numbered files are 1 file of K, 3 files of M"),
        (["M", "K", "K.1", "K.2"], "has no number, but other files of K do"),
    ],
)
def test_missing_azimuths_are_refused(tmp_path, names, message):
    for name in names:
        scipy.io.mmwrite(tmp_path / f"run.{name}.mtx", np.eye(1))
    with pytest.raises(FileError, match=message):
        solve.read_matrix_market(str(tmp_path / "run.*.mtx"))


def test_wrong_number_of_azimuths_is_refused(tmp_path):
    np.savez(tmp_path / "p.npz", **ARRAYS["second"], phase=PHASES[:-1])
    with pytest.raises(MatricesError, match="phases"):
        solve.read_npz(tmp_path / "p.npz")
