"""Branches that are interrupted and resumed from a folder."""

from contextlib import suppress

import numpy as np
import pytest

import solve
from solve.errors import FileError
from solve.newton.manifold import Manifold
from tests.solve.newton.mechanisms import duffing, model_of

NUMBERS = {"zeta": 0.05, "k": 1.0, "alpha": 1.0, "f": 0.3}
SETTINGS = {"speeds": (0.9, 2.0), "points": 14}


def model(**changed):
    return model_of(duffing(), **NUMBERS | changed)


@pytest.fixture(scope="module")
def uninterrupted():
    return solve.branch(model(), **SETTINGS)


@pytest.fixture
def corrections(monkeypatch):
    """Counter of solved points of the branch. After `limit` points, the computation is interrupted."""
    counted = {"points": 0, "limit": 10**6}
    original = Manifold.point

    def point(*given, **named):
        counted["points"] += 1
        if counted["points"] > counted["limit"]:
            raise KeyboardInterrupt
        return original(*given, **named)

    monkeypatch.setattr(Manifold, "point", point)
    return counted


def assert_same(one, other):
    for name in ("values", "figures", "multipliers", "errors", "kinds", "curves", "numbers"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.ended == other.ended


def test_interrupted_branch_resumes_bit_for_bit(tmp_path, corrections, uninterrupted):
    corrections["limit"] = 6
    with suppress(KeyboardInterrupt):
        solve.branch(model(), **SETTINGS, store=tmp_path)
    assert corrections["points"] == 7
    corrections["limit"] = 10**6
    assert_same(solve.branch(model(), **SETTINGS, store=tmp_path), uninterrupted)
    corrections["limit"] = 0
    assert_same(solve.branch(model(), **SETTINGS, store=tmp_path), uninterrupted)


def test_more_points_continue_a_stored_branch_and_damage_is_recomputed(tmp_path, uninterrupted):
    few = solve.branch(model(), SETTINGS["speeds"], points=5, store=tmp_path)
    assert "request more" in few.ended
    (tmp_path / "0-2.npz").write_bytes(b"damaged")
    assert_same(solve.branch(model(), **SETTINGS, store=tmp_path), uninterrupted)


def test_folder_with_another_branch_or_other_files_is_refused(tmp_path):
    settings = {"speeds": (0.5, 0.6), "points": 2}
    solve.branch(model(), **settings, store=tmp_path)
    for changed, words in (
        ((model(f=0.4), settings), "f 0.3 instead of 0.4"),
        ((model(), settings | {"rtol": 1e-5}), "rtol 0.001 instead of 1e-05"),
        ((model(), settings | {"switch": True}), "switch False instead of True"),
        ((model(), settings | {"start": lambda phase: np.cos(phase)[None]}), "start None instead of"),
    ):
        with pytest.raises(FileError, match=words):
            solve.branch(changed[0], **changed[1], store=tmp_path)
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(FileError, match="contains other files"):
        solve.branch(model(), **settings, store=other)
