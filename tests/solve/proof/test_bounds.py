"""Bounds in proofs, compared with independent values: each must be at least as large, but not much larger.

If a bound is omitted or reduced, the first comparison fails.
"""

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm

pytest.importorskip("flint")

import solve
from solve.model.model import LinearisedModel
from solve.proof.balls import arb, precision
from solve.proof.curvature import Curvature
from solve.proof.enclosure import equation_of, period_of
from solve.proof.motion import second_derivatives
from solve.proof.nonlinear import _equation, _instructions
from solve.proof.regions import _RATIOS, Box, Plane, _bounds, _rectangle
from solve.proof.step import step
from solve.proof.transitions import transitions
from solve.proof.turn import Marching, turn
from tests.solve.newton.mechanisms import duffing, model_of
from tests.solve.proof.test_prove import exact_trace, mathieu


def test_transition_bounds_contain_the_matrix_exponential():
    """For undamped systems with constant coefficients, Ψ(t, s) = e^{A(t−s)} does not grow over many steps."""
    system = mathieu(delta=2500.0, epsilon=0.0, zeta=0.0)
    with precision(100):
        equation = equation_of(system, 1.0, False)
        computed = turn(equation, period_of(system), (), Marching(50, 4.0))
        bounds = transitions(computed)
    w = float(equation.frequencies[0])
    A = np.array([[0.0, w], [-2500.0 / w, 0.0]])
    at = np.linspace(0.0, np.pi, 2000)
    sizes = np.array([np.abs(expm(A * t)).sum(axis=1).max() for t in at])
    kappa, tau = sizes.max(), np.trapezoid(sizes, at)
    assert len(computed.steps) > 30
    assert kappa <= float(bounds.kappa) < 5 * kappa
    assert tau <= float(bounds.tau) < 10 * tau


@pytest.mark.parametrize("ratio", _RATIOS[:3])
def test_trace_and_determinant_satisfy_bounds_at_complex_values(ratio):
    plane, box = Plane(mathieu(zeta=0.01), ("delta", "epsilon"), 1.0), Box((3.0, 3.25), (0.5, 0.75))
    with precision(68):
        equation = plane.equation(box)
        sides = [(arb(low) + (arb(high) - low) * arb(0.5, 0.5)) for low, high in box]
        real = plane.moved(equation, *sides)
        ellipse = plane.moved(equation, *(_rectangle(side, ratio) for side in box))
        trace, determinant = map(float, _bounds(real, ellipse, period_of(plane.system), ()))
    rng = np.random.default_rng(3)
    found = []
    for angles in rng.uniform(0, 2 * np.pi, (3, 2)):
        z = [(ratio * np.exp(1j * a) + np.exp(-1j * a) / ratio) / 2 for a in angles]
        delta, epsilon = (low + (high - low) * (1 + x) / 2 for (low, high), x in zip(box, z, strict=True))
        found.append(abs(exact_trace(mpmath.mpc(delta), mpmath.mpc(epsilon), 0.01)))
        assert abs(mpmath.exp(-0.02 * mpmath.sqrt(mpmath.mpc(delta)) * mpmath.pi)) <= determinant
    assert max(found) <= trace
    assert determinant < 1.1


def test_bounds_of_a_step_contain_sampled_norms():
    system = solve.load("manipulator")
    with precision(140):
        equation = equation_of(system, 5.0, False)
        start, length = arb(0.3), arb(0.05)
        made = step(equation, start, length, 60, 40.0)
    advances, inverses = [], []
    with precision(140):
        P = equation.at(start, None)[0].mid().inv().mid()
        for at in np.linspace(0.3, 0.35, 40):
            m, r = equation.at(arb(at), None, P)
            inverse = np.linalg.inv(np.array([[float(x.mid()) for x in row] for row in m.table()]))
            r = np.array([[float(x.mid()) for x in row] for row in r.table()])[:, : 2 * equation.n]
            W = np.diag(equation.frequencies)
            A = np.vstack((np.hstack((0 * W, W)), -inverse @ r))
            advances.append(0.05 * np.abs(A).sum(axis=1).max())
            inverses.append(max(1.0, np.abs(inverse).sum(axis=1).max()))
    assert max(advances) <= float(made.advance) < 2 * max(advances)
    assert max(inverses) <= float(made.inverse) < 2 * max(inverses)


def test_nonlinear_remainder_is_below_the_curvature_bound():
    """For Duffing's oscillator, N(u) = α (3 q̄ u² + u³). It is evaluated for random perturbations u of the
    norm ρ."""
    numbers, speed, rho = {"zeta": 0.1, "k": 1.0, "alpha": 1.0, "f": 1.0}, 1.6, 0.01
    system = solve.nonlinear(model_of(duffing(), **numbers), speed).system
    assert isinstance(system, LinearisedModel)
    with precision(140):
        period = period_of(system.model)
        equation, motion = _equation(system, speed, period, False)
        computed = turn(equation, period, (), Marching(60, 12.0))
        second = _instructions(system.model, second_derivatives, False)
        curvature = Curvature.from_equation(equation, second, computed, arb(2))
        bound = float(curvature.over(arb(rho)))
    (T,), W, load = equation.modes[0], equation.frequencies[0], equation.load
    phases = np.linspace(0.0, 2 * np.pi, 500)
    q = motion.curve(phases)[0]
    # |u| ≤ ρ λ |T|, and g = −N/(T W Ω² λ).
    u = rho * load * abs(T) * np.array([[-1.0], [1.0]])
    N = numbers["alpha"] * (3 * q * u**2 + u**3)
    g = np.abs(N / (T * W * speed**2 * load)).max()
    assert g <= bound * rho**2 / 2 < 3 * g
