"""Export of a controller: C code with a table over the phase, and matrices for MATLAB."""

import re
from io import BytesIO
from typing import NamedTuple

import numpy as np

from solve.arrays import Array, uniform_phases
from solve.results.contents import versions
from solve.results.controller import Controller

_STABLE = 2.7
"""Largest product of time step and decay rate for which the Runge–Kutta method of order 4 is stable: 2.785
for real eigenvalues, reduced by a margin."""


class Tables(NamedTuple):
    """Matrices (m, …) at uniform phases, for u = −K x + f and, with an observer, x̂′ = A x̂ + b + L y."""

    phase: Array
    K: Array
    f: Array
    A: Array
    b: Array
    L: Array

    @classmethod
    def at_phases(cls, result: Controller, phase: Array) -> "Tables":
        count, N = len(phase), len(result.states)
        A, b, L = np.zeros((count, N, N)), np.zeros((count, N)), np.zeros((count, N, 0))
        if result.compensator is not None:
            A, b, L, _, _ = result.compensator.equations_at(phase, result.speed)
        return cls(phase, result.gain(phase), result.feedforward(phase), A, b, L)

    @classmethod
    def interpolated(cls, result: Controller, samples: int) -> "tuple[Tables, float]":
        """Matrices at `samples` steps of a period and at its end, and the relative error of linear
        interpolation between them."""
        step = result.system.period / samples
        phase = np.arange(samples + 1) * step
        tables, between = (cls.at_phases(result, phases) for phases in (phase, phase[:-1] + step / 2))
        pairs = zip(tables[1:], between[1:], strict=True)
        return tables, max(_interpolation_error(at[:-1], middle) for at, middle in pairs)


def controller_name(result: Controller) -> str:
    """Name of a controller as a C identifier."""
    name = re.sub(r"\W", "_", f"{result.system.labels.name}_controller", flags=re.ASCII)
    return name if name[:1].isalpha() else f"c_{name}"


def controller_mat(result: Controller, samples: int) -> bytes:
    """Content of a .mat file with K, f and, with an observer, A, b and L at `samples` phases. The phase is
    the last index."""
    from scipy.io import savemat

    tables = Tables.at_phases(result, uniform_phases(samples, result.system.period))
    content = {name: np.moveaxis(array, 0, -1) for name, array in tables._asdict().items()}
    if result.compensator is None:
        content = {name: content[name] for name in ("phase", "K", "f")}
    content |= {
        "speed": result.speed,
        "phase_period": result.system.period,
        "states": np.array(result.states, dtype=object),
        "inputs": np.array(result.signals, dtype=object),
        "measured": np.array([] if result.observer is None else result.observer.signals, dtype=object),
        "multipliers": result.multipliers,
        "verdict": result.verdict,
    }
    stream = BytesIO()
    savemat(stream, content, appendmat=False, oned_as="column")
    return stream.getvalue()


def controller_code(result: Controller, stem: str, samples: int) -> tuple[str, str, list[str]]:
    """Return the contents of FILE.c and FILE.h, for FILE = `stem`, and warnings.

    Matrices are interpolated linearly between samples. Estimates are advanced by the Runge–Kutta method of
    order 4, with constant measured quantities."""
    with_end, error = Tables.interpolated(result, samples)
    period, tables = result.system.period, Tables(*(table[:-1] for table in with_end))
    name = controller_name(result)
    observer = result.compensator is not None
    numbers = versions()["parametric-vibration"]
    signals = "x_hat" if observer else "x"
    lines = [
        f"/* Feedback u = -K(phase) {signals} + f(phase) of {result.system.labels.name.replace('*/', '')},",
        f"   designed for {result.speed!r} rad/s; written by parametric-vibration {numbers}. SI units.",
        f"   x: {', '.join(result.states)}; u: {', '.join(result.signals)}",
        f"   {samples} phases per {period!r} rad, interpolated linearly with the relative error {error:.1e}.",
    ]
    prototypes = [f"void {name}(double phase, const double *x, double *u)"]
    if result.observer is not None:
        fastest = np.abs(np.linalg.eigvals(tables.A)).max()
        lines.append(
            f"   y: {', '.join(result.observer.signals)}. {name}_observe advances the estimates x by the"
        )
        lines.append(f"   time dt, below {_STABLE / fastest:.2e} s, with y held constant.")
        prototypes.append(f"void {name}_observe(double phase, double dt, const double *y, double *x)")
    banner = "\n".join(lines) + " */\n"
    guard = f"{name.upper()}_H"
    declared = "".join(f"{each};\n" for each in prototypes)
    header = f"{banner}#ifndef {guard}\n#define {guard}\n{declared}#endif\n"
    used = tables._asdict() if observer else {"K": tables.K, "f": tables.f}
    body = [f'{banner}#include "{stem}.h"\n#include <math.h>\n', f"#define SAMPLES {samples}\n"]
    body += [_table(key, array) for key, array in used.items() if key != "phase"]
    body.append(_COMMON.replace("PERIOD", repr(period)))
    N, r = len(result.states), len(result.signals)
    body.append(_CONTROL.format(prototype=prototypes[0], N=N, r=r))
    if observer:
        y, advance = tables.L.shape[2], repr(result.speed)
        body.append(_OBSERVE.format(prototype=prototypes[1], N=N, y=y, speed=advance))
    return "".join(body), header, [*result.warnings, *table_warnings(result, samples, error)]


def table_warnings(result: Controller, samples: int, error: float) -> list[str]:
    """Warnings about tables with `samples` phases. error: relative error of the linear interpolation."""
    jumps = result.system.breaks and error > result.rtol
    doubts = [f"tables of {samples} phases have a relative error of {error:.1e}"] if error > 1e-2 else []
    jump = "the gains may jump; the tables replace a jump with a ramp over one sample"
    return doubts + ([jump] if jumps else [])


def _interpolation_error(at: Array, between: Array) -> float:
    """Largest error of linear interpolation, relative to the largest entry. `at` contains the samples,
    `between` the exact values halfway between them."""
    largest = np.abs(at).max(initial=0.0)
    middle = (at + np.roll(at, -1, axis=0)) / 2
    return float(np.abs(between - middle).max(initial=0.0) / largest) if largest else 0.0


def _table(name: str, array: Array) -> str:
    rows = array.reshape(len(array), -1)
    values = ",\n".join("{" + ", ".join(repr(float(value)) for value in row) + "}" for row in rows)
    return f"static const double table_{name}[SAMPLES][{max(rows.shape[1], 1)}] = {{\n{values}\n}};\n"


_COMMON = """
static double place(double phase, int *low, int *high) {
  double s = phase / PERIOD, t;
  s = (s - floor(s)) * SAMPLES;
  *low = (int)s % SAMPLES;
  *high = (*low + 1) % SAMPLES;
  t = s - floor(s);
  return t;
}
#define AT(name, k) ((1 - t) * table_##name[low][k] + t * table_##name[high][k])
"""

_CONTROL = """
{prototype} {{
  int low, high, i, j;
  double t = place(phase, &low, &high);
  for (i = 0; i < {r}; i++) {{
    u[i] = AT(f, i);
    for (j = 0; j < {N}; j++) u[i] -= AT(K, i * {N} + j) * x[j];
  }}
}}
"""

_OBSERVE = """
static void rates(double phase, const double *y, const double *x, double *rate) {{
  int low, high, i, j;
  double t = place(phase, &low, &high);
  for (i = 0; i < {N}; i++) {{
    rate[i] = AT(b, i);
    for (j = 0; j < {N}; j++) rate[i] += AT(A, i * {N} + j) * x[j];
    for (j = 0; j < {y}; j++) rate[i] += AT(L, i * {y} + j) * y[j];
  }}
}}

{prototype} {{
  static const double nodes[4] = {{0, 0.5, 0.5, 1}}, weights[4] = {{1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}};
  double start[{N}], trial[{N}], rate[{N}] = {{0}};
  int i, k;
  for (i = 0; i < {N}; i++) start[i] = x[i];
  for (k = 0; k < 4; k++) {{
    for (i = 0; i < {N}; i++) trial[i] = start[i] + nodes[k] * dt * rate[i];
    rates(phase + nodes[k] * dt * {speed}, y, trial, rate);
    for (i = 0; i < {N}; i++) x[i] += weights[k] * dt * rate[i];
  }}
}}
"""
