"""All cells of the table in docs/results.md are tested, and the examples run."""

import json
import re
import shlex
from html.parser import HTMLParser
from inspect import isclass, isfunction
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
from matplotlib.text import Text

import solve
from models.four_bar.__main__ import run as four_bar_command
from solve.commands.app import run as solve_command
from solve.results.result import Result
from tests.solve.results.every_result import EXAMPLES, cam, example, picture, saved

PAGE = (Path(__file__).parents[3] / "docs" / "results.md").read_text(encoding="utf-8")
SLOW = "corrections", "carry_out"


def is_print(result, _):
    lines = repr(result).splitlines()
    assert 2 <= len(lines) <= 15
    assert all(len(line) <= 80 for line in lines)


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


def is_html(result, _):
    tags = Tags()
    tags.feed(result._repr_html_())
    assert not tags.open
    assert result.model_info["model"] in tags.text


def is_xarray(result, _):
    dataset = result.to_xarray()
    about = json.loads(dataset.attrs["metadata"])
    assert about["parameters"] == pytest.approx(dict(result.model_info["parameters"]))
    assert about["case"] == result.model_info["case"]
    assert about["warnings"] == result.warnings
    assert set(about["versions"]) >= {"parametric-vibration", "numpy"}
    assert all(variable.attrs.get("units", "?") for variable in dataset.data_vars.values())


def is_pandas(result, _):
    table = result.to_pandas()
    dataset = result.to_xarray()
    assert len(table)
    for name in table.columns:
        np.testing.assert_array_equal(np.unique(table[name]), np.unique(dataset[name]))


def is_nc(result, _):
    import xarray

    with xarray.open_dataset(saved(result, ".nc"), engine="h5netcdf") as read:
        xarray.testing.assert_identical(read.load(), result.to_xarray())


def is_npz(result, _):
    with np.load(saved(result, ".npz"), allow_pickle=False) as arrays:
        for name, values in result.file_contents().numbers.items():
            np.testing.assert_array_equal(arrays[name], values)


def is_mat(result, folder):
    from scipy.io import loadmat

    result.save(folder / "result.mat")
    read = loadmat(folder / "result.mat")
    for name, values in result.file_contents().numbers.items():
        if values.dtype.kind in "fc":
            np.testing.assert_array_equal(read[name].ravel(), values.ravel())
    assert json.loads(str(read["metadata"][0]))["model"] == result.model_info["model"]


def is_csv(result, folder):
    result.save(folder / "result.csv")
    table = result.to_pandas()
    rows = (folder / "result.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + len(table)


def opened(result, folder, ending):
    """Check that text, figure and values of the reopened result are identical to the last bit."""
    again = solve.open(saved(result, ending))
    assert type(again) is type(result)
    assert again.record() == result.record()
    assert repr(again) == repr(result)
    assert again._repr_html_() == result._repr_html_()
    assert again.warnings == result.warnings
    assert again.to_xarray().identical(result.to_xarray())
    ours, theirs = again.file_contents().numbers, result.file_contents().numbers
    assert ours.keys() == theirs.keys()
    for name, values in theirs.items():
        assert ours[name].dtype == values.dtype
        assert ours[name].tobytes() == values.tobytes()
    return again


def is_open_nc(result, folder):
    again = opened(result, folder, ".nc")
    again.save(folder / "again.npz")
    assert solve.open(folder / "again.npz").record() == result.record()


def is_open_npz(result, folder):
    again = opened(result, folder, ".npz")
    for one, other in zip(again.plot().axes, picture(result).axes, strict=True):
        for line, before in zip(one.lines, other.lines, strict=True):
            np.testing.assert_array_equal(line.get_xydata(), before.get_xydata())


def is_plot(result, _):
    figure = picture(result)
    assert figure.axes
    assert any(axes.has_data() for axes in figure.axes)


def is_json(result, _):
    record = result.record()
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    assert record["model"] == result.model_info["model"]
    assert record["warnings"] == result.warnings


def command_of(name, cell):
    """Return the function that runs the command of a row, and its arguments."""
    program, words = cell.strip("`").split(" ", 1)
    run = solve_command
    if program == "python":
        run, words = four_bar_command, words.removeprefix("-m models.four_bar ")
    word, *flags = words.split()
    of_mathieu = name in {"solve.chart", "solve.bands", "solve.speed_sensitivities", "solve.special_curves"}
    model = [] if run is four_bar_command else ["mathieu" if of_mathieu else "cam"]
    return run, [word, *model, *flags, *shlex.split(EXAMPLES[name][1])]


def without_times(record):
    """Return a record without processor times, which differ between runs, and without choices that depend on
    them."""
    return {name: value for name, value in record.items() if name not in {"rows", "measured", "targets"}}


ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.splitlines()
    if line.startswith("|")
]
HEAD = ROWS[0]
TRIED = {name: globals()[f"is_{name.lower().replace(' ', '_').replace('.', '')}"] for name in HEAD[1:-1]}


def names():
    """Return the names of the results on the page."""
    return [re.match(r"`(.+?)`", row[0])[1] for row in ROWS[2:]]


def slowly(name):
    return pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name


def test_page_lists_all_results_with_all_functions():
    """Every public function of `solve` that is annotated to return a result has a row."""
    public = {name: getattr(solve, name) for name in solve.__all__}
    returned = {name: get_type_hints(each).get("return") for name, each in public.items() if isfunction(each)}
    results = {
        f"solve.{name}" for name, kind in returned.items() if isclass(kind) and issubclass(kind, Result)
    }
    assert {name for name in EXAMPLES if name.startswith("solve.")} == results
    assert set(names()) == set(EXAMPLES)
    for row in ROWS[2:]:
        assert row[1:-1] == ["yes"] * (len(HEAD) - 2)


@pytest.mark.parametrize("ability", HEAD[1:-1])
@pytest.mark.parametrize("name", [slowly(name) for name in names()])
def test_every_function_in_the_table_works(name, ability, tmp_path):
    TRIED[ability](example(name), tmp_path)


def test_chart_has_one_row_per_point():
    chart = example("solve.chart")
    table, dataset = chart.to_pandas(), chart.to_xarray()
    assert dataset["spectral_radius"].dims == ("epsilon", "delta")
    for row in table.itertuples():
        there = dataset["spectral_radius"].sel(epsilon=row.epsilon, delta=row.delta)
        assert float(there) == row.spectral_radius


@pytest.mark.parametrize("name", [slowly(name) for name in names()])
def test_every_command_saves_and_prints_the_result(name, tmp_path, capsys, monkeypatch):
    """The figure is inspected as an object; the tests of the commands draw it."""
    pictures = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: pictures.append(figure))
    cell = next(row[-1] for row in ROWS[2:] if row[0].startswith(f"`{name}`"))
    run, words = command_of(name, cell)
    file = tmp_path / "result.npz"
    assert run([*words, "--json", "--save", str(file), "--plot", str(tmp_path / "result.png")]) == 0
    printed, saved = json.loads(capsys.readouterr().out), solve.open(file)
    (drawn,) = pictures
    assert (tmp_path / "result.png").exists()
    assert saved.record()["parameters"] == printed["parameters"]
    if name not in {"solve.frequencies", "solve.frequencies_over"}:
        assert without_times(saved.record()) == without_times(printed)
        shows_the_unit_given(saved, drawn, words)


def shows_the_unit_given(result, drawn, words):
    """Check that speeds have the unit of the flags; rpm appears only together with it."""
    unit = next((text.split()[-1] for text in words if re.search(r"\d (Hz|rad/s)$", text)), None)
    if unit is None:
        return
    tags = Tags()
    tags.feed(result._repr_html_())
    beside = [line for line in tags.text.splitlines() if "rpm" in line]
    assert all(f"{unit} = " in line for line in beside)
    texts = [text.get_text() for text in drawn.findobj(Text)]
    assert not any("rpm" in text for text in [*texts, *result.warnings])
    assert any(unit in text for text in [*texts, tags.text])


def blocks():
    return re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


def test_examples_on_the_page_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    first, second = blocks()
    exec(first, {})
    namespace = {"__name__": "solve.results.example"}
    exec(second, namespace)
    phase = np.linspace(0.0, 1.0, 3)
    K = cam().at(phase, 10.0)[2]
    computed = namespace["Stiffness"](cam(), phase, np.linalg.eigvalsh(K)[:, -1])
    computed.save("stiffness.npz")
    assert solve.open("stiffness.npz").record() == computed.record()
    assert "phase (°)" in repr(computed)


def test_notebook_shows_a_result_once(monkeypatch):
    """In Jupyter, Rich displays printed output itself. The text form must then be empty."""
    shown = []
    stability = solve.floquet(solve.load("mathieu"), "1 rad/s")
    alone = repr(stability)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setattr("rich.jupyter.display", lambda *parts: shown.append(parts))
    assert repr(stability) == alone != ""
    assert shown == []
