"""The state space of a system, with its Floquet multipliers, for MATLAB."""

from io import BytesIO
from typing import Any

import numpy as np

from solve.arrays import Array
from solve.exports.state_space import StateSpace
from solve.results.contents import versions
from solve.results.stability import Stability


def mat_file(space: StateSpace, stability: Stability) -> bytes:
    """Content of a .mat file. In MATLAB the phase counts last: A(:,:,k) is A at phase(k)."""
    from scipy.io import savemat

    system, found, names = space.system, space.coefficients, space.signals
    parts = {
        "M": found.mass,
        "Cq": found.damping,
        "K": found.stiffness,
        "d": found.d,
        "A": found.A,
        "B": found.B,
        "C": found.C,
        "D": found.D,
        "y0": found.y0,
    }
    content: dict[str, Any] = {name: np.moveaxis(part, 0, -1) for name, part in parts.items()}
    texts = {name: _cells(values) for name, values in names._asdict().items()}
    labels = system.parameter_labels
    content |= {
        "phase": space.phase,
        "speed": float(space.speed),
        "period": system.period / space.speed,
        "phase_period": system.period,
        "multipliers": stability.multipliers,
        "exponents": stability.exponents,
        "spectral_radius": stability.spectral_radius,
        "verdict": stability.verdict,
        **texts,
        "parameter_names": _cells(tuple(system.parameters)),
        "parameter_values": np.array(list(system.parameters.values()), dtype=float),
        "parameter_units": _cells(tuple(labels[name][0] for name in system.parameters)),
        "model": system.name,
        "title": system.title,
        "model_case": str(system.case or ""),
        "options": _cells(tuple(f"{name}={value}" for name, value in system.options.items())),
        "warnings": _cells(tuple(stability.warnings)),
        "versions": _cells(tuple(f"{name} {version}" for name, version in versions().items())),
    }
    stream = BytesIO()
    savemat(stream, content, appendmat=False, oned_as="column")
    return stream.getvalue()


def _cells(texts: tuple[str, ...]) -> Array:
    """A column of cells, which MATLAB has for texts of different lengths."""
    return np.array(texts, dtype=object)
