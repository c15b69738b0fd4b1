"""Transport manipulator of a forging press, from section 4.3 of the chapter."""

from derive import Mechanism, cos, rate, sin


def mechanism() -> Mechanism:
    """Return the mechanism with the energies from which Eq. (77) of the chapter follows. The cam rotates by
    φ1 = φ + q1."""
    press = Mechanism("manipulator", "Transport manipulator of a forging press (chapter 4.3)")
    q1, q2 = press.coordinates(
        q1=("rad", "twist of the driving shaft"),
        q2=("m", "displacement of the hammer relative to the cam"),
    )
    I0, I1, m2 = press.parameters(
        I0=("kg m^2", "moment of inertia of the motor side; no effect at constant speed", ">= 0"),
        I1=("kg m^2", "moment of inertia of the cam and its side of the shaft", "> 0"),
        m2=("kg", "mass of the operating mechanism (hammer)", "> 0"),
    )
    k1, k2 = press.parameters(
        k1=("N m/rad", "torsional stiffness of the driving shaft", "> 0"),
        k2=("N/m", "stiffness between cam and hammer", "> 0"),
    )
    c1, c2 = press.parameters(
        c1=("N m s/rad", "damping of the driving shaft", ">= 0"),
        c2=("N s/m", "damping between cam and hammer", ">= 0"),
    )
    (F,) = press.parameters(F=("N", "load on the hammer, opposite to its displacement"))
    U = press.transmission("U", harmonics=12, unit="m")

    phi1 = press.phase + q1
    y = U(phi1) + q2
    press.kinetic = (I0 * rate(press.phase) ** 2 + I1 * rate(phi1) ** 2 + m2 * rate(y) ** 2) / 2
    press.potential = (k1 * q1**2 + k2 * q2**2) / 2
    press.dissipation = (c1 * rate(q1) ** 2 + c2 * rate(q2) ** 2) / 2
    press.force(-F, along=y)
    press.input("u", "N m", along=phi1, meaning="torque on the cam in addition to that of the shaft")

    load_torque = -(k1 * q1 + c1 * rate(q1))
    press.output("load_torque", load_torque, "N m", "torque in the driving shaft, positive if the cam lags")
    press.output("hammer_displacement", y, "m", "position of the hammer")
    # Linear and nonlinear amplitudes differ by up to 3.3 % at 0.115 rad and by 6 % at 0.16 rad.
    press.trust(q1=0.12)

    radius, around = 0.5 * press.metre, press.around
    profile, head = radius + U(around), 0.2 * press.metre
    press.sketch("cam", [(profile * sin(around - phi1), profile * cos(around - phi1))])
    press.sketch("mark", [(0, 0), (-radius / 2 * sin(phi1), radius / 2 * cos(phi1))])
    foot, top = radius + y, radius + y + 3 * head
    press.sketch(
        "hammer",
        [(0, foot), (0, top), (-head, top), (-head, top + head), (head, top + head), (head, top), (0, top)],
    )
    return press
