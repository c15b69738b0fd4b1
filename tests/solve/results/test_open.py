"""Results read from files: available functions, refused functions, and invalid files."""

import json
import math
import pickle
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest

import solve
from solve.errors import FileError, ReopenedError
from solve.results import serialization
from solve.results.serialization import CLASSES
from tests.solve.results.problems import SPEED, orbit, oscillators, x_of

PHASE = np.linspace(-7.0, 12.0, 1001)
ENDINGS = (".nc", ".npz")


@pytest.fixture(scope="module")
def first():
    return orbit()


@pytest.fixture(params=ENDINGS)
def again(request, first, tmp_path):
    first.save(tmp_path / f"orbit{request.param}")
    return solve.open(tmp_path / f"orbit{request.param}")


def test_new_process_opens_results_of_every_class(first, tmp_path):
    """Modules of results are usually imported when a function is first used."""
    first.save(tmp_path / "orbit.nc")
    solve.compare(oscillators(), SPEED, "gauss", [20], [0.1]).save(tmp_path / "comparison.npz")
    code = (
        "import sys, solve; print(*(type(solve.open(path)).__name__ for path in sys.argv[1:]));"
        "from solve.results.serialization import CLASSES; print(*CLASSES)"
    )
    command = [sys.executable, "-c", code, tmp_path / "orbit.nc", tmp_path / "comparison.npz"]
    opened, classes = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert opened == "Orbit Comparison"
    modules = {name: module for name, module in sys.modules.items() if name.startswith("solve.results.")}
    results = {name for name, kind in CLASSES.items() if hasattr(modules.get(kind.__module__), name)}
    assert len(results) > 10
    assert results <= set(classes.split())


def test_reopened_curve_equals_the_original_curve(first, again):
    np.testing.assert_array_equal(again.at(PHASE), first.at(PHASE))
    np.testing.assert_allclose(again.at(PHASE)[0], x_of(PHASE), rtol=1e-6)
    for ours, theirs in zip(again.state(PHASE), first.state(PHASE), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert again.harmonics("x", 300)[0].tobytes() == first.harmonics("x", 300)[0].tobytes()


def test_reopened_outputs_are_exact_at_nodes(first, again):
    np.testing.assert_array_equal(again.outputs["power"], first.outputs["power"])
    assert again.statistics("power") == first.statistics("power")
    assert again.harmonics("power")[0].tobytes() == first.harmonics("power")[0].tobytes()
    between = 5 / 384 * (2 * math.pi / 2048) ** 4 * 6**4 * first.statistics("power").max
    np.testing.assert_allclose(again.signal("power")(PHASE), first.signal("power")(PHASE), atol=between)


def test_reopened_result_refuses_requests_that_require_the_equations(again):
    for ask in (
        lambda: again.quasi_static.statistics("x"),
        lambda: again.certified,
        lambda: solve.floquet(again.system, SPEED),
        lambda: again.system.varied({"k": 1.0}),
    ):
        with pytest.raises(ReopenedError, match=r"^[^\n]*load the model and solve again$"):
            ask()
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        _ = again.colour


def test_labels_of_the_system_are_saved(again):
    system = oscillators()
    assert (again.system.labels.name, again.system.coordinates) == (system.labels.name, system.coordinates)
    assert dict(again.system.labels.units) == dict(system.labels.units)
    assert dict(again.system.labels.meanings) == dict(system.labels.meanings)


def test_chart_of_a_quantity_is_read_back(tmp_path):
    speeds, stiff = {"speed": ["200 rpm", "300 rpm"]}, {"k1": [8e4, 1e5]}
    chart = solve.chart(solve.load("cam"), speeds, stiff, boundaries=False, of="q3.max_abs", rtol=1e-5)
    chart.save(tmp_path / "chart.nc")
    read = solve.open(tmp_path / "chart.nc")
    assert read.of == chart.of
    assert read.values.tobytes() == chart.values.tobytes()
    assert read.record() == chart.record()


def test_reopened_chart_has_its_cuts_and_refuses_new_points(tmp_path):
    made = solve.chart("mathieu", "delta=0:5:7", "epsilon=0:5:7", 1.0).with_cuts([("epsilon", 1.0)])
    made.save(tmp_path / "chart.nc")
    read = solve.open(tmp_path / "chart.nc")
    assert read.cuts[0].crossings == made.cuts[0].crossings
    assert all(
        one.name == other.name and one.points.tobytes() == other.points.tobytes()
        for one, other in zip(read.boundaries, made.boundaries, strict=True)
    )
    for ask in (lambda: read.at(1.0, 1.0), lambda: read.cut(x=1.0)):
        with pytest.raises(ReopenedError, match="load the model and solve again"):
            ask()


def test_file_contains_model_parameters_and_versions(tmp_path):
    cam = solve.load("cam")
    solve.floquet(cam, "300 rpm").save(tmp_path / "cam.npz")
    read = solve.open(tmp_path / "cam.npz").record()
    assert read["model_hash"] == cam.module.FILE_SHA256
    assert (read["case"], read["parameters"]) == ("1", dict(cam.parameters))
    with np.load(tmp_path / "cam.npz") as arrays:
        assert "numpy" in json.loads(str(arrays["metadata"]))["versions"]


VALUES = (
    None,
    True,
    "text",
    -0.0,
    math.inf,
    0.1,
    2**60,
    1 - 2j,
    (1, [2.0, (3,)]),
    {1: "a", "b": [None]},
    np.array([[1.5, np.nan], [-0.0, np.inf]]),
    np.array([1 + 2j, -0j]),
    np.array([True, False]),
    np.arange(5, dtype=np.int8),
    np.array(["", "ρ", "b"]),
    np.array([["x", "y"], ["y", "x"]], dtype=object),
    np.zeros((0, 3)),
    np.array(1.25),
)


def same(one, other):
    if isinstance(one, np.ndarray):
        kept = one.dtype == other.dtype and one.shape == other.shape
        return kept and (
            one.tolist() == other.tolist() if one.dtype == object else one.tobytes() == other.tobytes()
        )
    if isinstance(one, tuple | list):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and repr(one) == repr(other)


def test_values_of_every_kind_are_restored_exactly():
    encoder = serialization._Encoder()
    encoded = json.loads(json.dumps([encoder.plain(value) for value in VALUES]))
    decoder = serialization._Decoder(encoder.arrays, [])
    for value, read in zip(VALUES, map(decoder.value, encoded), strict=True):
        assert same(value, read), value


def test_arrays_are_joined_by_type_and_format_1_is_readable():
    encoder = serialization._Encoder()
    encoded = [
        encoder.plain(value) for value in (np.arange(3.0), np.array([1 + 2j]), np.arange(4), 2.5 * np.ones(1))
    ]
    assert [array.tolist() for array in encoder.arrays] == [[0, 1, 2, 1, 2, 2.5], [0, 1, 2, 3]]
    assert [part[1:] for part in encoded][1] == [0, "<c16", [1], 3]
    before = serialization._Decoder([np.array([1.0, 2.0]), np.array([3.0])], [])
    assert before.value(["array", 0, "<c16", [1]]).tolist() == [1 + 2j]
    assert before.value(["array", 1, "<f8", []]) == 3.0


@pytest.mark.parametrize("ending", [".csv", ".mat"])
def test_exported_files_are_refused(first, tmp_path, ending):
    first.save(tmp_path / f"orbit{ending}")
    with pytest.raises(FileError, match=r"is an export, .* open the result's \.nc or \.npz$"):
        solve.open(tmp_path / f"orbit{ending}")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.nc", "there is no file"),
        ("orbit.txt", "is not a file of results; allowed: .nc, .npz"),
        ("orbit", "allowed"),
    ],
)
def test_other_file_names_are_refused(tmp_path, name, message):
    with pytest.raises(FileError, match=message):
        solve.open(tmp_path / name)


def foreign(folder):
    """Return files with a valid ending but other content."""
    folder.joinpath("text.nc").write_text("no result")
    folder.joinpath("empty.npz").write_bytes(b"")
    np.savez(folder / "other.npz", q=np.arange(3.0))
    np.savez(
        folder / "pickled.npz", allow_pickle=True, state=np.array([print], dtype=object), seal=np.zeros(32)
    )
    folder.joinpath("pickle.npz").write_bytes(pickle.dumps({"state": 1}))
    with zipfile.ZipFile(folder / "zip.npz", "w") as whole:
        whole.writestr("state.npy", "no array")
    with h5py.File(folder / "other.nc", "w") as whole:
        whole["state"] = np.arange(3.0)
    state = serialization.to_arrays(orbit())
    np.savez(folder / "changed.npz", **{**state, "state0": state["state0"] + 1e-9})
    return sorted(path for path in folder.iterdir() if path.is_file())


def test_files_of_other_programs_are_refused_in_one_line(tmp_path):
    files = foreign(tmp_path)
    assert len(files) == 8
    for file in files:
        with pytest.raises(FileError, match=r"^[^\n]*is not a result of this program, or is damaged[^\n]*$"):
            solve.open(file)


@pytest.mark.parametrize("ending", ENDINGS)
def test_damaged_files_are_refused_or_read_correctly(tmp_path, ending):
    """A truncated file is refused. A file with a changed byte is refused or gives the same result."""
    stability = solve.floquet(oscillators(), SPEED)
    file = tmp_path / f"result{ending}"
    stability.save(file)
    whole, record = file.read_bytes(), stability.record()
    for end in np.linspace(0, len(whole) - 1, 25).astype(int):
        file.write_bytes(whole[:end])
        with pytest.raises(FileError):
            solve.open(file)
    refused = 0
    for place in np.random.default_rng(1).integers(0, len(whole), 150):
        changed = bytearray(whole)
        changed[place] ^= 0x55
        file.write_bytes(changed)
        try:
            assert solve.open(file).record() == record
        except FileError:
            refused += 1
    assert refused > 10


def test_later_format_and_undefined_class_are_refused(tmp_path, monkeypatch):
    stability = solve.floquet(oscillators(), SPEED)
    stability.save(tmp_path / "now.npz")
    monkeypatch.setattr(serialization, "FORMAT", serialization.FORMAT + 1)
    stability.save(tmp_path / "later.npz")
    monkeypatch.undo()
    with pytest.raises(
        FileError,
        match=r"later\.npz' cannot be opened: it has format 3, and this version reads formats up to 2",
    ):
        solve.open(tmp_path / "later.npz")
    monkeypatch.delitem(serialization.CLASSES, "Stability")
    with pytest.raises(FileError, match=r"a result of class Stability, which no imported module defines"):
        solve.open(tmp_path / "now.npz")
