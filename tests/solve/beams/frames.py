"""Structures assembled by hand, and reference solutions that share no code with the package."""

import numpy as np

from solve.beams.assembly import Beams, Properties
from solve.beams.links import freedoms


def beams(links, held, lengths, angles, kinds="cubic", counts=1, EA=1e4, EI=1.0, mu=1.0, masses=None):
    """Return beams from links (name, start, end, start rotation, end rotation[, inextensible]). `held` names
    the fixed joints. `angles` are numbers or functions of the phase."""
    rows = [(*link, False)[:6] for link in links]
    joints = dict.fromkeys(joint for _, start, end, *_ in rows for joint in (start, end))
    n = len(rows)

    def spread(value):
        return np.broadcast_to(np.asarray(value, dtype=float), (n,)).copy()

    def angle(phase):
        columns = [a(phase) if callable(a) else np.full(len(phase), float(a)) for a in angles]
        return np.stack(columns, axis=1)

    mass = np.array([(masses or {}).get(joint, 0.0) for joint in joints])
    properties = Properties(
        spread(lengths), np.zeros(n), spread(EA), spread(EI), spread(mu), np.zeros(n), mass, 0.0
    )
    kinds = [kinds] * n if isinstance(kinds, str) else kinds
    counts = [counts] * n if isinstance(counts, int) else counts
    chosen = freedoms(rows, [(joint, joint in held) for joint in joints], kinds, counts)
    return Beams(chosen, properties, angle)


def beam(left="clamped", right="free", kind="cubic", count=1, angle=0.3, **numbers):
    """Return a beam of length 1 with clamped, pinned or free ends. By default, EA is large."""
    rotation = {"clamped": ("", ""), "pinned": ("l", "r"), "free": ("l", "r")}
    held = [end for end, how in (("L", left), ("R", right)) if how != "free"]
    link = ("bar", "L", "R", rotation[left][0], rotation[right][1])
    return beams([link], held, 1.0, [angle], kind, count, **numbers)
