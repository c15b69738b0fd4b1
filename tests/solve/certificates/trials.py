"""How a method's result on a member of the population is held against the truth."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from solve import Newmark, Orbit, Radau, RungeKutta4, SolveError, periodic
from solve.methods.bahgat_willmert import BahgatWillmert
from solve.methods.choice import auto
from solve.methods.fourier import Fourier
from solve.methods.gauss import Gauss
from solve.methods.hill import Hill
from solve.methods.hsu import Hsu
from solve.methods.march import March
from solve.methods.modal import Modal
from tests.solve.certificates.population import Member
from tests.solve.witnesses import relative_error

PHASES = np.linspace(0.0, 2 * np.pi, 1000, endpoint=False) + 1e-3
VISIBLE = 1e-12
"""True errors above this are compared with estimates for sharpness."""


@dataclass(frozen=True)
class Trial:
    """A method on a grid of its own (`steps`) or refined to `rtol`, on the members that `suits` takes."""

    method: object
    steps: int | None
    rtol: float
    suits: Callable[[Member], bool] = lambda member: True

    @property
    def name(self) -> str:
        return getattr(self.method, "name", "auto")


@dataclass(frozen=True)
class Outcome:
    """True errors and their estimates, of orbit and multipliers; or the refusal."""

    index: int
    name: str
    errors: tuple[float, float] = (np.nan, np.nan)
    estimates: tuple[float, float] = (np.nan, np.nan)
    refusal: str = ""


def small(member: Member) -> bool:
    """Few enough coordinates for dense eigenvalue problems over all orders."""
    return member.system.n <= 2


def fifth(member: Member) -> bool:
    return member.index % 5 == 0


def dying(member: Member) -> bool:
    return member.damped and fifth(member)


TRIALS = [
    Trial(auto, None, 1e-4),
    Trial(auto, None, 1e-8),
    Trial(Gauss(4), None, 1e-5),
    Trial(Gauss(10), 40, 0.9),
    Trial(Gauss(16), None, 1e-8),
    Trial(Radau(3), None, 1e-3),
    Trial(Radau(5), None, 1e-5),
    Trial(Radau(9), 40, 0.9),
    Trial(Newmark(), 200, 0.9),
    Trial(Newmark(), None, 1e-2, fifth),
    Trial(RungeKutta4(), 200, 0.9),
    Trial(RungeKutta4(), None, 1e-5, fifth),
    Trial(Hsu(), 200, 0.9),
    Trial(Hsu(), None, 1e-2, fifth),
    Trial(Fourier(), 41, 0.9, small),
    Trial(Fourier(), None, 1e-6, small),
    Trial(Hill(), 41, 0.9, lambda member: small(member) and fifth(member)),
    Trial(Hill(), None, 1e-4, lambda member: small(member) and fifth(member)),
    Trial(March(), 200, 0.9, dying),
    Trial(Modal(), 100, 0.9, lambda member: small(member) and fifth(member)),
    Trial(BahgatWillmert(), 41, 0.9, lambda member: small(member) and fifth(member)),
]


def true_orbit(member: Member) -> Orbit:
    """Radau IIA of order 13, refined to what rounding leaves."""
    return periodic(member.system, member.speed, Radau(13), rtol=1e-13)


def outcomes(member: Member, trials: list[Trial] = TRIALS) -> list[Outcome]:
    truth = true_orbit(member)
    q = truth.at(PHASES)
    return [_outcome(member, trial, q, truth.multipliers) for trial in trials if trial.suits(member)]


def _outcome(member: Member, trial: Trial, q: np.ndarray, multipliers: np.ndarray) -> Outcome:
    name = trial.name
    try:
        found = periodic(member.system, member.speed, trial.method, steps=trial.steps, rtol=trial.rtol)
    except SolveError as refusal:
        return Outcome(member.index, name, refusal=str(refusal))
    errors = relative_error(found.at(PHASES), q), matched_error(found.multipliers, multipliers)
    return Outcome(member.index, name, errors, tuple(found.error_estimate))


def matched_error(values: np.ndarray, truth: np.ndarray) -> float:
    """Largest distance between matched multipliers, missing ones counted as 0, over the true radius."""
    count = max(len(values), len(truth))
    ours, theirs = (np.pad(each, (0, count - len(each))) for each in (values, truth))
    distance = np.abs(ours[:, None] - theirs)
    return float(distance[linear_sum_assignment(distance)].max() / np.abs(truth).max())


@dataclass(frozen=True)
class Rates:
    """Shares of all orbits and multipliers together: `honest`, true error ≤ 10 × estimate; `sharp`,
    estimate ≤ 1000 × true error where that is visible."""

    name: str
    results: int
    refused: int
    honest: float
    visible: int
    sharp: float
    worst: Outcome | None

    def __str__(self) -> str:
        worst = ""
        if self.worst is not None:
            pairs = zip(("orbit", "multipliers"), self.worst.errors, self.worst.estimates, strict=True)
            told = ", ".join(f"{name} {error:.1e} ({estimate:.1e})" for name, error, estimate in pairs)
            worst = f"; least honest: system {self.worst.index}, true (estimated) {told}"
        return (
            f"{self.name:16s}{self.results:6d} results, {self.refused:3d} refused; honest "
            f"{100 * self.honest:6.2f} %; sharp {100 * self.sharp:6.2f} % of {self.visible}{worst}"
        )


def rates(name: str, found: list[Outcome]) -> Rates:
    results = [each for each in found if not each.refusal]
    errors = np.array([each.errors for each in results]).reshape(-1, 2)
    estimates = np.array([each.estimates for each in results]).reshape(-1, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.nan_to_num(errors / estimates, nan=0.0)
    honest = errors <= 10 * estimates
    visible = errors > VISIBLE
    sharp = (estimates <= 1000 * errors)[visible]
    worst = results[int(ratio.max(axis=1).argmax())] if len(results) and not honest.all() else None
    return Rates(
        name,
        len(results),
        len(found) - len(results),
        float(honest.mean()) if len(results) else np.nan,
        int(visible.sum()),
        float(sharp.mean()) if len(sharp) else np.nan,
        worst,
    )
