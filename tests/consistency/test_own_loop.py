"""A mechanism of one's own with a closed loop, from its file to its orbit."""

import sys

import numpy as np
import pytest

import solve
from derive.__main__ import main
from solve.errors import ValueOutOfBoundsError

PRESS = """
from derive import Mechanism, cos, rate, sin


def mechanism():
    press = Mechanism("press", "Slider-crank with an elastic slider")
    (q,) = press.coordinates(q=("m", "slider against its pin"))
    r, L, e, m, k, c = press.parameters(
        r=("m", "crank", "> 0"), L=("m", "rod", "> 0"), e=("m", "offset of the slide"),
        m=("kg", "slider", "> 0"), k=("N/m", "pin", "> 0"), c=("N s/m", "pin", ">= 0"),
    )
    s, beta = press.loop(
        {"s": "m", "beta": "rad"},
        driven_by=(press.phase,),
        closure=lambda x, s, beta: (r*cos(x) + L*cos(beta) - s, r*sin(x) + L*sin(beta) - e),
        start=lambda x: (r*cos(x) + L, 0),
    )
    press.kinetic = m * rate(s + q)**2 / 2
    press.potential = k * q**2 / 2
    press.dissipation = c * rate(q)**2 / 2
    press.output("slide", s, "m", "rigid position of the slider")
    return press
"""
NUMBERS = {"r": 0.1, "L": 0.3, "e": 0.02, "m": 2.0, "k": 8e4, "c": 40.0}


@pytest.fixture
def press(tmp_path, monkeypatch):
    path = tmp_path / "press.py"
    path.write_text(PRESS, encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["derive", str(path)])
    with pytest.raises(SystemExit) as finished:
        main()
    assert not finished.value.code
    return str(path)


def test_the_orbit_is_that_of_the_closed_form(press):
    """m q̈ + c q̇ + k q = −m s̈: harmonic by harmonic, with s from the right-angled triangle."""
    speed, count = 20.0, 256
    orbit = solve.periodic(solve.load(press, **NUMBERS), speed)
    phase = 2 * np.pi * np.arange(count) / count
    r, L, e, m, k, c = NUMBERS.values()
    s = r * np.cos(phase) + np.sqrt(L**2 - (e - r * np.sin(phase)) ** 2)
    pulse = 1j * speed * np.fft.fftfreq(count, 1 / count)
    q = np.fft.ifft(-m * pulse**2 * np.fft.fft(s) / (m * pulse**2 + c * pulse + k)).real
    np.testing.assert_allclose(orbit.at(phase)[0], q, rtol=0, atol=1e-8 * abs(q).max())
    np.testing.assert_allclose(orbit.signal("slide")(phase), s, rtol=0, atol=1e-14)


def test_a_loop_that_does_not_close_is_refused_in_one_line(press):
    message = (
        "the loop of s, beta does not close at every phase: gap of s, beta < 1e-9 does not hold "
        "for r = 0.1 m, L = 0.11 m, e = 0.02 m; choose numbers for which it does"
    )
    with pytest.raises(ValueOutOfBoundsError) as refused:
        solve.load(press, **NUMBERS | {"L": 0.11})
    assert str(refused.value) == message
