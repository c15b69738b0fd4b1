"""The example of docs/modes.md runs, and its printed commands are those of the program."""

import re
from pathlib import Path

import solve

PAGE = (Path(__file__).parents[3] / "docs" / "modes.md").read_text(encoding="utf-8")


def test_example_of_the_two_bladed_rotor_runs():
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    exec(example, {})


def test_ground_resonance_occurs_at_the_speeds_on_the_page():
    (example,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    names = {}
    exec(example.partition("system =")[0], names)
    system = solve.PeriodicSystem(names["rotor"], ["x", "y", "lag1", "lag2"])
    for speed, growing in (("135 rpm", True), ("250 rpm", True), ("300 rpm", False)):
        assert (solve.floquet(system, speed).verdict == "unstable") == growing
        modes = solve.follow_modes(system, [solve.floquet(system, speed).speed, 32.0])
        assert (modes.damping[0].min() < 0) == growing
