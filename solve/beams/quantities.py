"""The outputs of a structure of beams whose links move, by the kinds that its generated module names."""

from solve.arrays import Array
from solve.beams.joint_forces import joint_force
from solve.beams.points import Point
from solve.beams.state import State


def quantity(state: State, kind: str, number: int, place: float) -> Array:
    """Values (k,) of a kind of output at a place of a link, from 0 at its start to 1."""
    if kind == "strain_energy":
        return state.strain_energy()
    if kind in _OF_JOINTS:
        return joint_force(state, number, int(place))[_OF_JOINTS.index(kind)]
    point, angle = Point(state.motion.beams, number, place), state.positions.angle
    if kind == "deflection":
        return point.displacement(angle, state.q)[1]
    return point.stress(angle, state.q, kind.removeprefix("stress_"))


_OF_JOINTS = ("force_x", "force_y", "moment")
