"""Hand-coded gear pair with backlash, integrated from event to event by SciPy's DOP853."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

M, C, K, E_K, ERROR = 0.5, 848.528137423857, 4e8, 0.1, 1e-6
RATE, LENGTH = np.sqrt(K / M), 1e-6
"""Units of time, 1/RATE, and of length, in which the equation is integrated."""


def integrated(start, speed, load=2000.0, half=5e-5, share=None, error=ERROR):
    """q and q̇/Ω after a period of the mesh from those at its start, in m; derivatives by them; phases of the
    events. In units x = (q + F/k)/LENGTH and τ = φ. share: of the rectangular stiffness."""
    w2, c = K / M / speed**2, C / M / speed
    mean, gap = load / K / LENGTH, 2 * half / LENGTH
    x, Phi = np.array(start) / LENGTH + [mean, 0.0], np.eye(2)
    edges = [] if share is None else [np.pi * share, 2 * np.pi - np.pi * share]
    phase, events = 0.0, []
    while phase < 2 * np.pi:
        at, rate = x
        side = 1 if at > 0 or (at == 0 and rate > 0) else -1 if at < -gap or (at == -gap and rate < 0) else 0
        last = min([edge for edge in edges if edge > phase + 1e-14], default=2 * np.pi)
        two = share is not None and not edges[0] <= phase + 1e-13 < edges[1]

        def stiffness(t, side=side, two=two):
            if not side:
                return 0.0
            change = np.cos(t) if share is None else 1.0 if two else -share / (1 - share)
            return w2 * (1 + E_K * change)

        def slope(t, y, side=side, stiffness=stiffness):
            k, offset = stiffness(t), gap if side < 0 else 0.0
            load_now = w2 * mean + error / LENGTH * np.cos(t)
            A = np.array([[0, 1], [-k, -c]])
            force = np.array([0, load_now - k * offset])
            return np.concatenate((A @ y[:2] + force, (A @ y[2:].reshape(2, 2)).ravel()))

        marks = {1: (0.0,), 0: (0.0, -gap), -1: (-gap,)}[side]
        passes = []
        for mark in marks:

            def passed(t, y, mark=mark):
                return y[0] - mark

            passed.terminal = True
            passed.direction = (-1 if mark == 0.0 else 1) if side else (1 if mark == 0.0 else -1)
            passes.append(passed)
        run = solve_ivp(
            slope,
            (phase, last),
            np.append(x, Phi.ravel()),
            "DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=passes,
        )
        phase, x, Phi = float(run.t[-1]), run.y[:2, -1].copy(), run.y[2:, -1].reshape(2, 2)
        if run.status == 1:
            which = next(k for k, found in enumerate(run.t_events) if len(found))
            x[0] = marks[which]
            events.append(phase)
    return (x - [mean, 0.0]) * LENGTH, Phi, events


def orbit(start, speed, **given):
    """State, multipliers and events of the periodic orbit near a state, by Newton's method."""
    x = np.array(start)
    for _ in range(20):
        after, Phi, events = integrated(x, speed, **given)
        step = np.linalg.solve(np.eye(2) - Phi, after - x)
        x = x + step
        if np.abs(step).max() < 1e-12 * np.abs(x).max():
            break
    return x, np.linalg.eigvals(Phi), events


def fold(start, speed, **given):
    """Speed at which det(Φ - I) = 0 on the orbit, near a state and a speed."""

    def equations(z):
        after, Phi, _ = integrated(z[:2] * LENGTH, z[2] * RATE, **given)
        return np.append(after / LENGTH - z[:2], np.linalg.det(Phi - np.eye(2)))

    found, _, flag, text = fsolve(
        equations, [start[0] / LENGTH, start[1] / LENGTH, speed / RATE], full_output=True, xtol=1e-12
    )
    assert flag == 1 or np.abs(equations(found)).max() < 1e-9, text
    return found[2] * RATE
