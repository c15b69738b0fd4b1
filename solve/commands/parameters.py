"""Commands for parameters and for natural frequencies: `sensitivity`, `fit`, `optimise`, `tolerances` and
`frequencies`."""

from typing import Annotated

import numpy as np

import solve
from solve.commands.deliver import deliver_result
from solve.commands.groups import Accuracy, Execution, Problem, Results, Speed, SpeedOrSpeeds, Steps
from solve.commands.parse import Flag, assignments, listed, points, require_with
from solve.errors import MissingValueError, NoResultError, ValueOutOfBoundsError
from solve.results.files import checked
from solve.results.frequencies import Findings
from solve.studies import frequencies as study
from solve.units import apart, quantity

_Bounds = Annotated[
    list[str] | None,
    Flag("Bounds of one or more parameters, unit optional; repeatable.", '"NAME,NAME=A:B unit"'),
]
_Vary = Annotated[
    list[str] | None,
    Flag(
        "Tolerance or distribution of a parameter, in addition to those of the case; repeatable.",
        '"NAME=±2 %"',
    ),
]


def sensitivity(
    problem: Problem,
    speeds: SpeedOrSpeeds,
    accuracy: Steps,
    results: Results,
    of: Annotated[
        list[str] | None,
        Flag(
            "Quantity, for example q3.max_abs, spectral_radius, rho1.abs or exponent1.re; repeatable.",
            "QUANTITY",
        ),
    ] = None,
    by: Annotated[
        list[str] | None,
        Flag(
            "Parameter, or speed, with respect to which to differentiate; repeatable; all by default.", "NAME"
        ),
    ] = None,
    nonlinear: Annotated[bool, Flag("Use the orbit of the nonlinear equations.")] = False,
    periods: Annotated[
        int | None,
        Flag("With --nonlinear: period of the orbit, in periods of the system; 1 by default.", "K"),
    ] = None,
) -> None:
    """Derivatives of quantities with respect to parameters and speed, at one or many speeds."""
    require_with("--nonlinear", nonlinear, {"--periods": periods})
    model = problem.loaded()
    task = of, by, accuracy.rule, accuracy.steps, accuracy.rtol
    if speeds.speeds is not None:
        over = solve.sensitivities_over(model, speeds.omegas(), *task, nonlinear=nonlinear, periods=periods)
        return deliver_result(results, over, problem.choices)
    result = solve.sensitivities(model, speeds.omega(model), *task, nonlinear=nonlinear, periods=periods)
    sensitivities = result.found.values()
    if all(one.reason and np.isnan(one.derivatives).all() for one in sensitivities):
        raise NoResultError("; ".join(one.reason for one in sensitivities))
    return deliver_result(results, result, problem.choices, result.notes)


def fit(
    problem: Problem,
    speed: Speed,
    accuracy: Accuracy,
    results: Results,
    data: Annotated[
        str | None, Flag("File of measured vibration (.csv, .mat, .uff), with units.", "FILE")
    ] = None,
    free: Annotated[str | None, Flag("Parameters to fit, separated by commas.", "k1,k2")] = None,
    bounds: _Bounds = None,
    robust: Annotated[
        bool, Flag("Let large residuals contribute their moduli instead of their squares.")
    ] = False,
    toml: Annotated[str | None, Flag("Write the fitted model as a case file (.toml).", "FILE")] = None,
) -> None:
    """Fit of parameters to measured vibration, with confidence intervals."""
    if data is None or free is None:
        missing = "--data FILE" if data is None else "--free NAME,NAME"
        raise MissingValueError(f"a fit requires measured data and free parameters; add {missing}")
    case = None if toml is None else checked(toml, [".toml"], "case")
    names, limits = _free_names(free), _bounds(bounds)
    model = problem.loaded()
    omega = speed.speed or model.labels.case_speed
    result = solve.fit(model, data, names, limits, omega, robust, accuracy.rule, accuracy.rtol)
    further = {} if case is None else {case: lambda: result.toml}
    deliver_result(results, result, problem.choices, beside=further)


def optimise(
    problem: Problem,
    speeds: SpeedOrSpeeds,
    accuracy: Accuracy,
    results: Results,
    minimise: Annotated[
        str | None, Flag("Quantity to minimise, such as q3.max_abs or spectral_radius.", "QUANTITY")
    ] = None,
    free: Annotated[str | None, Flag("Free parameters, separated by commas.", "a1,a3")] = None,
    bounds: _Bounds = None,
    keep: Annotated[
        list[str] | None, Flag("Value or curve to keep unchanged; repeatable.", '"NAME@A:B deg"')
    ] = None,
    subject: Annotated[
        list[str] | None, Flag("Constraint on a quantity; repeatable.", '"QUANTITY < NUMBER"')
    ] = None,
    starts: Annotated[
        int, Flag("Number of starting points; the first has the given parameter values.", "N")
    ] = 1,
    prove: Annotated[bool, Flag("Prove the verdicts of the optimum; requires python-flint.")] = False,
    robust: Annotated[
        str | None,
        Flag(
            "Minimise, under tolerances, the mean plus K standard deviations, or a quantile such as 95%.", "K"
        ),
    ] = None,
    vary: _Vary = None,
    toml: Annotated[str | None, Flag("Write the optimal model as a case file (.toml).", "FILE")] = None,
    feedback: Annotated[
        str | None, Flag("Optimise the gains of feedback of these quantities.", '"q1, q1_dot"')
    ] = None,
    gain_harmonics: Annotated[int, Flag("Highest harmonic of the gains.", "K")] = 0,
    delay: Annotated[str | None, Flag("Delay of the feedback.", '"0.5 ms"')] = None,
    notch: Annotated[
        list[str] | None, Flag("Notch frequency of the feedback signals; repeatable.", '"18 Hz"')
    ] = None,
) -> None:
    """Optimal parameters: least vibration at several speeds, with stability and within bounds."""
    if minimise is None or (free is None and feedback is None):
        missing = "--minimise QUANTITY" if minimise is None else "--free NAME,NAME"
        raise MissingValueError(f"an optimum requires a quantity and free parameters; add {missing}")
    case = None if toml is None else checked(toml, [".toml"], "case")
    names, limits = _free_names(free or ""), _bounds(bounds)
    model = problem.loaded()
    if feedback is not None:
        if toml is not None or robust is not None:
            raise ValueOutOfBoundsError("--feedback allows neither --toml nor --robust; omit them")
        measured = listed("--feedback", feedback)
        model = solve.OutputFeedback(model, measured, gain_harmonics, delay or 0.0, notches=notch or ())
        limits = model.bounds_of_gains(limits)
        names += model.gains
    of_feedback = {"--gain-harmonics": gain_harmonics or None, "--delay": delay, "--notch": notch}
    require_with("--feedback NAME", feedback is not None, of_feedback)
    if missing := [name for name in names if name not in limits]:
        raise MissingValueError(f"{missing[0]} is free without bounds; add --bounds {missing[0]}=A:B")
    if not_free := [name for name in limits if name not in names]:
        raise ValueOutOfBoundsError(
            f"bounds are given for {not_free[0]}, which is not free; add it to --free, or omit its bounds"
        )
    ranges = {name: limits[name] for name in names}
    requirements = keep or (), subject or (), starts
    require_with("--robust K", robust is not None, {"--vary": vary})
    spreads = assignments("--vary", vary or [], "NAME=±2%")
    options = {"method": accuracy.rule, "rtol": accuracy.rtol, "prove": prove}
    result = solve.optimise(
        model, minimise, ranges, speeds.given(model), *requirements, **options, robust=robust, vary=spreads
    )
    further = {} if case is None else {case: lambda: result.toml}
    deliver_result(results, result, problem.choices, beside=further)


def tolerances(
    problem: Problem,
    speeds: SpeedOrSpeeds,
    accuracy: Accuracy,
    execution: Execution,
    results: Results,
    vary: _Vary = None,
    subject: Annotated[
        list[str] | None, Flag("Limit of a quantity; repeatable.", '"QUANTITY < NUMBER"')
    ] = None,
    of: Annotated[
        list[str] | None,
        Flag("Further quantity for Sobol indices and worst points; repeatable.", "QUANTITY"),
    ] = None,
    samples: Annotated[int, Flag("Number of samples for the probabilities.", "N")] = 4096,
    index_samples: Annotated[
        int, Flag("Base number of samples for the Sobol indices; 0 for no indices.", "N")
    ] = 256,
    seed: Annotated[int, Flag("Seed of the random numbers.", "N")] = 0,
) -> None:
    """Effects of parameter tolerances: probability of instability, Sobol indices, worst points."""
    spreads = assignments("--vary", vary or [], "NAME=±2%")
    model = problem.loaded()
    sizes = samples, index_samples, accuracy.rule, accuracy.rtol
    with execution.given() as resources:
        result = solve.tolerances(
            model, speeds.given(model), spreads, subject or (), of or (), *sizes, seed=seed, **resources
        )
    deliver_result(results, result, problem.choices)


def _free_names(text: str) -> list[str]:
    """Names from the text of --free. Raises ValueOutOfBoundsError for names with values or bounds."""
    names = listed("--free", text)
    for name, equals, _ in (each.partition("=") for each in names):
        if equals:
            bounds = text if ":" in text and len(names) == 1 else f"{name}=A:B"
            raise ValueOutOfBoundsError(
                f"--free is '{text}'; give only names; the bounds have their own flag: "
                f'--free {name} --bounds "{bounds}"'
            )
    return names


def _bounds(texts: list[str] | None) -> dict[str, tuple[float | str, float | str]]:
    """Return a mapping from names to lower and upper bounds. Bounds with a unit are strings. One string may
    specify the same bounds for several names, separated by commas. Raises ValueOutOfBoundsError."""
    bounds = {}
    given = [
        f"{name}{equals}{text}"
        for names, equals, text in (each.partition("=") for each in texts or [])
        for name in (names.split(",") if equals else [names])
    ]
    for name, text in assignments("--bounds", given, "NAME=A:B").items():
        try:
            numbers, _, unit = apart(text).partition(" ")
            low, high = (quantity(f"{number} {unit}".strip()) for number in numbers.split(":"))
        except ValueError:
            raise ValueOutOfBoundsError(
                f"--bounds {name}={text}: write two numbers in the model's unit, such as "
                f"--bounds {name}=1e4:1e6, or with one unit after both"
            ) from None
        bounds[name] = low, high
    return bounds


def frequencies(
    problem: Problem,
    results: Results,
    position: Annotated[str | None, Flag("Position of the drive; 0 by default.", '"70 deg"')] = None,
    count: Annotated[
        int | None, Flag("Number of modes, starting from the lowest; 4 by default.", "N")
    ] = None,
    turn: Annotated[
        int | None, Flag("Add the frequencies at N positions over a revolution, and their means.", "N")
    ] = None,
    over: Annotated[
        list[str] | None,
        Flag(
            "Add the frequencies for N values of a parameter, as means over the revolution or at --position.",
            '"NAME=A:B:N unit"',
        ),
    ] = None,
    modes: Annotated[bool, Flag("Add the mode shapes of a structure.")] = False,
) -> None:
    """Natural frequencies and mode shapes with the drive held still."""
    if over and len(over) > 1:
        raise ValueOutOfBoundsError(f"--over is given {len(over)} times; vary one parameter per run")
    varied = points("--over", over[0]) if over else None
    model = problem.loaded(still=True, varied={} if varied is None else dict([varied]))
    study.require_position(model, position)
    here = study.frequencies(model, position or 0.0, count)
    revolution = None if turn is None else study.frequencies(model, study.turn(model, turn), count)
    variation = None
    if varied is not None:
        positions = here.positions
        if position is None and model.labels.moves:
            positions = study.turn(model, turn or study.TURN)
        variation = study.frequencies_over(model, *varied, positions, count)
    first = [name for name in varied[:1] if name in problem.unset(problem.model)] if varied else []
    result = Findings(here, revolution, variation, here.shapes() if modes else (), first)
    deliver_result(results, result, problem.choices)
