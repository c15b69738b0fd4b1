"""Every bad input is refused in one line that says what was given and what is allowed; exit status 2."""

import pytest

SPEED = ("--speed", "600 rpm")
CAM = ("periodic", "cam", *SPEED)

BAD = {
    "unknown command": (("perodic", "cam"), ("perodic", "periodic")),
    "no model": (("periodic",), ("MODEL",)),
    "unknown flag": ((*CAM, "--sped", "5"), ("--sped", "--speed")),
    "a flag of another command": (("floquet", "cam", *SPEED, "--scale", "dB"), ("--scale",)),
    "unknown model": (("periodic", "camm", *SPEED), ("camm", "did you mean 'cam'")),
    "model with a path separator": (("periodic", "models/cam", *SPEED), ("models/cam", ".py")),
    "model up the tree": (("periodic", "../cam", *SPEED), ("../cam", ".py")),
    "path that is no file": (("periodic", "mine.py", *SPEED), ("mine.py", "exists")),
    "unknown case": ((*CAM, "--case", "11"), ("'11'", "'1'")),
    "unknown parameter": ((*CAM, "--set", "kk1=3"), ("'kk1'", "'k1'")),
    "unknown option": ((*CAM, "--option", "load=constant"), ("'load'", "known: none")),
    "unknown value of an option": (
        ("periodic", "gear_pair", "--option", "load=constnt"),
        ("constnt", "constant"),
    ),
    "unknown method": ((*CAM, "--method", "neumark"), ("neumark", "newmark")),
    "unknown quantity": ((*CAM, "--show", "contact_froce"), ("contact_froce", "contact_force")),
    "unknown scale": ((*CAM, "--scale", "db"), ("'db'", "dB")),
    "parameter out of its bounds": ((*CAM, "--set", "k1=-1"), ("k1", "-1", "> 0", "N m/rad")),
    "parameter that must be whole": (
        ("periodic", "gear_pair", "--set", "z1=14.5"),
        ("z1", "14.5", "integer"),
    ),
    "parameter NaN": ((*CAM, "--set", "k1=nan"), ("k1", "nan", "> 0")),
    "parameter infinite": ((*CAM, "--set", "F=inf"), ("F", "inf", "finite")),
    "parameter without value": ((*CAM, "--set", "k1"), ("'k1'", "--set NAME=NUMBER")),
    "parameter without name": ((*CAM, "--set", "=3"), ("'=3'", "--set NAME=NUMBER")),
    "parameter with unit of another kind": ((*CAM, "--set", "k1=80kg"), ("k1: unit 'kg'", "N m/rad")),
    "parameter that is no number": ((*CAM, "--set", "k1=stiff"), ("'stiff'", "SI units")),
    "parameter twice": ((*CAM, "--set", "k1=1", "--set", "k1=2"), ("k1 twice",)),
    "option of the model as a flag": ((*CAM, "--k1", "3"), ("--k1", "--option k1=VALUE or --set k1=NUMBER")),
    "option without value": ((*CAM, "--option", "load"), ("'load'", "--option NAME=VALUE")),
    "no speed": (("periodic", "cam"), ("names no speed", "--speed")),
    "speed without unit": (("periodic", "cam", "--speed", "600"), ("'600'", "no unit", "'600 rpm'")),
    "speed in another unit": (("periodic", "cam", "--speed", "600 kg"), ("'kg'", "rad/s")),
    "speed zero": (("periodic", "cam", "--speed", "0 rpm"), ("0 rpm", "> 0")),
    "speed negative": (("periodic", "cam", "--speed", "-600 rpm"), ("-600 rpm", "> 0")),
    "speed NaN": (("floquet", "cam", "--speed", "nan rpm"), ("nan rpm", "finite")),
    "speed infinite": (("floquet", "cam", "--speed", "inf Hz"), ("inf Hz", "finite")),
    "steps none": ((*CAM, "--steps", "0"), ("steps is 0", "at least 1")),
    "steps not whole": ((*CAM, "--steps", "1e3"), ("--steps", "'1e3'", "whole")),
    "steps too few for rk4": (
        (*CAM, "--method", "rk4", "--steps", "500"),
        ("rk4 with 500 steps", "at least", "radau"),
    ),
    "steps too few for an explicit newmark": (
        ("floquet", "cam", *SPEED, "--method", "newmark", "--beta", "0", "--steps", "300"),
        ("newmark with 300 steps", "at least"),
    ),
    "steps beyond memory": ((*CAM, "--steps", "99999999999"), ("99999999999", "at most")),
    "rtol zero": ((*CAM, "--rtol", "0"), ("rtol is 0", "1e-8")),
    "rtol no number": ((*CAM, "--rtol", "small"), ("--rtol", "'small'")),
    "rtol NaN": ((*CAM, "--rtol", "nan"), ("rtol is nan",)),
    "a setting of another method": (
        (*CAM, "--method", "newmark", "--order", "5"),
        ("newmark has no order", "radau"),
    ),
    "an order that there is not": ((*CAM, "--method", "radau", "--order", "4"), ("is 4", "3, 5, 7")),
    "gamma out of its bounds": ((*CAM, "--method", "newmark", "--gamma", "2"), ("gamma", "2.0", "0 … 1")),
    "no harmonics": ((*CAM, "--harmonics", "0"), ("--harmonics is 0", "1 …")),
    "too many harmonics": ((*CAM, "--harmonics", "99999"), ("99999", "10000")),
    "picture of unknown kind": ((*CAM, "--plot", "cam.jpeg"), ("cam.jpeg", ".png, .pdf, .svg")),
    "picture without ending": ((*CAM, "--plot", "cam"), ("no ending", ".png")),
    "picture in a missing folder": ((*CAM, "--plot", "none/cam.png"), ("none/cam.png", "no folder")),
    "data of unknown kind": ((*CAM, "--save", "cam.xlsx"), ("cam.xlsx", ".npz, .csv, .mat, .nc")),
    "data onto a folder": ((*CAM, "--save", "folder.csv"), ("folder.csv", "is a folder")),
    "data below a file": ((*CAM, "--save", "file.txt/cam.csv"), ("file.txt", "no folder")),
    "case file that is none": ((*CAM, "--cases", "none.toml"), ("none.toml", "cannot be read")),
    "case file that is no TOML": ((*CAM, "--cases", "broken.toml"), ("broken.toml", "not TOML")),
    "case file with a misspelt key": ((*CAM, "--cases", "misspelt.toml"), ("'valeu'", "'value'")),
    "compare: unknown method": (("compare", "cam", *SPEED, "--method", "rk5"), ("rk5", "rk4")),
    "compare: a setting that no method has": (
        ("compare", "cam", *SPEED, "--method", "rk4", "--gamma", "0.5"),
        ("rk4 has no gamma", "newmark"),
    ),
    "compare: no steps": (("compare", "cam", *SPEED, "--steps", "0"), ("steps is 0", "at least 1")),
    "compare: target out of reach of numbers": (("compare", "cam", *SPEED, "--rtol", "2"), ("rtol is 2",)),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_in_one_line(command, tmp_path, name):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file.txt").touch()
    (tmp_path / "broken.toml").write_text("[case.1\n")
    (tmp_path / "misspelt.toml").write_text('[case.1.parameters]\nk1 = { valeu = 1, unit = "N m/rad" }\n')
    arguments, words = BAD[name]
    before = sorted(tmp_path.iterdir())
    ran = command(*arguments)
    assert ran.status == 2
    assert ran.out == ""
    assert ran.err.startswith("solve: ")
    assert ran.err.count("\n") == 1, f"not one line: {ran.err}"
    assert [word for word in words if word not in ran.err] == [], ran.err
    assert sorted(tmp_path.iterdir()) == before


def test_an_unfit_file_is_refused_before_the_calculation(command, monkeypatch):
    def calculated(*_, **__):
        raise AssertionError("calculated before the files were checked")

    monkeypatch.setattr("solve.periodic", calculated)
    for flag, file in (("--plot", "no/cam.png"), ("--save", "no/cam.csv"), ("--save", "/proc/cam.csv")):
        assert command(*CAM, flag, file).status == 2


def test_a_missing_extra_is_named_before_the_calculation(command, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "h5netcdf" else find(name))
    ran = command(*CAM, "--save", "cam.nc")
    assert ran.status == 2
    assert "h5netcdf" in ran.err
    assert "parametric-vibration[netcdf]" in ran.err
