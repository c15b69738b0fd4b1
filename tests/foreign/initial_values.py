"""Initial-value problems of the Test Set for IVP solvers, integrated from the given states."""

from functools import cache

import numpy as np
from scipy.interpolate import BPoly

import solve
from tests.foreign import car_axis, slider_crank
from tests.foreign.wall import Case, Source

SIMEON = Source(
    "B. Simeon; F. Mazzia, C. Magherini, F. Iavernaro",
    "Test Set for IVP solvers, slider crank",
    "2006",
    "rforge/bvpsolve, pkg/deTestSet/src/Ex_crank.f; equations in tpetzoldt/deSolve, pkg/daeSolve/src",
)
CAR = Source(
    "F. Mazzia, C. Magherini, F. Iavernaro",
    "Test Set for IVP solvers, car axis problem",
    "2006",
    "rforge/bvpsolve, pkg/deTestSet/src/Ex_car.f",
)


@cache
def motion(name):
    """Return q and q̇ (2, n) of the nonlinear motion at the time of the reference."""
    problem = {"crank": slider_crank, "car": car_axis}[name]
    model = solve.load(problem.mechanism, **problem.NUMBERS)
    end = problem.SPEED * problem.TIME
    turns = int(end // model.period) + 1
    transient = solve.transient(model, problem.SPEED, turns, problem.START, nonlinear=True, rtol=1e-6)
    whole = model.marcher(np.abs(transient.q).max(axis=1), 4096, 1e-13)
    state = np.concatenate((problem.START[0], problem.START[1] / problem.SPEED))
    for turn in range(turns):
        states = whole(state, turn * model.period, problem.SPEED)
        state = states[:2, :, -1].ravel()
    curve = BPoly.from_derivatives(whole.nodes, states.transpose(2, 0, 1))
    at = end - (turns - 1) * model.period
    return np.array([curve(at), curve.derivative()(at) * problem.SPEED])


def crank(name):
    q, qd = motion("crank")
    phase = slider_crank.SPEED * slider_crank.TIME
    return slider_crank.quantities(phase, q, qd)[name]


def car(name):
    (u, tilt), (ud, tiltd) = motion("car")
    phase = car_axis.SPEED * car_axis.TIME
    places = dict(zip(("xl", "yl", "xr", "yr"), car_axis.ends(phase, u, tilt), strict=True))
    speeds = zip(("xlv", "ylv", "xrv", "yrv"), car_axis.rates(phase, u, tilt, ud, tiltd), strict=True)
    return (places | dict(speeds))[name]


def printed(source, text, computed, reference):
    """Cases of one reference; what is left at 1e-7 is the initial state's nine digits."""
    return [
        Case(source, text, name, value, lambda name=name: computed(name), 1e-7 * abs(float(value)), slow=True)
        for name, value in reference.items()
    ]


CASES = [
    *printed(SIMEON, "cranksoln", crank, slider_crank.REFERENCE),
    *printed(CAR, "carsoln", car, car_axis.REFERENCE),
]
