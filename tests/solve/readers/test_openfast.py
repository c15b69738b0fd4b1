"""Sets of OpenFAST linearisation files: known multipliers, and malformed files."""

import numpy as np
import pytest

import solve
from solve.errors import FileError, MatricesError, UnknownNameError
from solve.labels import speed_or_usual
from tests.solve.readers.lin_files import (
    INPUTS,
    OUTPUTS,
    SPEED,
    STATES,
    A,
    lin_text,
    rotating_matrices,
    write_set,
)

AZIMUTH_STATES = ("GeAz", "GeAz_rate")


@pytest.mark.parametrize("count", [12, 24, 36])
def test_multipliers_match_those_in_fixed_coordinates(tmp_path, count):
    system = solve.read_openfast(write_set(tmp_path, count), AZIMUTH_STATES)
    found = solve.floquet(system, system.labels.case_speed, all_multipliers=True)
    expected = np.exp(np.linalg.eigvals(A) * 2 * np.pi / SPEED)
    distance = np.abs(found.multipliers[:, None] - expected)
    np.testing.assert_allclose(distance.min(axis=1), 0.0, atol=1e-10)
    np.testing.assert_allclose(distance.min(axis=0), 0.0, atol=1e-10)


def test_names_units_and_meanings_are_read_from_descriptions(tmp_path):
    system = solve.read_openfast(write_set(tmp_path))
    assert system.states == ("BE_1_1", "BE_2_1", "GeAz", "BE_1_1_rate", "BE_2_1_rate", "GeAz_rate")
    assert [system.labels.units[name] for name in system.states] == ["m", "m", "rad", "m/s", "m/s", "rad/s"]
    assert [system.labels.meanings[name] for name in system.states] == list(STATES)
    assert system.inputs == ("ED_Generator_torque_input",)
    assert system.outputs == ("ED_YawBrMzp", "ED_Azimuth")
    assert system.labels.units["ED_YawBrMzp"] == "kN-m"
    assert [system.labels.meanings[name] for name in (*system.inputs, *system.outputs)] == [*INPUTS, *OUTPUTS]
    assert system.labels.title == "Two blades in rotating coordinates"
    assert system.labels.name == "run"
    assert system.source.rotating == ["BE_1_1", "BE_2_1", "BE_1_1_rate", "BE_2_1_rate"]
    assert system.source.operating_points["BE_1_1"].tolist() == [0.1] * 24
    assert speed_or_usual(system, None) == pytest.approx(SPEED)


def test_matrices_are_sorted_by_azimuth(tmp_path):
    order = np.random.default_rng(1).permutation(24).tolist()
    system = solve.read_openfast(write_set(tmp_path, order=order, offset=0.37))
    azimuth = (5 + 0.37) * 2 * np.pi / 24
    found = system.equations_at(np.array([azimuth]), SPEED)
    A, _, *others = found
    for name, values, expected in zip("ABCD", (A, *others), rotating_matrices(azimuth), strict=True):
        # Azimuths have twelve digits, by the state of the generator.
        np.testing.assert_allclose(values[0], expected, atol=1e-10, err_msg=name)


def test_printed_azimuth_is_used_without_a_generator_state(tmp_path):
    pattern = write_set(tmp_path)
    for file in tmp_path.glob("run.*.lin"):
        file.write_text(file.read_text("utf-8").replace("Variable speed generator", "Azimuth"), "utf-8")
    system = solve.read_openfast(pattern)
    found = system.equations_at(np.array([2 * np.pi / 24]), SPEED)[0][0]
    error = np.abs(found - rotating_matrices(2 * np.pi / 24)[0]).max()
    assert 1e-8 < error < 1e-3


def test_other_speeds_give_a_warning(tmp_path):
    system = solve.read_openfast(write_set(tmp_path, 12), AZIMUTH_STATES)
    assert not any("sampled" in text for text in solve.floquet(system, SPEED).warnings)
    assert any("sampled at 1.2 rad/s" in text for text in solve.floquet(system, 2 * SPEED).warnings)


def test_free_rotor_has_a_mode_without_frequency_and_damping(tmp_path):
    """No restoring torque acts on the azimuth of the generator, which is a state."""
    modes = solve.follow_modes(solve.read_openfast(write_set(tmp_path, 12)), [SPEED, 1.01 * SPEED])
    assert modes.frequencies[0, 0] == modes.damping[0, 0] == 0
    assert len(modes.labels) == 3
    assert not any("relative errors" in text for text in modes.warnings)


def edited(old, new, count=1):
    text = lin_text(0.5)
    assert old in text
    return text.replace(old, new, count)


def truncated(line):
    """Return a file without the lines from a given line on."""
    text = lin_text(0.5)
    return text[: text.index(line) + len(line)]


MALFORMED = {
    "empty": ("", "it has no 'Azimuth'"),
    "a word as azimuth": (
        edited("Azimuth:        ", "Azimuth:  north "),
        "line 10: expected 1 finite number",
    ),
    "azimuth in degrees": (edited("0.5000 rad", "0.5000 deg"), "expected Azimuth in rad, not in deg"),
    "speed in revolutions per minute": (
        edited("rad/s\n", "rpm\n"),
        "expected Rotor Speed in rad/s, not in rpm",
    ),
    "no states": (edited("Order of continuous states:", "Order of nothing:"), "it has no continuous states"),
    "a row is missing": (edited("\n          2  ", "\n          3  "), "expected row 2 of 6 states"),
    "no rotating flag": (edited("T               2", "X               2"), "expected row 1 of 6 states"),
    "A is cut off": (truncated("A: 6 x 6"), "expected 6 finite numbers"),
    "A has another size": (edited("A: 6 x 6", "A: 6 x 5"), "expected A of 6 x 6"),
    "a word in A": (edited("1.000000000000E+00", "*******************"), "expected 6 finite numbers"),
    "not a number in A": (edited("1.000000000000E+00", "NaN"), "expected 6 finite numbers"),
    "no A": (edited("A: 6 x 6", "Z: 6 x 6"), "it has no matrix A"),
    "B has too few rows": (edited("B: 6 x 1", "B: 5 x 1"), "expected B of 6 x 1"),
    "a huge count": (edited("states:         6", "states:  99999999"), "expected a count below a million"),
}


@pytest.mark.parametrize(("text", "expected"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_refused_in_one_line(tmp_path, text, expected):
    file = tmp_path / "bad.1.lin"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=r"bad\.1\.lin") as refused:
        solve.read_openfast(file)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


def test_files_of_different_runs_are_refused(tmp_path):
    pattern = write_set(tmp_path, 12)
    (tmp_path / "run.3.lin").write_text(edited("YawBrMzp", "Other"), encoding="utf-8")
    with pytest.raises(FileError, match="outputs that differ"):
        solve.read_openfast(pattern)
    (tmp_path / "run.3.lin").write_text(lin_text(1.0, speed=2.0), encoding="utf-8")
    with pytest.raises(FileError, match="one operating point"):
        solve.read_openfast(pattern)


def test_missing_files_names_and_azimuths_are_refused(tmp_path):
    with pytest.raises(FileError, match="no file matches"):
        solve.read_openfast(tmp_path / "none.*.lin")
    with pytest.raises(FileError, match="there is no file"):
        solve.read_openfast(tmp_path / "none.lin")
    with pytest.raises(UnknownNameError, match="nope"):
        solve.read_openfast(write_set(tmp_path), ["nope"])
    (tmp_path / "run.2.lin").write_text(lin_text(0.0), encoding="utf-8")
    with pytest.raises(MatricesError, match="azimuth"):
        solve.read_openfast(str(tmp_path / "run.*.lin"))
