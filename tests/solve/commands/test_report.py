"""`solve report`."""

import solve

MATHIEU = ("report", "mathieu", "--speeds", "1.1:1.2:3 rad/s", "--rtol", "1e-3")


def test_command_and_python_write_the_same_report(command, tmp_path):
    ran = command(*MATHIEU, "--set", "epsilon=0.2", "--out", "mine.html")
    assert ran.status == 0
    report = solve.report(solve.load("mathieu", epsilon=0.2), "1.1:1.2:3 rad/s", rtol=1e-3)
    assert (tmp_path / "mine.html").read_text("utf-8") == report.html
    assert ran.out.split() == " ".join(report.summary).split()
    (left_out,) = (line for line in ran.err.splitlines() if "mathieu has no load" in line)
    assert left_out.startswith("warning: omitted: Vibration and stability, ")
    assert "Response versus speed, Critical speeds" in left_out
    assert "wrote mine.html" in ran.err


def test_structure_requires_no_speeds(command, tmp_path):
    ran = command("report", "portal_frame", "--out", "frame.html")
    assert ran.status == 0
    assert ran.out.startswith("The lowest natural frequencies")
    assert (tmp_path / "frame.html").is_file()


def test_interrupted_report_leaves_no_file(command, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("solve.views.report.bands", interrupted)
    ran = command(*MATHIEU, "--out", "mine.html")
    assert (ran.status, ran.out) == (130, "")
    assert list(tmp_path.iterdir()) == []
