"""Slider-crank mechanism with a radial clearance between the bearing of the slider and the pin of the rod."""

from derive import Abs, Heaviside, Max, Mechanism, cos, rate, sin, sqrt


def mechanism() -> Mechanism:
    """Return the mechanism. The rod turns freely on the crank, and its pin can move in the bearing of the
    slider in both directions of the plane.

    If the distance of the pin from the centre of the bearing exceeds the radial clearance g by the
    penetration δ, the normal force k δ (1 + χ δ̇) acts. The damping is proportional to δ, so that the force
    is continuous. At u = v = 0, the constant load presses the bearing on the pin along the stroke.
    """
    joint = Mechanism("planar_joint", "Slider-crank mechanism with a planar clearance joint")
    u, v = joint.coordinates(
        u=("m", "pin in the bearing along the stroke, from the position under the load"),
        v=("m", "pin in the bearing perpendicular to the stroke"),
    )
    r, L = joint.parameters(r=("m", "crank", "> 0"), L=("m", "connecting rod", "> 0"))
    joint.require(r < L, "the crank cannot turn fully")
    m, mr, J, F = joint.parameters(
        m=("kg", "slider", "> 0"),
        mr=("kg", "rod, with its centre of mass in the middle", "> 0"),
        J=("kg m^2", "rod, about its centre of mass", "> 0"),
        F=("N", "constant load on the slider towards the crank", "> 0"),
    )
    k, chi, c = joint.parameters(
        k=("N/m", "contact of pin and bearing", "> 0"),
        chi=("s/m", "damping of the contact, relative to its force", ">= 0"),
        c=("N s/m", "damping of the pin in the bearing by the oil", ">= 0"),
    )
    g, R = joint.parameters(
        g=("m", "radial clearance", "> 0"), R=("m", "radius of the pin, for the sliding speed", "> 0")
    )

    crank_x, crank_y = r * cos(joint.phase), r * sin(joint.phase)
    rod_x, rod_y = sqrt(L**2 - (v - crank_y) ** 2), v - crank_y
    gap = g + F / k + u
    distance = sqrt(gap**2 + v**2)
    slider = crank_x + rod_x - gap
    force = k * Max(0, distance - g) * (1 + chi * rate(distance))

    turning = rate(rod_y) / rod_x
    middle_x, middle_y = crank_x + rod_x / 2, crank_y + rod_y / 2
    rod = mr * (rate(middle_x) ** 2 + rate(middle_y) ** 2) + J * turning**2
    joint.kinetic = (m * rate(slider) ** 2 + rod) / 2
    joint.dissipation = c * (rate(u) ** 2 + rate(v) ** 2) / 2
    joint.force(-force, along=distance)
    joint.force(-F, along=slider)

    sliding = (gap * rate(v) - v * rate(u)) / distance + R * turning
    joint.output("contact_force", force, "N", "pin on bearing, along the normal")
    joint.output("gap", Max(0, g - distance), "m", "between pin and bearing, at most g")
    joint.output(
        "contact", Heaviside(distance - g), "1", "1 while pin and bearing touch; mean: fraction of time"
    )
    joint.output("wear", Abs(force * sliding), "W", "contact force times sliding speed")
    joint.output("pin_along", gap, "m", "pin from the centre of the bearing, along the stroke")
    joint.output("position", slider, "m", "centre of the bearing along the stroke")

    joint.sketch("rods", [(0, 0), (crank_x, crank_y), (crank_x + rod_x, v)])
    half, high = 2 * R, 3 * R / 2
    box = [(-half, -high), (half, -high), (half, high), (-half, high), (-half, -high)]
    joint.sketch("slider", [(slider + x, y) for x, y in box])
    return joint
