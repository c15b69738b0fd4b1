"""Cam follower driven through an elastic shaft, from section 4.1 of the chapter."""

from derive import Heaviside, Max, Mechanism, Min, cos, rate, sin


def mechanism() -> Mechanism:
    """Return the mechanism with the energies (41)–(43), the virtual work (44) and the relations (45) of the
    chapter. The cam rotates by φ1 = φ + q1."""
    cam = Mechanism("cam", "Cam follower driven through an elastic shaft (chapter 4.1)")
    q1, q2, q3 = cam.coordinates(
        q1=("rad", "twist of the shaft"),
        q2=("m", "displacement of the follower relative to the cam"),
        q3=("m", "displacement of the output link relative to the follower"),
    )
    I0, I1, m2, m3 = cam.parameters(
        I0=("kg m^2", "moment of inertia of the motor side; no effect at constant speed", ">= 0"),
        I1=("kg m^2", "moment of inertia of the cam and its side of the shaft", "> 0"),
        m2=("kg", "mass of the follower", "> 0"),
        m3=("kg", "mass of the output link", "> 0"),
    )
    k1, k2, k3 = cam.parameters(
        k1=("N m/rad", "torsional stiffness of the shaft", "> 0"),
        k2=("N/m", "stiffness of follower, contact and cam bearing", "> 0"),
        k3=("N/m", "stiffness of the return spring and the support of the output link", "> 0"),
    )
    c1, c2, c3 = cam.parameters(
        c1=("N m s/rad", "damping of the shaft", ">= 0"),
        c2=("N s/m", "damping of the follower", ">= 0"),
        c3=("N s/m", "damping of the output link", ">= 0"),
    )
    P, R0 = cam.parameters(
        P=("N", "preload of the soft spring that closes the contact, if this is unilateral", "> 0"),
        R0=("m", "base radius of the cam, for the sliding speed", "> 0"),
    )
    U = cam.transmission("U", harmonics=12, unit="m")
    F = cam.series("F", harmonics=6, unit="N", meaning="load on the output link, opposite to y3")

    contact = cam.option("contact", ("bilateral", "unilateral"))

    phi1 = cam.phase + q1
    y1 = U(phi1)
    y2 = y1 + q2
    y3 = y2 + q3
    rotation = I0 * rate(cam.phase) ** 2 + I1 * rate(phi1) ** 2
    cam.kinetic = (rotation + m2 * rate(y2) ** 2 + m3 * rate(y3) ** 2) / 2
    pressed = contact.choose(bilateral=1, unilateral=0)
    cam.potential = (k1 * q1**2 + pressed * k2 * q2**2 + k3 * q3**2) / 2
    cam.dissipation = (c1 * rate(q1) ** 2 + pressed * c2 * rate(q2) ** 2 + c3 * rate(q3) ** 2) / 2
    cam.force(-F(cam.phase), along=y3)
    # The spring acts between follower and cam, as on the counter-profile of conjugate cams, so that it does
    # not twist the shaft. Its preload P equals the contact force at q = 0. Without adhesion, the contact
    # force is at least 0, so that it cannot decrease by more than P.
    extension = k2 * q2 + c2 * rate(q2)
    cam.force(-contact.choose(bilateral=0, unilateral=Min(P, extension)), along=q2)
    cam.input("u", "N m", along=phi1, meaning="torque on the cam in addition to that of the shaft")

    shaft_torque = k1 * q1 + c1 * rate(q1)
    contact_force = contact.choose(bilateral=-extension, unilateral=Max(0, P - extension))
    cam.output("shaft_torque", shaft_torque, "N m", "torque in the shaft, positive if the cam leads")
    cam.output("contact_force", contact_force, "N", "force of the follower on the cam, compression positive")
    cam.limit("contact_force", ">= 0", beyond="the follower lifts off the cam")
    opening = contact.choose(bilateral=Min(0, q2), unilateral=q2 - P / k2)
    closed = contact.choose(bilateral=1, unilateral=Heaviside(P - extension))
    sliding = (R0 + y1) * rate(phi1)
    cam.output("gap", opening, "m", "height of the follower above the undeformed cam, negative if pressed")
    cam.limit("gap", "<= 0", beyond="the follower lifts off the cam")
    cam.output("in_contact", closed, "1", "1 during contact, otherwise 0; mean: fraction of time in contact")
    cam.output(
        "wear", Max(0, contact_force) * sliding, "W", "contact force times sliding speed, flat-faced follower"
    )
    cam.output("output_displacement", y3, "m", "position y3 of the output link")
    cam.output("lift", U(cam.phase), "m", "lift U(φ) of the uniformly rotating cam")
    cam.trust(q1=0.05)

    radius, around = 0.5 * cam.metre, cam.around
    profile, block = radius + U(around), 0.2 * cam.metre
    cam.sketch("cam", [(profile * sin(around - phi1), profile * cos(around - phi1))])
    cam.sketch("mark", [(0, 0), (-radius / 2 * sin(phi1), radius / 2 * cos(phi1))])
    cam.sketch("follower", [(0, radius + y2), (0, radius + y2 + 2 * block)])
    foot, head = radius + y3 + 2 * block, radius + y3 + 4 * block
    cam.sketch("output", [(-block, foot), (block, foot), (block, head), (-block, head), (-block, foot)])
    return cam
