"""Linearisation files in the format of the OpenFAST regression tests, with known multipliers."""

import numpy as np

SPEED = 1.2
A = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-9.0, 1.0, -0.2, 0.1], [0.5, -16.0, 0.0, -0.3]])
"""ẏ = A y in fixed coordinates."""

_BLADES = [
    (f"1st edgewise bending-mode DOF of blade {blade} (internal DOF index = DOF_BE({blade},1))", "m")
    for blade in (1, 2)
]
_COORDINATES = [*_BLADES, ("Variable speed generator DOF (internal DOF index = DOF_GeAz)", "rad")]
STATES = tuple(
    [f"ED {text}, {unit}" for text, unit in _COORDINATES]
    + [f"ED First time derivative of {text}, {unit}/s" for text, unit in _COORDINATES]
)
KEPT = [0, 1, 3, 4]
INPUTS = ("ED Generator torque, Nm",)
OUTPUTS = ("ED YawBrMzp, (kN-m)", "ED Azimuth, (deg)")


def rotating_matrices(azimuth):
    """Return A, B, C and D in coordinates that rotate with the rotor, where y = S x."""
    c, s, zero = np.cos(azimuth), np.sin(azimuth), np.zeros((2, 2))
    R, dR = np.array([[c, s], [-s, c]]), SPEED * np.array([[-s, c], [-c, -s]])
    S, dS = np.block([[R, zero], [zero, R]]), np.block([[dR, zero], [zero, dR]])
    rotating = np.linalg.solve(S, A @ S - dS)
    every = np.zeros((6, 6))
    every[np.ix_(KEPT, KEPT)] = rotating
    every[2, 5] = 1.0
    B = np.zeros((6, 1))
    B[KEPT, 0] = np.linalg.solve(S, [0.0, 0.0, 1.0, 0.0])
    C = np.zeros((2, 6))
    C[0, KEPT] = S[0]
    C[1, 2] = 57.3
    return every, B, C, np.array([[0.5], [0.0]])


def _rows(descriptions, points, rotating, order):
    """Return the rows of a section."""
    rows = zip(descriptions, points, rotating, strict=True)
    return [
        f"{number:11d}  {point:19.12E}{'T' if turns else 'F':>53}{order:16d}         {text}"
        for number, (text, point, turns) in enumerate(rows, start=1)
    ]


def _matrix(name, values):
    rows = ["".join(f"{value:21.12E}" for value in row) for row in values]
    return [f"{name}: {values.shape[0]} x {values.shape[1]}", *rows, ""]


def lin_text(azimuth, speed=SPEED):
    """Return the text of a file."""
    every, B, C, D = rotating_matrices(azimuth)
    generator = (azimuth - np.pi / 2) % (2 * np.pi)
    states = _rows(STATES, (0.1, 0.2, generator, 0.0, 0.0, speed), (1, 1, 0, 1, 1, 0), 2)
    heads = [
        "   Row/Column Operating Point          Rotating Frame? Derivative Order Description",
        "   ---------- ---------------          --------------- ---------------- -----------",
    ]
    return "\n".join(
        [
            "",
            "Linearized model: Predictions were generated on 01-Jan-2026 using OpenFAST",
            " linked with  NWTC Subroutine Library; ElastoDyn",
            "",
            "Description from the FAST input file: Two blades in rotating coordinates",
            "",
            "Simulation information:",
            "   Simulation time:                    60.0000 s",
            f"   Rotor Speed:                  {speed:13.4f} rad/s",
            f"   Azimuth:                      {azimuth:13.4f} rad",
            "   Wind Speed:                          8.0000 m/s",
            f"   Number of continuous states:  {len(STATES):8d}",
            "   Number of discrete states:           0",
            "   Number of constraint states:         0",
            f"   Number of inputs:             {len(INPUTS):8d}",
            f"   Number of outputs:            {len(OUTPUTS):8d}",
            "   Jacobians included in this file?    No",
            "",
            "Order of continuous states:",
            *heads,
            *states,
            "",
            "Order of continuous state derivatives:",
            *heads,
            *states,
            "",
            "Order of inputs:",
            *heads,
            *_rows(INPUTS, (7.1,), (0,), 0),
            "",
            "Order of outputs:",
            *heads,
            *_rows(OUTPUTS, (0.0, 3.0), (0, 0), 0),
            "",
            "",
            "Linearized state matrices:",
            "",
            *_matrix("A", every),
            *_matrix("B", B),
            *_matrix("C", C),
            *_matrix("D", D),
        ]
    )


def write_set(folder, count=24, order=None, offset=0.0):
    """Write files for `count` azimuths, numbered in the given order."""
    azimuths = (np.arange(count) + offset) * 2 * np.pi / count
    for number, k in enumerate(order or range(count), start=1):
        (folder / f"run.{number}.lin").write_text(lin_text(azimuths[k]), encoding="utf-8")
        (folder / f"run.{number}.ED.lin").write_text("a module", encoding="utf-8")
    return str(folder / "run.*.lin")
