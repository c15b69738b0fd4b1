"""Invalid input is refused in one line that states what was given and what is allowed; the exit status is
2."""

import pytest

from tests.random_commands.values import CASES

SPEED = ("--speed", "600 rpm")
CAM = ("periodic", "cam", *SPEED)

BAD = {
    "unknown command": (("perodic", "cam"), ("perodic", "periodic")),
    "no model": (("periodic",), ("MODEL",)),
    "unknown flag": ((*CAM, "--sped", "5"), ("--sped", "--speed")),
    "a flag of another command": (
        ("chart", "cam", "--over", "k1=6e4:9e4:3"),
        ("--over", "flag of sweep, modes, branch, frequencies"),
    ),
    "unknown model": (("periodic", "camm", *SPEED), ("camm", "did you mean 'cam'")),
    "model with a path separator": (("periodic", "models/cam", *SPEED), ("models/cam", ".py")),
    "model up the tree": (("periodic", "../cam", *SPEED), ("../cam", ".py")),
    "path that is no file": (("periodic", "mine.py", *SPEED), ("mine.py", "exists")),
    "unknown case": ((*CAM, "--case", "11"), ("'11'", "'1'")),
    "unknown parameter": ((*CAM, "--set", "kk1=3"), ("'kk1'", "'k1'")),
    "unknown option": (("periodic", "mathieu", "--option", "load=constant"), ("'load'", "known: none")),
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
    "parameter that is no number": ((*CAM, "--set", "k1=stiff"), ("'stiff'", "model's unit")),
    "parameter twice": ((*CAM, "--set", "k1=1", "--set", "k1=2"), ("k1 twice",)),
    "option of the model as a flag": ((*CAM, "--k1", "3"), ("--k1", "--option k1=VALUE or --set k1=NUMBER")),
    "option without value": ((*CAM, "--option", "load"), ("'load'", "--option NAME=VALUE")),
    "no speed": (("periodic", "cam"), ("states no speed", "--speed")),
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
    "report without a file": (("report", "cam", *SPEED, "--speeds", "1:2:3 rad/s"), ("--out report.html",)),
    "report of unknown kind": (("report", "cam", "--out", "cam.pdf"), ("cam.pdf", ".html")),
    "report in a missing folder": (
        ("report", "cam", "--out", "none/cam.html"),
        ("none/cam.html", "no folder"),
    ),
    "report without speeds": (
        ("report", "cam", *SPEED, "--out", "cam.html"),
        ("no speeds given", "--speeds"),
    ),
    "report without a speed": (
        ("report", "cam", "--speeds", "1:2:3 rad/s", "--out", "cam.html"),
        ("states no speed", "--speed"),
    ),
    "animation without a file": (("animate", "cam", *SPEED), ("--out cam.gif",)),
    "animation of unknown kind": (
        ("animate", "cam", *SPEED, "--out", "cam.mp4"),
        ("cam.mp4", ".gif, .html, .png, .pdf, .svg"),
    ),
    "animation in a missing folder": (
        ("animate", "cam", *SPEED, "--out", "none/cam.gif"),
        ("none/cam.gif", "no folder"),
    ),
    "animation of no frame": (
        ("animate", "cam", *SPEED, "--out", "a.gif", "--frames", "0"),
        ("frames is 0", "1 … 720"),
    ),
    "too many positions of an animation": (
        ("animate", "cam", *SPEED, "--out", "a.png", "--frames", "90"),
        ("frames is 90", "1 … 12"),
    ),
    "negative magnification of an animation": (
        ("animate", "cam", *SPEED, "--out", "a.gif", "--scale", "-1"),
        ("scale is -1", ">= 0"),
    ),
    "animation of what stands still": (
        ("animate", "portal_frame", "--out", "a.gif"),
        ("portal_frame", "solve frequencies portal_frame"),
    ),
    "unknown quantity beside a free vibration": (
        ("animate", "mathieu", "--out", "a.gif", "--show", "p"),
        ("'p'", "q"),
    ),
    "export without a file": (("export", "cam", *SPEED), ("no file given", "--out cam.mat")),
    "export of unknown kind": (("export", "cam", *SPEED, "--out", "cam.slx"), ("cam.slx", ".mat, .c, .fmu")),
    "export in a missing folder": (
        ("export", "cam", *SPEED, "--out", "none/cam.mat"),
        ("none/cam.mat", "no folder"),
    ),
    "export without a speed": (("export", "cam", "--out", "cam.mat"), ("states no speed", "--speed")),
    "export at no phases": (
        ("export", "cam", *SPEED, "--out", "cam.mat", "--samples", "0"),
        ("samples is 0", "at least 1"),
    ),
    "export at too many phases": (
        ("export", "cam", *SPEED, "--out", "cam.mat", "--samples", "100000000"),
        ("1e+08 samples", "--limit"),
    ),
    "export of a structure as C": (("export", "four_bar", "--out", "four_bar.c"), ("four_bar", ".mat")),
    "export of what stands still": (
        ("export", "portal_frame", "--out", "frame.mat"),
        ("solve frequencies portal_frame",),
    ),
    "data below a file": ((*CAM, "--save", "file.txt/cam.csv"), ("file.txt", "no folder")),
    "case file that is none": ((*CAM, "--cases", "none.toml"), ("none.toml", "cannot be read")),
    "case file that is no TOML": ((*CAM, "--cases", "broken.toml"), ("broken.toml", "not TOML")),
    "case file with a misspelt key": ((*CAM, "--cases", "misspelt.toml"), ("'valeu'", "'value'")),
    "speed in a unit to be computed": (
        (*CAM[:2], "--speed", "600 rpm*9**9**9"),
        ("rpm*9**9**9", "rpm, rad/s"),
    ),
    "speed in a tower of powers": ((*CAM[:2], "--speed", "600 kg**(9**9**9)"), ("does not convert",)),
    "speed in a large power": ((*CAM[:2], "--speed", "600 rpm^999999999"), ("does not convert",)),
    "speed in a unit of 3000 brackets": ((*CAM[:2], "--speed", "600 " + "(" * 3000), ("does not convert",)),
    "speed of 5000 digits": ((*CAM[:2], "--speed", "9" * 5000 + " rpm"), ("allowed: finite and > 0",)),
    "speed too small": ((*CAM[:2], "--speed", "1e-300 rpm"), ("1e-60 … 1e+60",)),
    "speed too large": (("floquet", "cam", "--speed", "1e300 rpm"), ("1e-60 … 1e+60",)),
    "parameter too large": ((*CAM, "--set", "k1=1e300"), ("k1", "1e+300", "1e-60 … 1e+60")),
    "parameter too small": ((*CAM, "--set", "m2=5e-324"), ("m2", "4.94066e-324", "1e-60 … 1e+60")),
    "force too large": ((*CAM, "--set", "F=1e308"), ("F", "1e+308", "1e-60 … 1e+60")),
    "number of a flag too large": ((*CAM, "--rtol", "1e-300"), ("1e-300", "1e-60 … 1e+60")),
    "whole number of 5000 digits": ((*CAM, "--harmonics", "9" * 5000), ("is not a whole number",)),
    "flag twice": ((*CAM, "--rtol", "1e-3", "--rtol", "1e-4"), ("--rtol is given 2 times", "once")),
    "list flag twice": (
        ("optimise", "cam", "--minimise", "q1.max", "--free", "k1", "--free", "k2"),
        ("--free is given 2 times", "once, with its values separated by commas"),
    ),
    "limit zero": ((*CAM, "--limit", "0"), ("limit is 0", "1 … 1e15")),
    "limit infinite": ((*CAM, "--limit", "inf"), ("limit is inf", "1 … 1e15")),
    "steps beyond the limit": (
        (*CAM, "--method", "radau", "--steps", "2000", "--limit", "2e5"),
        ("radau takes at most", "given: 2000", "--limit"),
    ),
    "case file that nests deeply": ((*CAM, "--cases", "deep.toml"), ("deep.toml", "nests too deeply")),
    "case file with a number of 5000 digits": ((*CAM, "--cases", "digits.toml"), ("digits.toml", "not TOML")),
    "case file with a count of a hundred million": (
        (*CAM, "--cases", "count.toml"),
        ("'a13'", "did you mean"),
    ),
    "case file with a tower of powers": ((*CAM, "--cases", "tower.toml"), ("k1", "does not convert")),
    "case file that is endless": ((*CAM, "--cases", "/dev/zero"), ("/dev/zero", "is not a file")),
    "case file that is large": (
        (*CAM, "--cases", "long.toml", "--limit", "1e5"),
        ("2000 bytes", "allowed: up to 1562", "--limit 1.28e+05"),
    ),
    "case file with a long name": ((*CAM, "--cases", "x" * 300), ("cannot be read",)),
    "path of 300 letters": (("periodic", "x" * 300 + ".py", *SPEED), ("no mechanism file",)),
    "picture of a long name": ((*CAM, "--plot", "x" * 300 + ".png"), ("cannot be written",)),
    "picture onto a device": ((*CAM, "--plot", "device.png"), ("device.png", "is a device")),
    "scale without a picture": ((*CAM, "--scale", "dB"), ("--scale dB requires --plot FILE",)),
    "curve without a picture": ((*CAM, "--show", "q1"), ("--show q1 requires --plot FILE",)),
    "transient: curve without a picture": (
        ("transient", "cam", *SPEED, "--show", "q1"),
        ("--show q1 requires --plot FILE",),
    ),
    "sweep: harmonics without a waterfall": (
        ("sweep", "cam", "--speeds", "600 rpm", "--harmonics", "5"),
        ("--harmonics 5 requires --waterfall NAME",),
    ),
    "critical: Campbell diagram without a picture": (
        ("critical", "cam", "--speeds", "600 700 rpm", "--campbell"),
        ("--campbell requires --plot FILE",),
    ),
    "critical: Campbell diagram of derivatives": (
        ("critical", "cam", "--speeds", "600 700 rpm", "--campbell", "--by", "k1", "--plot", "c.png"),
        ("--campbell and --by",),
    ),
    "branch: seed without scattered states": (
        ("branch", "cam", "--speeds", "100:200 rpm", "--seed", "0"),
        ("--seed 0 requires --scatter N",),
    ),
    "branch: spread without scattered states": (
        ("branch", "cam", "--speeds", "100:200 rpm", "--spread", "4"),
        ("--spread 4.0 requires --scatter N",),
    ),
    "branch: a number of speeds": (
        ("branch", "cam", "--speeds", "300:1500:40 rpm"),
        ("--speeds", "300:1500:40 rpm", "A:B", "--points"),
    ),
    "branch: a number of values": (
        ("branch", "cam", *SPEED, "--over", "k1=6e4:9e4:40"),
        ("--over", "k1=6e4:9e4:40", "A:B", "--points"),
    ),
    "branch: no scattered states": (
        ("branch", "cam", *SPEED, "--scatter", "0"),
        ("--scatter is 0", "at least 1"),
    ),
    "branch: curves of another kind": (
        ("branch", "cam", *SPEED, "--follow", "torus", "--over", "k1=1:2"),
        ("--follow is torus", "fold, doubling"),
    ),
    "branch: curves over one parameter": (
        ("branch", "cam", *SPEED, "--follow", "fold", "--over", "k1=1:2"),
        ("--follow fold", "--over NAME=A:B twice"),
    ),
    "branch: points without a range": (
        ("branch", "cam", *SPEED, "--scatter", "5", "--points", "9"),
        ("--points 9 requires --speeds or --over",),
    ),
    "export: samples of code": (
        ("export", "cam", "--out", "cam.c", "--samples", "90"),
        ("--samples 90 requires --out FILE.mat",),
    ),
    "sensitivity: periods of linear orbits": (
        ("sensitivity", "cam", *SPEED, "--periods", "2"),
        ("--periods 2 requires --nonlinear",),
    ),
    "optimise: tolerances without a robust objective": (
        (
            "optimise",
            "cam",
            *SPEED,
            "--minimise",
            "q3.rms",
            "--free",
            "k1",
            "--bounds",
            "k1=7e4:9e4",
            "--vary",
            "k3=±1%",
        ),
        ("--vary k3=±1% requires --robust K",),
    ),
    "optimise: delay without feedback": (
        (
            "optimise",
            "cam",
            *SPEED,
            "--minimise",
            "q3.rms",
            "--free",
            "k1",
            "--bounds",
            "k1=7e4:9e4",
            "--delay",
            "1 ms",
        ),
        ("--delay 1 ms requires --feedback NAME",),
    ),
    "optimise: bounds of two parameters": (
        ("optimise", "cam", *SPEED, "--minimise", "q3.rms", "--free", "k1", "--bounds", "k1, k2=1:1e9"),
        ("bounds are given for k2, which is not free",),
    ),
    "optimise: bounds without end": (
        ("optimise", "cam", *SPEED, "--minimise", "q3.rms", "--free", "k1", "--bounds", "k1=7e4:inf"),
        ("a bound of k1 is inf", "finite numbers"),
    ),
    "optimise: bounds in the wrong order": (
        ("optimise", "cam", *SPEED, "--minimise", "q3.rms", "--free", "k1", "--bounds", "k1=9e4:7e4"),
        ("bounds of k1 are 90000 to 70000", "the lower one first"),
    ),
    "sweep: no speeds": (("sweep", "cam"), ("no speeds given", "--speeds")),
    "sweep: too many speeds": (
        ("sweep", "cam", "--speeds", "1:2:100000000 rpm"),
        ("1e+08 values", "allowed: up to 1048576", "--limit 6.4e+09"),
    ),
    "sweep: too many amplitudes": (
        (
            "sweep",
            "cam",
            "--speeds",
            "1:2:1000 rpm",
            "--waterfall",
            "q1",
            "--harmonics",
            "10000",
            "--plot",
            "w.png",
        ),
        ("1000 points", "--limit"),
    ),
    "bands: one speed": (("bands", "cam", "--speeds", "600 rpm"), ("at least two speeds",)),
    "chart: no range": (("chart", "mathieu", "--x", "delta=0:1:3"), ("no --y given",)),
    "chart: one quantity twice": (
        ("chart", "mathieu", "--x", "delta=0:1:3", "--y", "delta=0:1:3"),
        ("both delta",),
    ),
    "chart: too many points": (
        ("chart", "mathieu", "--x", "delta=0:1:100000", "--y", "epsilon=0:1:100000"),
        ("1e+10 points", "--limit"),
    ),
    "critical: by the speed itself": (
        ("critical", "cam", "--speeds", "600 700 rpm", "--by", "speed"),
        ("'by' contains speed", "'k1'"),
    ),
    "bands: by an unknown parameter": (
        ("bands", "cam", "--speeds", "600 700 rpm", "--by", "k9"),
        ("k9", "did you mean 'k3'"),
    ),
    "critical: too many orders": (
        ("critical", "cam", "--speeds", "600 700 rpm", "--orders", "1000000000"),
        ("1e+09 orders", "--limit"),
    ),
    "frequencies: too many positions": (
        ("frequencies", "cam", "--turn", "1000000000"),
        ("1e+09 positions", "--limit"),
    ),
    "frequencies: too many values": (
        ("frequencies", "cam", "--over", "k1=1:2:900000"),
        ("3.24e+07 values at all positions", "--limit"),
    ),
    "frequencies: position too large": (
        ("frequencies", "cam", "--position", "1e300 rad"),
        ("1e-60 … 1e+60",),
    ),
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
    (tmp_path / "device.png").symlink_to("/dev/null")
    (tmp_path / "long.toml").write_text("#" * 2000)
    for file, content in CASES.items():
        (tmp_path / file).write_text(content)
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


def test_unsuitable_file_is_refused_before_the_calculation(command, monkeypatch):
    def calculated(*_, **__):
        raise AssertionError("calculated before the files were checked")

    monkeypatch.setattr("solve.periodic", calculated)
    for flag, file in (("--plot", "no/cam.png"), ("--save", "no/cam.csv"), ("--save", "/proc/cam.csv")):
        assert command(*CAM, flag, file).status == 2
