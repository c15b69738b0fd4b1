"""Loading of models by name and by path: options, parameters, cases, and invalid generated code."""

import hashlib
import math
import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import solve
from solve.errors import (
    CaseFileError,
    MatricesError,
    MissingValueError,
    ModelFileError,
    UnitError,
    UnknownNameError,
    ValueOutOfBoundsError,
)
from solve.model.generated import ROOT, model_names

MECHANISM = "# what this mechanism is\n"
HEAD = """
import math
import casadi

MECHANISM_SHA256 = "{sha256}"
"""
BODY = '''NAME, TITLE = "mine", "A mass on a modulated spring"
COORDINATES = (("q", "m", "deflection"), ("r", "m", "second mode"))
PARAMETERS = (
    ("k", "N/m", "spring", "> 0"), ("z", "1", "teeth", "integer, >= 1"), ("c", "N s/m", "damper", ""),
)
OPTIONS = (("load", ("constant", "none"), "constant"), ("modes", range(1, 3), 1))
OUTPUTS = {outputs}
LIMITS = (("force", "<= 1.2", "the spring yields"),) if OUTPUTS else ()
VALIDITY = {{"q": 0.3}}
PERIOD = math.pi

def linearised(*, load="constant", modes=1):
    phase, speed, p = casadi.SX.sym("phase"), casadi.SX.sym("speed"), casadi.SX.sym("p", 3)
    one = casadi.SX.eye(modes)
    d = (load == "constant") * casadi.SX.ones(modes)
    K = (p[0] + casadi.cos(2 * phase)) * one
    return casadi.Function("linearised", [phase, speed, p], [one, p[2] * one, K, d],
                           ["phase", "speed", "p"], ["M", "C", "K", "d"])

def outputs(*, load="constant", modes=1):
    names = ["phase", "speed", "q", "qd", "qdd", "p"]
    sizes = [1, 1, modes, modes, modes, 3]
    inputs = [casadi.SX.sym(name, size) for name, size in zip(names, sizes)]
    force = [inputs[-1][0] * inputs[2][0]] if OUTPUTS else []
    return casadi.Function("outputs", inputs, force, names, [name for name, _, _ in OUTPUTS])
'''  # fmt: skip
FORCE = '(("force", "N", "in the spring"),)'
CASES = """
[case.soft]
speed = "3 rad/s"
[case.soft.parameters]
k = { value = 5, unit = "N/m", source = "chosen" }
z = { value = 3, unit = "1", source = "chosen" }
c = { value = 0.4, unit = "N s/m", source = "chosen" }
[case.stiff.parameters]
k = { value = 0.05, unit = "kN/m", source = "chosen" }
z = { value = 3, unit = "1", source = "chosen" }
"""
VALUES = {"k": 5.0, "z": 3, "c": 0.4}


def hashed(head, body):
    """Return generated text with its hash before the body."""
    return f'{head}FILE_SHA256 = "{hashlib.sha256((head + body).encode()).hexdigest()}"\n{body}'


class Folder:
    def __init__(self, path):
        self.mechanism = path / "mine.py"
        self.generated = path / "generated" / "mine.py"
        self.cases = path / "mine.toml"
        self.generated.parent.mkdir()
        self.mechanism.write_text(MECHANISM, encoding="utf-8")
        self._version = 0

    def generate(self, outputs=FORCE, text=None, body=lambda text: text):
        head = HEAD.format(sha256=hashlib.sha256(MECHANISM.encode()).hexdigest())
        self.generated.write_text(text or hashed(head, body(BODY.format(outputs=outputs))), encoding="utf-8")
        self._version += 1
        os.utime(self.generated, (self._version, self._version))

    def load(self, *names, **values):
        return solve.load(str(self.mechanism), *names, **values)


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path)


@pytest.fixture
def ready(folder):
    folder.generate()
    folder.cases.write_text(CASES, encoding="utf-8")
    return folder


def test_user_model_with_cases_is_loaded(ready):
    model = ready.load()
    assert (model.labels.name, model.labels.case, model.coordinates) == ("mine", "soft", ("q",))
    assert model.parameters == VALUES
    assert (model.period, model.labels.units["q"], model.labels.units["force"]) == (math.pi, "m", "N")
    assert model.labels.case_speed == "3 rad/s"
    assert ready.load("stiff", c=1).parameters == {"k": 50.0, "z": 3.0, "c": 1.0}


def test_matrices_match_the_generated_functions(ready):
    phase = np.linspace(-7.0, 7.0, 601)
    M, C, K, d = ready.load(options={"modes": 2, "load": "none"}, k=7.0).at(phase, 1.0)
    np.testing.assert_array_equal(M, np.broadcast_to(np.eye(2), (601, 2, 2)))
    np.testing.assert_allclose(K[:, 1, 1], 7.0 + np.cos(2 * phase), rtol=1e-14)
    assert not K[:, 0, 1].any()
    assert (C[:, 0, 0] == 0.4).all()
    assert not d.any()
    assert [part.shape for part in ready.load().at(phase[:0], 1.0)] == [(0, 1, 1)] * 3 + [(0, 1)]


def test_models_share_functions_of_the_same_code_and_options_only(ready, tmp_path):
    model, phase = ready.load(), np.linspace(0.0, 3.0, 7)
    K, shared = model.at(phase, 1.0)[2], model.setup.function("linearised")
    assert model.varied({"k": 7.0}).setup.function("linearised") is shared
    assert ready.load(options={"modes": 2}).setup.function("linearised") is not shared
    other = tmp_path / "other"
    other.mkdir()
    same_name = Folder(other)
    for folder in (same_name, ready):
        folder.generate(body=lambda body: body.replace("casadi.cos(2 * phase)", "casadi.cos(4 * phase)"))
        difference = folder.load(**VALUES).at(phase, 1.0)[2] - K
        np.testing.assert_allclose(difference[:, 0, 0], np.cos(4 * phase) - np.cos(2 * phase), atol=1e-14)
    np.testing.assert_array_equal(model.varied({"k": 5.0}).at(phase, 1.0)[2], K)


def test_outputs_validity_and_limits_follow_the_orbit(ready):
    orbit = solve.periodic(ready.load(), "3 rad/s")
    np.testing.assert_allclose(orbit.outputs["force"], 5.0 * orbit.q[0], rtol=1e-14)
    exceeding = solve.periodic(ready.load(k=2.0), 3.0).warnings
    assert any("linearisation may be invalid: max|q| = " in text for text in exceeding)
    assert any("beyond 0.3" in text for text in exceeding)
    tight = solve.periodic(ready.load("stiff", c=0.1, k=60.0), 3.0).warnings
    assert tight == []


def test_exceeded_limit_raises_its_warning(ready):
    warned = solve.periodic(ready.load(), 0.1).warnings
    assert any(
        text.startswith("the spring yields: force reaches ") and "bound <= 1.2" in text for text in warned
    )


def test_model_may_have_no_outputs(folder):
    folder.generate(outputs="()")
    orbit = solve.periodic(folder.load(**VALUES), 3.0)
    assert orbit.outputs == {}
    assert orbit.steps > 0


def test_parameters_may_replace_a_case_file(folder):
    folder.generate()
    assert folder.load(**VALUES).parameters == VALUES
    with pytest.raises(
        MissingValueError, match=r"^mine has no case and gives no value for c; .* set it: c=NUMBER"
    ):
        folder.load(k=5.0, z=3)
    with pytest.raises(CaseFileError, match=r"no case file '.*mine.toml' for case 'soft'"):
        folder.load("soft", **VALUES)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"k": -1.0}, r"k \(spring\) is -1 N/m; allowed: > 0"),
        ({"k": math.nan}, r"k \(spring\) is nan N/m; allowed: > 0"),
        ({"c": math.inf}, r"c \(damper\) is inf N s/m; allowed: any finite number"),
        ({"z": 2.5}, r"z \(teeth\) is 2.5; allowed: integer, >= 1"),
        ({"z": 0}, r"z \(teeth\) is 0; allowed: integer, >= 1"),
        ({"k": "soft"}, r"k \(spring\) is 'soft'; give a number in N/m"),
        ({"k": None}, r"k \(spring\) is None; give a number in N/m"),
    ],
)
def test_parameters_out_of_bounds_are_refused(ready, values, message):
    with pytest.raises(ValueOutOfBoundsError, match=message):
        ready.load(**values)


@pytest.mark.parametrize("given", ["0.05 kN/m", "0.05kN/m", "50", "5e-2N/mm"])
def test_parameters_may_be_text_with_a_unit(ready, given):
    assert ready.load(k=given).parameters["k"] == pytest.approx(50.0, rel=1e-15)
    assert ready.load().varied({"k": given}).parameters["k"] == pytest.approx(50.0, rel=1e-15)


@pytest.mark.parametrize("given", ["5 kg", "5 bananas"])
def test_units_of_another_dimension_are_refused(ready, given):
    with pytest.raises(UnitError, match=r"k: unit '.*' does not convert to 'N/m'"):
        ready.load(k=given)


def test_unknown_parameters_and_cases_suggest_the_nearest_name(ready):
    with pytest.raises(UnknownNameError, match="unknown parameter of mine 'kk'; did you mean 'k'"):
        ready.load(kk=1.0)
    with pytest.raises(UnknownNameError, match="unknown case of mine 'sotf'; did you mean 'soft'"):
        ready.load("sotf")
    with pytest.raises(MissingValueError, match="case 'stiff' of mine gives no value for c"):
        ready.load("stiff")


@pytest.mark.parametrize(
    ("option", "chosen"), [({"modes": 2}, 2), ({"modes": "2"}, 2), ({"modes": np.int64(2)}, 2), ({}, 1)]
)
def test_options_with_a_range_accept_integers(ready, option, chosen):
    model = ready.load(options=option)
    assert model.n == model.labels.options["modes"] == chosen
    assert type(model.labels.options["modes"]) is int


@pytest.mark.parametrize("value", [0, 3, "3", "--2", "²", "x", "", "1.0", 2.0, True, 1.5])
def test_options_out_of_range_are_refused(ready, value):
    with pytest.raises(
        ValueOutOfBoundsError, match=r"option modes of mine is .*; allowed: a whole number from 1 to 2"
    ):
        ready.load(options={"modes": value})


def test_unknown_options_and_values_are_refused(ready):
    with pytest.raises(UnknownNameError, match="unknown option of mine 'laod'; did you mean 'load'"):
        ready.load(options={"laod": "none"})
    with pytest.raises(UnknownNameError, match="unknown value of option load 'non'; did you mean 'none'"):
        ready.load(options={"load": "non"})


@pytest.mark.parametrize("name", ["cam", "gear_pair"])
def test_generated_code_instead_of_a_mechanism_is_refused(name, tmp_path):
    generated = tmp_path / "generated" / f"{name}.py"
    generated.parent.mkdir()
    shutil.copy(ROOT / "generated" / f"{name}.py", generated)
    with pytest.raises(ModelFileError, match=rf"is generated code; give its mechanism, .*'{tmp_path / name}"):
        solve.load(str(generated))


def test_message_about_missing_code_states_the_command(folder):
    with pytest.raises(
        ModelFileError, match=r"no generated code for '(.*mine.py)'; run: python -m derive \1"
    ):
        folder.load()


def test_message_about_stale_code_states_the_command(ready):
    ready.mechanism.write_bytes(MECHANISM.replace("\n", "\r\n").encode())
    assert ready.load().labels.name == "mine"
    ready.mechanism.write_text(MECHANISM + "# more\n", encoding="utf-8")
    with pytest.raises(
        ModelFileError, match=r"has changed since its code was generated; run: python -m derive "
    ):
        ready.load()


@pytest.mark.parametrize("name", ["mine.py", "generated/mine.py"])
def test_message_names_an_unreadable_file(ready, name, monkeypatch):
    read, target = Path.read_text, ready.mechanism.parent / name

    def forbidden(path, *given, **named):
        if path.resolve() == target.resolve():
            raise PermissionError(13, "Permission denied", str(path))
        return read(path, *given, **named)

    monkeypatch.setattr(Path, "read_text", forbidden)
    with pytest.raises(ModelFileError, match=f"{name}' cannot be read: permission denied; make it readable"):
        ready.load()


CODES = ["x = 1", "def broken(", "import no_such_module_at_all", "raise SystemError"]


@pytest.mark.parametrize("text", [*CODES, *(hashed("", code) for code in CODES)])
def test_file_other_than_generated_code_is_refused(folder, text):
    folder.generate(text=text)
    with pytest.raises(ModelFileError, match=r"mine.py' is not generated code \(.*\); move it away"):
        folder.load(**VALUES)


@pytest.mark.parametrize("where", ["first", "above the seal", "second seal", "last"])
def test_code_inserted_into_the_file_is_not_executed(ready, tmp_path, where):
    text, planted = ready.generated.read_text(encoding="utf-8"), f"open({str(tmp_path / 'ran')!r}, 'w')\n"
    checksum = next(line for line in text.splitlines(keepends=True) if line.startswith("FILE_SHA256"))
    changed = {
        "first": planted + text,
        "above the seal": text.replace(checksum, planted + checksum),
        "second seal": text.replace(checksum, checksum + planted + checksum),
        "last": text + planted,
    }[where]
    ready.generate(text=changed)
    with pytest.raises(ModelFileError, match=r"was edited|no hash"):
        ready.load()
    ready.generate(text=changed.replace(checksum, ""))
    with pytest.raises(ModelFileError, match="no hash"):
        ready.load()
    assert not (tmp_path / "ran").exists()


def test_edited_code_is_refused_regardless_of_line_endings(ready):
    text = ready.generated.read_text(encoding="utf-8")
    ready.generate(text=text.replace("\n", "\r\n"))
    assert ready.load().labels.name == "mine"
    ready.generate(text=text.replace("casadi.cos(2 * phase)", "casadi.cos(4 * phase)"))
    with pytest.raises(ModelFileError, match=r"was edited; regenerate it with the command in its header"):
        ready.load()


def test_byte_order_mark_does_not_make_code_stale(ready):
    ready.mechanism.write_text(MECHANISM, encoding="utf-8-sig")
    ready.cases.write_text(CASES, encoding="utf-8-sig")
    assert ready.load().labels.case == "soft"


def test_path_objects_name_mechanism_files_and_matrix_files(ready, tmp_path):
    assert solve.load(ready.mechanism).parameters == ready.load().parameters
    one, file = np.ones((4, 1, 1)), tmp_path / "system.npz"
    np.savez(file, M=one, C=0 * one, K=4 * one, d=one[:, 0])
    assert solve.load(file).n == 1


def test_changed_mechanism_of_the_package_is_detected(ready, tmp_path, monkeypatch):
    folder = tmp_path / "models" / "mine"
    folder.mkdir(parents=True)
    ready.mechanism.rename(folder / "mechanism.py")
    ready.cases.rename(folder / "cases.toml")
    monkeypatch.setattr(sys.modules["solve.model.generated"], "ROOT", tmp_path)
    assert solve.load("mine").labels.name == "mine"
    (folder / "mechanism.py").write_text(MECHANISM + "# more\n", encoding="utf-8")
    with pytest.raises(ModelFileError, match=r"'mine' has changed .*; run: python -m derive mine"):
        solve.load("mine")


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ("casadi.sin(2 * phase + 1)", "M is not positive definite at phase 1.0.*signs in the kinetic energy"),
        ("-1", "M is not positive definite at phase 0.0.*signs in the kinetic energy"),
        ("2 + casadi.sin(3 * phase)", "M is not periodic: it changes by 2 over the period 3.14159"),
    ],
)
def test_impossible_matrices_are_refused(ready, matrix, message):
    ready.generate(body=lambda body: body.replace("[one, p[2]", f"[({matrix}) * one, p[2]"))
    with pytest.raises(MatricesError, match=message):
        solve.floquet(ready.load(), "3 rad/s")


@pytest.mark.parametrize(
    ("bound", "computed"),
    [
        ("> -1, < 0.25", ["x: force reaches 1.", "bound < 0.25"]),
        (">= 0.9, < 9", ["x: force reaches 0.8", "bound >= 0.9"]),
    ],
)
def test_two_sided_limit_warns_about_the_violated_side(ready, bound, computed):
    ready.generate(body=lambda body: body.replace('"<= 1.2", "the spring yields"', f'"{bound}", "x"'))
    warned = [text for text in solve.periodic(ready.load(), 0.1).warnings if text.startswith("x")]
    assert len(warned) == 1
    assert all(part in warned[0] for part in computed)


def test_regenerated_code_is_read_again(ready):
    assert ready.load().outputs == ("force",)
    ready.generate(outputs="()")
    assert ready.load().outputs == ()


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("camm", UnknownNameError, "unknown model 'camm'; did you mean 'cam'"),
        ("", UnknownNameError, "unknown model ''; known: "),
        ("..", UnknownNameError, r"unknown model '\.\.'"),
        ("models/cam", ModelFileError, "a path must end in .py"),
        ("models\\cam", ModelFileError, "a path must end in .py"),
        ("no_such_file.py", ModelFileError, "no mechanism file 'no_such_file.py'"),
    ],
)
def test_unknown_model_names_are_refused(name, error, message):
    with pytest.raises(error, match=message):
        solve.load(name)


def test_models_are_found_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "models").mkdir()
    (tmp_path / "generated").mkdir()
    monkeypatch.chdir(tmp_path)
    assert "cam" in model_names()
    assert solve.load("cam").labels.case == "1"
