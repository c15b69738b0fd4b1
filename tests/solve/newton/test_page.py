"""Page on nonlinear orbits: its error message and one of its numbers are those of the program."""

from pathlib import Path

import pytest

import solve

PAGE = Path(__file__).parents[3] / "docs" / "nonlinear.md"


def test_page_states_the_spectral_radius_of_the_example():
    from tests.solve.newton.mechanisms import duffing, model_of

    orbit = solve.nonlinear(model_of(duffing(), zeta=0.0005, k=1.0, alpha=0.1, f=0.1), 0.5)
    assert f"spectral radius of {orbit.spectral_radius:.3f}" in PAGE.read_text("utf-8")


@pytest.mark.slow
def test_page_shows_the_actual_error_message(monkeypatch):
    def unsettled(task, grid):
        raise solve.errors.NoOrbitError("it does not settle")

    # Whether a transient in chaos ends near an unstable orbit differs between machines.
    monkeypatch.setattr("solve.newton.orbits.by_transient", unsettled)
    with pytest.raises(solve.errors.NoOrbitError) as refused:
        solve.nonlinear(solve.load("cam"), "450 rpm")
    shown = " ".join(PAGE.read_text("utf-8").split())
    assert str(refused.value).split("by the transient")[0] in shown
