"""Least squares over domains whose limits are found only by evaluation, for problems with known minima."""

import numpy as np
import pytest

import solve
from derive import Mechanism, cos, rate, sqrt
from solve.errors import MatricesError, NoResultError
from solve.studies.least_squares import minimise

T = np.linspace(1.0, 2.0, 7)
FREE = (np.array([-np.inf]), np.array([np.inf]))


class Root:
    """Residuals a √x t − y, which are undefined for x <= 0."""

    def __init__(self, start, y, broken=False):
        self.start, self.y, self.broken, self.refused = np.array([start]), y, broken, 0

    def described(self, x):
        return f"x = {x[0]:g} m"

    def residuals(self, x):
        if x[0] <= 0:
            self.refused += 1
            raise MatricesError("M has NaN")
        return np.sqrt(x[0]) * T - self.y

    def jacobian(self, x):
        return (T / (2 * np.sqrt(x[0])) * (np.nan if self.broken else 1.0))[:, None]


def test_step_is_shortened_after_a_trial_without_a_result():
    """The first Gauss-Newton step from 9 to √0.01 t ends at 9 + 2 · 3 (0.1 − 3) = −8.4."""
    problem = Root(9.0, 0.1 * T)
    solution = minimise(problem, FREE, False)
    assert problem.refused >= 1
    assert solution.x == pytest.approx([0.01], rel=1e-8)
    assert solution.warnings == []


def test_step_is_shortened_after_a_trial_that_is_not_finite():
    class Infinite(Root):
        def residuals(self, x):
            return np.sqrt(x[0]) * T - self.y if x[0] > 0 else np.full(len(T), np.inf)

    assert minimise(Infinite(9.0, 0.1 * T), FREE, False).x == pytest.approx([0.01], rel=1e-8)


def test_minimum_outside_the_domain_is_reported():
    """The fit of √x t to −t has no minimum: the residual decreases towards the boundary 0."""
    solution = minimise(Root(2.0, -T), FREE, False)
    assert not solution.stationary
    (text,) = solution.warnings
    assert text.startswith("the fit ended away from a minimum (")
    assert "x = -" in text
    assert "M has NaN" in text


def test_inexact_fit_at_the_start_is_reported():
    off = np.array([1.0, -1, 1, -1, 1, -1, 0])
    off -= T * (off @ T) / (T @ T)
    (text,) = minimise(Root(4.0, 2 * T + 0.1 * off), FREE, False).warnings
    assert text.startswith("the fit did not move from its start, x = 4 m, already a minimum")
    assert minimise(Root(4.0, 2 * T), FREE, False).warnings == []
    assert minimise(Root(3.0, 2 * T + 0.1 * off), FREE, False).warnings == []


@pytest.mark.parametrize("problem", [Root(1.0, T, broken=True), Root(4.0, np.full(len(T), np.inf))])
def test_start_that_is_not_finite_is_refused_with_its_values(problem):
    with pytest.raises(
        NoResultError, match=r"starts from x = .* m, where .* are not finite; start from other values"
    ):
        minimise(problem, FREE, False)


def softening():
    """Return a spring k √(1 − a²), undefined for |a| > 1, driven by F cos φ."""
    made = Mechanism("softening", "A spring that an angle softens")
    (q,) = made.coordinates(q=("m", "way"))
    m, c, k, F = made.parameters(
        m=("kg", "mass", "> 0"),
        c=("N s/m", "damper", "> 0"),
        k=("N/m", "spring", "> 0"),
        F=("N", "force", ""),
    )
    (a,) = made.parameters(a=("1", "sine of the angle", ""))
    made.kinetic, made.dissipation = m * rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    made.potential = k * sqrt(1 - a**2) * q**2 / 2
    made.force(F * cos(made.phase), q)
    return made


NUMBERS = {"m": 1.0, "c": 0.5, "k": 20.0, "F": 3.0}


@pytest.fixture
def data(tmp_path):
    """Return the response at 1 and 2 rad/s for a = 0.95, from the complex solution."""
    rows, phases = ["phase (rad),speed (rad/s),q (m)"], np.linspace(0, 2 * np.pi, 40, endpoint=False)
    for speed in (1.0, 2.0):
        stiffness = 20 * np.sqrt(1 - 0.95**2) - speed**2 + 0.5j * speed
        rows += [f"{at!r},{speed},{value!r}" for at, value in zip(
            phases.tolist(), np.real(3 / stiffness * np.exp(1j * phases)).tolist(), strict=True)]  # fmt: skip
    (tmp_path / "q.csv").write_text("\n".join(rows))
    return tmp_path / "q.csv"


@pytest.mark.parametrize("start", [0.7, -0.9])
def test_fit_continues_past_values_without_matrices(data, start):
    fitted = solve.fit(solve.load(softening(), **NUMBERS, a=start), data, ["a"])
    assert fitted.parameters["a"].value == pytest.approx(np.copysign(0.95, start), rel=1e-6)
    assert not any("fit" in text for text in fitted.warnings)


def test_start_without_matrices_is_refused_with_its_values(data):
    with pytest.raises(MatricesError, match=r"the fit starts from a = 1.2, k = 20 N/m, where . has NaN"):
        solve.fit(solve.load(softening(), **NUMBERS, a=1.2), data, ["a", "k"])
    # Without the spring the mass is free and still vibrates, but the slope of √0 is infinite.
    with pytest.raises(NoResultError, match="the fit starts from a = 1, where derivatives"):
        solve.fit(solve.load(softening(), **{**NUMBERS, "m": 0.5}, a=1.0), data, ["a"])


def test_poor_fit_of_few_values_is_reported(tmp_path):
    """The data are the amplitudes of three harmonics, but the response has one. The error of 1 % is typical
    of sensors."""
    size = float(3 / abs(20 * np.sqrt(1 - 0.95**2) - 1 + 0.5j))
    rows = [f"1,1,{size!r}", f"1,1,{1.01 * size!r}"]
    file = tmp_path / "orders.csv"
    for more, expected in (((), 0), ([f"2,1,{0.2 * size!r}", f"3,1,{0.1 * size!r}"], 1)):
        file.write_text("\n".join(["order (1),speed (rad/s),q (m)", *rows, *more]))
        fitted = solve.fit(solve.load(softening(), **NUMBERS, a=0.9), file, ["a"])
        assert sum("values are too few to distinguish noise" in text for text in fitted.warnings) == expected
