"""Mechanism for the tests of the command, which derive it, edit it and add faults."""

from derive import Mechanism, rate


def mechanism():
    rotor = Mechanism("rotor", "Rotor on an elastic shaft")
    (q,) = rotor.coordinates(q=("rad", "twist"))
    J, k = rotor.parameters(J=("kg m^2", "rotor", "> 0"), k=("N m/rad", "shaft", "> 0"))
    rotor.kinetic = J * rate(rotor.phase + q) ** 2 / 2
    rotor.potential = k * q**2 / 2
    return rotor
