"""Comparison of a method's result on a member of the population with the reference solution."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from solve import Newmark, PeriodicSystem, Radau, RungeKutta4, SolveError, periodic
from solve.methods.bahgat_willmert import BahgatWillmert
from solve.methods.choice import auto
from solve.methods.fourier import Fourier
from solve.methods.gauss import Gauss
from solve.methods.hill import Hill
from solve.methods.hsu import Hsu
from solve.methods.march import March
from solve.methods.modal import Modal
from tests.solve.certificates.population import SERIES, Member, member
from tests.solve.certificates.truth import OWN_ERROR, PHASES, Truth
from tests.solve.references import relative_error

VISIBLE = 1e-12
"""True errors above this are compared with estimates for sharpness."""

NO_DIGIT = 0.1
"""Relative error from which a result has no correct digit, and an estimate may be infinite."""

_TRUTH = 1e-10
"""Allowed error of the largest |ρ| of the reference."""

_ON_CIRCLE = 2e-6
"""Distance of the largest |ρ| from 1 up to which "stable" is not counted as a contradiction."""

_ROUNDINGS = 2
"""Number of other roundings of a system's matrices, from which the effect of rounding on the result is
estimated."""

EPS = float(np.finfo(float).eps)

_NOTHING = 1e-100
"""Modulus below which multipliers are not compared."""


@dataclass(frozen=True)
class Trial:
    """Method with fixed `steps` or refined to `rtol`, applied to the members for which `suits` returns
    True."""

    method: object
    steps: int | None
    rtol: float
    suits: Callable[[Member], bool] = lambda member: True

    @property
    def name(self) -> str:
        """Name of the requested method; "auto" if the method is selected for each system."""
        return getattr(self.method, "name", "auto")


@dataclass(frozen=True)
class Outcome:
    """True errors and error estimates of orbit and multipliers, and the verdict; or the error message of a
    refusal.

    `allowed` are the errors of the reference. If the reference is a formula, the matrices of the system are
    rounded values. The effect of this rounding on the result is not an error of the method.
    """

    index: int
    kind: str
    trial: Trial
    errors: tuple[float, float] = (np.nan, np.nan)
    estimates: tuple[float, float] = (np.nan, np.nan)
    verdict: str = ""
    growth: float = np.nan
    contradicted: bool = False
    refusal: str = ""
    allowed: tuple[float, float] = (OWN_ERROR, OWN_ERROR)

    @property
    def honest(self) -> tuple[bool, ...]:
        """Whether the true errors of orbit and multipliers are at most 10 times their estimates."""
        parts = zip(self.errors, self.estimates, self.allowed, strict=True)
        return tuple(error <= 10 * estimate + allowed for error, estimate, allowed in parts)

    @property
    def ratio(self) -> float:
        """Largest true error in units of its estimate."""
        pairs = zip(self.errors, self.estimates, strict=True)
        return max(error / estimate if estimate else np.inf * error for error, estimate in pairs if error)

    def __str__(self) -> str:
        pairs = zip(("orbit", "multipliers"), self.errors, self.estimates, strict=True)
        reported = ", ".join(f"{name} {error:.1e} ({estimate:.1e})" for name, error, estimate in pairs)
        trial = self.trial
        how = f"steps={trial.steps}" if trial.steps else f"rtol={trial.rtol:g}"
        return (
            f"system {self.index} ({self.kind}), {trial.method if trial.name != 'auto' else 'auto'}, {how}: "
            f"true (estimated) {reported}; {self.verdict}, true max|ρ| - 1 = {np.expm1(self.growth):.1e}"
        )


def small(member: Member) -> bool:
    """Whether the system is small enough for dense eigenvalue problems over all harmonics."""
    return member.n <= 2


def fifth(member: Member) -> bool:
    return member.index % 5 == 0


def dying(member: Member) -> bool:
    return member.kind in SERIES and member.kind.startswith("damped") and fifth(member)


def loose(member: Member) -> bool:
    """Whether estimates are unreliable at a loose tolerance for this kind."""
    return member.kind in {"stiff, loose", "nearly defective"}


TRIALS = [
    Trial(auto, None, 1e-4),
    Trial(auto, None, 1e-8),
    Trial(auto, None, 1e-2, loose),
    Trial(Gauss(4), None, 1e-5),
    Trial(Gauss(10), 40, 0.9),
    Trial(Gauss(10), None, 1e-2, loose),
    Trial(Gauss(16), None, 1e-8),
    Trial(Radau(3), None, 1e-3),
    Trial(Radau(5), None, 1e-5),
    Trial(Radau(9), 40, 0.9),
    Trial(Radau(5), None, 1e-1, loose),
    Trial(Radau(9), None, 1e-2, loose),
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


def outcomes(given: Member, trials: Iterable[Trial] = TRIALS) -> list[Outcome]:
    truth = given.truth()
    return [_outcome(given, trial, truth) for trial in trials if trial.suits(given)]


def _outcome(given: Member, trial: Trial, truth: Truth) -> Outcome:
    try:
        found = periodic(given.system, given.speed, trial.method, steps=trial.steps, rtol=trial.rtol)
    except SolveError as refusal:
        return Outcome(given.index, given.kind, trial, refusal=str(refusal))
    errors = _errors(found, truth.q, truth.multipliers)
    estimates, verdict = tuple(found.error_estimate), found.verdict
    wrong = contradicted(verdict, truth)
    outcome = Outcome(given.index, given.kind, trial, errors, estimates, verdict, truth.growth, wrong)
    if all(outcome.honest) or not given.formula:
        return outcome
    own = []
    for seed in range(_ROUNDINGS):
        again = _rounded_anew(given.system, seed)
        other = periodic(again, given.speed, found.certified.method, steps=found.steps, rtol=0.9)
        own.append(_errors(other, found.at(PHASES), found.multipliers))
    return replace(outcome, allowed=tuple(OWN_ERROR + np.max(own, axis=0)))


def _errors(found, q: np.ndarray, multipliers: np.ndarray) -> tuple[float, float]:
    return relative_error(found.at(PHASES), q), matched_error(found.multipliers, multipliers)


def _rounded_anew(system: PeriodicSystem, seed: int) -> PeriodicSystem:
    """Return the system with pseudorandom changes of up to half a unit in the last place of every entry."""

    def matrices(phase, speed):
        for number, part in enumerate(system.at(phase, speed)):
            entry = np.arange(part[0].size).reshape(part.shape[1:])
            turned = 1e7 * np.mod(phase, system.period).reshape(-1, *(1,) * entry.ndim)
            yield part * (1 + EPS / 2 * np.cos(turned + 3 * entry + number + 10 * seed))

    def rounded(phase, speed):
        return tuple(matrices(phase, speed))

    return PeriodicSystem(rounded, system.coordinates, period=system.period, breaks=system.breaks)


def contradicted(verdict: str, truth: Truth) -> bool:
    """Whether the reference contradicts the verdict."""
    radius = float(np.exp(truth.growth))
    return {
        "asymptotically stable": radius >= 1,
        "unstable": radius <= 1 + _TRUTH and not truth.defective,
        "stable": abs(radius - 1) > _ON_CIRCLE,
        "undetermined": False,
    }[verdict]


def matched_error(values: np.ndarray, truth: np.ndarray) -> float:
    """Return the largest distance between matched multipliers, relative to the true spectral radius. Missing
    and unknown multipliers count as 0."""
    count = max(len(values), len(truth))
    ours, theirs = (np.pad(each, (0, count - len(each))) for each in (np.nan_to_num(values), truth))
    distance = np.abs(ours[:, None] - theirs)
    largest = float(distance[linear_sum_assignment(distance)].max())
    radius = float(np.abs(truth).max())
    return largest / radius if max(radius, largest) > _NOTHING else 0.0


@dataclass(frozen=True)
class Rates:
    """Fractions of all orbits and multipliers.

    `honest`: the true error is at most 10 times the estimate plus the error of the reference. `sharp`: the
    estimate is at most 100 times the true error, if that is above `VISIBLE` and at most `NO_DIGIT`.
    `decided`: the verdict is not "undetermined".
    """

    name: str
    results: int
    refused: int
    honest: float
    visible: int
    sharp: float
    decided: float
    contradicted: int
    worst: Outcome | None

    def __str__(self) -> str:
        worst = "" if self.worst is None else f"; least honest: {self.worst}"
        return (
            f"{self.name:24s}{self.results:6d} results, {self.refused:3d} refused; honest "
            f"{100 * self.honest:6.2f} %; sharp {100 * self.sharp:6.2f} % of {self.visible}; decided "
            f"{100 * self.decided:6.2f} %; contradicted {self.contradicted}{worst}"
        )


def rates(name: str, found: list[Outcome]) -> Rates:
    results = [each for each in found if not each.refusal]
    errors = np.array([each.errors for each in results]).reshape(-1, 2)
    estimates = np.array([each.estimates for each in results]).reshape(-1, 2)
    honest = np.array([each.honest for each in results]).reshape(-1, 2)
    visible = errors > VISIBLE
    sharp = ((estimates <= 100 * errors) | (errors > NO_DIGIT))[visible]
    dishonest = [each for each, fine in zip(results, honest.all(axis=1), strict=True) if not fine]
    decided = [each.verdict != "undetermined" for each in results]
    return Rates(
        name,
        len(results),
        len(found) - len(results),
        float(honest.mean()) if results else np.nan,
        int(visible.sum()),
        float(sharp.mean()) if len(sharp) else np.nan,
        float(np.mean(decided)) if results else np.nan,
        sum(each.contradicted for each in results),
        max(dishonest, key=lambda each: each.ratio) if dishonest else None,
    )


def request_name(outcome: Outcome) -> str:
    """Return the name of the requested method and whether its steps were given."""
    return outcome.trial.name + (", given steps" if outcome.trial.steps else "")


def grouped(found: Iterable[Outcome], key: Callable[[Outcome], str]) -> dict[str, list[Outcome]]:
    groups: dict[str, list[Outcome]] = {}
    for each in found:
        groups.setdefault(key(each), []).append(each)
    return groups


def all_outcomes(indices: Iterable[int]) -> list[Outcome]:
    """Return the outcomes of every trial on every member."""
    return [outcome for index in indices for outcome in outcomes(member(index))]
