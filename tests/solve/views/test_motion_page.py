"""Sketch of the user-defined pump on the page on motion."""

import re
from pathlib import Path

import numpy as np

import solve
from solve.equations import sketched

DOCS = Path(__file__).parents[3] / "docs"


def test_pump_sketch_has_the_lengths_of_crank_and_rod():
    page = (DOCS / "own_mechanism.md").read_text("utf-8")
    (statement,) = re.findall(r"```python\n# pump\.py\n(.*?)```", page, re.DOTALL)
    (lines,) = re.findall(r"```python\n( +pump\.sketch.*?)```", page, re.DOTALL)
    namespace: dict = {}
    exec(statement.replace("    return pump", f"{lines}    return pump"), namespace)
    numbers = {
        "J": 0.05,
        "m": 4.5,
        "r": 0.03,
        "L": 0.14,
        "A": 1.2e-3,
        "k1": 25e3,
        "k2": 6e7,
        "c1": 3,
        "c2": 900,
    }
    series = dict.fromkeys(("P", "Pa1", "Pa2", "Pb1", "Pb2"), 0.0)
    model = solve.load(namespace["mechanism"](), **numbers, **series)
    turn = np.linspace(0, 2 * np.pi, 25)
    drawn = sketched(model, turn, 1.0, np.zeros((2, 25)))
    for name, length in (("crank", 0.03), ("rod", 0.14)):
        np.testing.assert_allclose(np.abs(drawn[name][1] - drawn[name][0]), length, rtol=1e-12)
