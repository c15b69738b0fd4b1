"""`solve animate`."""

import pytest
from PIL import Image

import solve

CAM = ("animate", "cam", "--speed", "600 rpm", "--rtol", "1e-3", "--frames", "3")


def test_command_and_python_produce_the_same_animation(command, tmp_path):
    ran = command(*CAM, "--out", "mine.html", "--scale", "2", "--show", "q2")
    assert ran.status == 0
    animation = solve.animate(solve.load("cam"), "600 rpm", 2.0, 3, ["q2"], rtol=1e-3)
    assert (tmp_path / "mine.html").read_text("utf-8") == animation.html
    assert ran.out == "cam, case 1, 600 rpm: vibration magnified 2 times\n"
    message = ran.err.replace("\n", " ")
    assert "the linearisation may be invalid: max|q1| = 0.867 rad" in message
    assert "wrote mine.html" in message
    assert "the linearisation may be invalid" in animation.html


@pytest.mark.parametrize("ending", [".gif", ".GIF", ".png", ".svg", ".pdf"])
def test_file_ending_selects_the_format(command, tmp_path, ending):
    ran = command(*CAM, "--out", f"mine{ending}")
    assert ran.status == 0
    content = (tmp_path / f"mine{ending}").read_bytes()
    begins = {".gif": b"GIF89a", ".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[ending.lower()]
    assert content.startswith(begins)
    if ending == ".gif":
        assert Image.open(tmp_path / "mine.gif").n_frames == 3


def test_growth_is_printed(command):
    ran = command("animate", "mathieu", "--case", "unstable", "--frames", "2", "--out", "mine.png")
    assert "warning: unstable: it grows\n" in ran.err


@pytest.mark.slow
def test_nonlinear_orbit_is_animated(command):
    ran = command(*CAM, "--nonlinear", "--out", "mine.png")
    assert ran.status == 0
    assert "linearisation may be invalid" not in ran.err


def test_model_without_lines_is_refused_with_advice(command, tmp_path, monkeypatch):
    monkeypatch.setattr("solve.model.model.stated_lines", lambda *_: {})
    ran = command(*CAM, "--out", "mine.gif")
    assert (ran.status, ran.out) == (2, "")
    assert "cam declares no lines to draw; add mechanism.sketch(name, points)" in ran.err
    assert "docs/motion.md" in ran.err
    assert ran.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_interrupted_animation_leaves_no_file(command, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("solve.views.animation.gif", interrupted)
    ran = command(*CAM, "--out", "mine.gif")
    assert (ran.status, ran.out) == (130, "")
    assert list(tmp_path.iterdir()) == []
