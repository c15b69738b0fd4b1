"""Every figure of the pages has a command that draws it next to it; one of them is drawn again."""

import matplotlib
import matplotlib.image
import numpy as np
import pytest

from tests import pictures

EVERY = pictures.pictures()


def test_every_figure_is_shown_and_has_a_command():
    shown = {picture.file for picture in EVERY}
    assert shown == {file.resolve() for file in (pictures.ROOT / "docs").rglob("*.png")}


def test_figure_without_a_command_is_refused(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("python -m solve periodic cam --plot other.png\n![a](cam.png)\n")
    with pytest.raises(LookupError, match=r"no command of page\.md draws cam\.png"):
        pictures._command(page, "cam.png")


@pytest.mark.skipif(
    tuple(map(int, matplotlib.__version__.split(".")[:2])) < (3, 11), reason="draws letters otherwise"
)
@pytest.mark.parametrize("name", ["newmark_stability.png", "validity_cam.png"])
def test_command_reproduces_the_figure_on_the_page(tmp_path, name, laid_out):
    """Up to 2 % of the pixels may differ, because fonts depend on the matplotlib version."""
    (picture,) = (each for each in EVERY if each.file.name == name)
    pictures.renew(picture._replace(file=tmp_path / name))
    ours, theirs = (matplotlib.image.imread(file) for file in (tmp_path / name, picture.file))
    assert ours.shape == theirs.shape
    assert np.mean(np.abs(ours - theirs) > 0.1) < 0.02
