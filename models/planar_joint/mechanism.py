"""Slider-crank mechanism with a radial clearance between the bearing of the slider and the pin of the rod."""

from derive import Abs, Heaviside, Max, Mechanism, cos, rate, sin, sqrt


def mechanism() -> Mechanism:
    """Return the mechanism. The rod turns freely on the crank, and its pin can move in the bearing of the
    slider in both directions of the plane.

    If the distance of the pin from the centre of the bearing exceeds the radial clearance g by the
    penetration δ, the normal force k δ (1 + χ δ̇) acts. The damping is proportional to δ, so that the force
    is continuous. At u = v = 0, the contact force along the stroke is in static equilibrium with the constant
    load F: δ = F/k.
    """
    joint = Mechanism("planar_joint", "Slider-crank mechanism with a planar clearance joint")
    u, v = joint.coordinates(
        u=("m", "displacement of the pin in the bearing along the stroke, from static equilibrium under F"),
        v=("m", "displacement of the pin from the centre of the bearing, perpendicular to the stroke"),
    )
    r, L = joint.parameters(
        r=("m", "length of the crank", "> 0"), L=("m", "length of the connecting rod", "> 0")
    )
    joint.require(r < L, "the crank cannot turn fully")
    m, mr, J, F = joint.parameters(
        m=("kg", "mass of the slider", "> 0"),
        mr=("kg", "mass of the rod, whose centre of mass is in the middle", "> 0"),
        J=("kg m^2", "moment of inertia of the rod about its centre of mass", "> 0"),
        F=("N", "constant load on the slider towards the crank", "> 0"),
    )
    k, chi, c = joint.parameters(
        k=("N/m", "contact stiffness of pin and bearing", "> 0"),
        chi=("s/m", "factor χ of the contact damping", ">= 0"),
        c=("N s/m", "damping coefficient of the oil between pin and bearing", ">= 0"),
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
    joint.output("contact_force", force, "N", "normal force of the pin on the bearing")
    joint.output("gap", Max(0, g - distance), "m", "distance between pin and bearing, at most g")
    joint.output(
        "contact", Heaviside(distance - g), "1", "1 while pin and bearing touch; mean: fraction of time"
    )
    joint.output("wear", Abs(force * sliding), "W", "contact force times sliding speed")
    along = "position of the pin relative to the centre of the bearing, along the stroke"
    joint.output("pin_along", gap, "m", along)
    joint.output("position", slider, "m", "position of the centre of the bearing along the stroke")

    joint.sketch("rods", [(0, 0), (crank_x, crank_y), (crank_x + rod_x, v)])
    half, high = 2 * R, 3 * R / 2
    box = [(-half, -high), (half, -high), (half, high), (-half, high), (-half, -high)]
    joint.sketch("slider", [(slider + x, y) for x, y in box])
    return joint
