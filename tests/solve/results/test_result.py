"""Every result: a few lines of itself, HTML, xarray, pandas and four files."""

import csv
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import solve

PAGE = Path(__file__).parents[3] / "docs" / "results.md"


def fitted(cam):
    with TemporaryDirectory() as folder:
        file = Path(folder) / "cam.csv"
        solve.periodic(cam, "300 rpm", steps=64).save(file)
        return solve.fit(cam.varied({"k1": 8.1e4}), file, ["k1", "c1"], speed="300 rpm")


MADE = {
    "orbit": lambda cam: solve.periodic(cam, "300 rpm"),
    "nonlinear orbit": lambda cam: solve.nonlinear(cam, "100 rpm", rtol=1e-6),
    "stability": lambda cam: solve.floquet(cam, "300 rpm"),
    "sweep": lambda cam: solve.sweep(cam, [30.0, 40.0]),
    "chart": lambda cam: solve.chart(
        cam, {"speed": [40.0, 50.0, 60.0]}, {"k3": [1e8, 2e8]}, boundaries=False
    ),
    "bands": lambda cam: solve.bands(cam, [30.0, 31.0]),
    "critical speeds": lambda cam: solve.critical_speeds(cam, [40.0, 45.0, 50.0]),
    "comparison": lambda cam: solve.compare(cam, "300 rpm", methods=["gauss"]),
    "frequencies": lambda cam: solve.frequencies(cam, [0.0, 1.0]),
    "frequencies over a parameter": lambda cam: solve.frequencies_over(cam, "k3", [1e8, 2e8], np.zeros(1)),
    "transient": lambda cam: solve.transient(cam, "100 rpm", 2),
    "fitted model": fitted,
    "sensitivities": lambda cam: solve.sensitivities(cam, "300 rpm", ["q3.max_abs", "rho1"], ["k1", "speed"]),
    "validity": lambda cam: solve.validity(cam, [10.0, 20.0]),
}


@pytest.fixture(scope="module")
def cam():
    return solve.load("cam")


@pytest.fixture(scope="module", params=MADE)
def result(request, cam):
    return MADE[request.param](cam)


def test_a_few_lines(result):
    lines = repr(result).splitlines()
    assert 2 <= len(lines) <= 15
    assert all(len(line) <= 80 for line in lines)
    assert lines[0].split() == ["model", "cam,", "case", "1"]


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.text = [], ""

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_html(result):
    tags = Tags()
    tags.feed(result._repr_html_())
    assert not tags.open
    assert "cam, case 1" in tags.text


def test_the_dataset_the_table_and_the_files_agree(result, tmp_path):
    import xarray
    from scipy.io import loadmat

    dataset, table = result.to_xarray(), result.to_pandas()
    assert dataset.attrs["model"] == "cam"
    assert set(table.columns) <= {*dataset.data_vars, *dataset.coords}
    for ending in (".nc", ".npz", ".mat", ".csv"):
        result.save(tmp_path / f"result{ending}")
    with xarray.open_dataset(tmp_path / "result.nc", engine="h5netcdf") as read:
        xarray.testing.assert_identical(read.load(), dataset)
    with np.load(tmp_path / "result.npz") as arrays:
        assert json.loads(str(arrays["metadata"]))["case"] == "1"
    assert "metadata" in loadmat(tmp_path / "result.mat")
    with (tmp_path / "result.csv").open(encoding="utf-8", newline="") as file:
        titles, *rows = csv.reader(file)
    assert [title.split(" (")[0] for title in titles] == list(table.columns)
    assert len(rows) == len(table)
    for name, column in zip(table.columns, zip(*rows, strict=True), strict=False):
        if table[name].dtype.kind == "f":
            np.testing.assert_array_equal(np.array(column, dtype=float), table[name])


def test_rows_of_a_chart_are_its_points(cam):
    chart = MADE["chart"](cam)
    table, dataset = chart.to_pandas(), chart.to_xarray()
    assert dataset["spectral_radius"].dims == ("k3", "speed")
    for row in table.itertuples():
        there = dataset["spectral_radius"].sel(k3=row.k3, speed=row.speed)
        assert float(there) == row.spectral_radius


def test_the_page_names_every_result_and_nothing_else(cam):
    rows = [line.split("|")[1:-1] for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| `")]
    named = {re.findall(r"`solve\.(\w+)", row[0])[0]: [cell.strip() for cell in row] for row in rows}
    made_by = {"nonlinear orbit": "nonlinear", "orbit": "periodic", "stability": "floquet"}
    made_by |= {"fitted model": "fit"}
    made_by |= {"comparison": "compare", "critical speeds": "critical_speeds"}
    made_by |= {"frequencies over a parameter": "frequencies_over"}
    assert set(named) == {made_by.get(name, name) for name in MADE}
    for cells in named.values():
        command = re.findall(r"`solve (\w+)", cells[1])[0]
        assert (Path(solve.__file__).parent / "commands" / f"{command}.py").is_file()
        assert "" not in cells
