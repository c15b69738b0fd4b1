"""Slider-crank mechanism with a clearance joint between connecting rod and slider."""

from derive import Abs, Heaviside, Max, Mechanism, Min, cos, rate, sin, sqrt


def mechanism() -> Mechanism:
    """Return the mechanism. The bearing of the slider surrounds the pin of the rod with a clearance along the
    stroke.

    The contact force is k δ (1 + χ δ̇) for a penetration δ > 0. Its damping is proportional to δ, so that the
    force is continuous when contact begins and ends. The constant load presses the slider against the pin at
    q = 0.
    """
    crank = Mechanism("slider_crank", "Slider-crank mechanism with a clearance joint")
    (q,) = crank.coordinates(
        q=("m", "displacement of the slider relative to the pin, from static equilibrium under F")
    )
    r, L = crank.parameters(
        r=("m", "length of the crank", "> 0"), L=("m", "length of the connecting rod", "> 0")
    )
    crank.require(r < L, "the crank cannot turn fully")
    m, F = crank.parameters(
        m=("kg", "mass of the slider", "> 0"),
        F=("N", "constant load on the slider towards the crank", "> 0"),
    )
    k, chi, c = crank.parameters(
        k=("N/m", "contact stiffness of pin and bearing", "> 0"),
        chi=("s/m", "factor χ of the contact damping", ">= 0"),
        c=("N s/m", "damping coefficient of the oil between pin and bearing", ">= 0"),
    )
    g, R = crank.parameters(
        g=("m", "clearance along the stroke", ">= 0"),
        R=("m", "radius of the pin, for the sliding speed", "> 0"),
    )

    pin = r * cos(crank.phase) + sqrt(L**2 - r**2 * sin(crank.phase) ** 2)
    slider = pin + q
    penetration = F / k - q
    front = k * Max(0, penetration) * (1 - chi * rate(q))
    rear = k * Min(0, penetration + g) * (1 + chi * rate(q))
    contact_force = front + rear
    crank.kinetic, crank.dissipation = m * rate(slider) ** 2 / 2, c * rate(q) ** 2 / 2
    crank.force(contact_force, along=q)
    crank.force(-F, along=slider)

    swing = crank.speed * r * Abs(cos(crank.phase)) / sqrt(L**2 - r**2 * sin(crank.phase) ** 2)
    crank.output("contact_force", contact_force, "N", "force of the pin on the bearing, away from the crank")
    opening = Max(0, -penetration) - Max(0, -penetration - g)
    crank.output("gap", opening, "m", "distance of the pin from the loaded side of the bearing, at most g")
    front = "1 while the loaded side of the bearing touches the pin; mean: fraction of time"
    crank.output("front_contact", Heaviside(penetration), "1", front)
    crank.output("rear_contact", Heaviside(-penetration - g), "1", "1 while the other side touches the pin")
    crank.output("wear", Abs(contact_force) * R * swing, "W", "contact force times sliding speed")
    crank.output("position", slider, "m", "position of the slider along the stroke")

    joint = (r * cos(crank.phase), r * sin(crank.phase))
    crank.sketch("rods", [(0, 0), joint, (pin, 0)])
    half, high = 2 * R, 3 * R / 2
    box = [(-half, -high), (half, -high), (half, high), (-half, high), (-half, -high)]
    crank.sketch("slider", [(slider + x, y) for x, y in box])
    return crank
