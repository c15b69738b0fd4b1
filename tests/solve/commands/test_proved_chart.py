"""`solve chart --prove`."""

import json

import pytest

pytest.importorskip("flint")


def test_command_prints_fractions_and_boxes(command):
    axes = ("--x", "delta=0.95:1.05:3", "--y", "epsilon=0.1:0.2:3", "--set", "zeta=0.01")
    out = command("chart", "mathieu", *axes, "--prove", "--json")
    record = json.loads(out.out)
    assert record["proved"]["undecided"] <= 0.001
    assert {box["verdict"] for box in record["boxes"]} >= {"unstable"}
