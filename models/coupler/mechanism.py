"""Flexible coupler of a four-bar linkage, from Section 3 of the paper."""

from derive import Abs, Mechanism, cos, pi, rate, sin, sqrt


def mechanism() -> Mechanism:
    """Return the mechanism: an elastic coupler between crank pin A and joint B of an otherwise rigid linkage.

    x is the position along the chord AB, and the deflection w is positive at +90° from the chord. The coupler
    is inextensible. Velocities are resolved along and across the chord. The axial force follows from the
    energy terms that contain the shortening u due to the deflection.
    """
    linkage = Mechanism("coupler", "Flexible coupler of a four-bar linkage (paper, Section 3)")
    l1, l2, l3, l4 = linkage.parameters(
        l1=("m", "length of the ground line between the pivots of crank and follower", "> 0"),
        l2=("m", "length of the crank", "> 0"),
        l3=("m", "length of the coupler", "> 0"),
        l4=("m", "length of the follower", "> 0"),
    )
    s4, m4, E, A, I = linkage.parameters(  # noqa: E741 - the field's symbol
        s4=("m", "distance of the follower's centre of mass from the pivot of the follower", ">= 0"),
        m4=("kg", "mass of the follower", ">= 0"),
        E=("Pa", "modulus of elasticity of the coupler", "> 0"),
        A=("m^2", "cross-sectional area of the coupler", "> 0"),
        I=("m^4", "second moment of area of the coupler", "> 0"),
    )
    rho, cx, cy, JC = linkage.parameters(
        rho=("kg/m^3", "density of the coupler", "> 0"),
        cx=("N s/m^2", "drag coefficient per unit length for motion along the coupler", ">= 0"),
        cy=("N s/m^2", "drag coefficient per unit length for motion normal to the coupler", ">= 0"),
        JC=("kg m^2", "moment of inertia of the follower about its pivot", ">= 0"),
    )
    alpha, alpha4, theta, g, Me = linkage.parameters(
        alpha=("s", "material damping: stress is E (strain + alpha strain rate)", ">= 0"),
        alpha4=("rad", "angle from the follower's line of joints to the follower's centre of mass"),
        theta=("rad", "inclination of the ground line"),
        g=("m/s^2", "gravitational acceleration, downwards"),
        Me=("N m", "external moment on the follower, opposite to phi4"),
    )
    modes = linkage.option("modes", range(1, 21), default=3)
    branch = linkage.option("branch", ("open", "crossed"))

    def sine(k, xi):
        return sin(k * pi * xi)

    beam = linkage.field("w", "m", "deflection of the coupler", length=l3, shape=sine, modes=modes)
    x, w, u = beam.position, beam.deflection, beam.shortening
    chord, side = l3 - beam.total_shortening, branch.choose(open=1, crossed=-1)
    phi3, phi4 = linkage.four_bar(
        "phi3", "phi4", crank=l2, coupler=chord, follower=l4, ground=l1, tilt=theta, side=side
    )
    rim, lead = l2 * linkage.speed, linkage.phase - phi3
    along = -rim * sin(lead) - rate(u) - w * rate(phi3)
    across = rim * cos(lead) + (x - u) * rate(phi3) + rate(w)
    height = l2 * sin(linkage.phase) + (x - u) * sin(phi3) + w * cos(phi3)
    spin = rate(phi3 + beam.slope)

    mu, EI = rho * A, E * I
    kinetic = mu * (along**2 + across**2) + rho * I * spin**2
    potential = EI * beam.curvature**2 / 2 + mu * g * height
    dissipation = cx * along**2 + cy * across**2 + alpha * EI * rate(beam.curvature) ** 2
    linkage.kinetic = beam.integral(kinetic) / 2 + JC * rate(phi4) ** 2 / 2
    linkage.potential = beam.integral(potential) + m4 * g * s4 * sin(phi4 + alpha4)
    linkage.dissipation = beam.integral(dissipation) / 2
    linkage.force(-Me, along=phi4)
    _state_outputs(linkage, beam, A, I, EI)

    pin, pivot = _polar(l2, linkage.phase), _polar(l1, theta)
    end = [at + part for at, part in zip(pivot, _polar(l4, phi4), strict=True)]
    linkage.sketch("crank", [(0, 0), pin])
    linkage.sketch("coupler", beam.line(pin, phi3))
    linkage.sketch("follower", [pivot, end])
    return linkage


def _polar(length, angle):
    return length * cos(angle), length * sin(angle)


def _state_outputs(linkage: Mechanism, beam, A, I, EI) -> None:  # noqa: E741 - the field's symbol
    """Add the outputs of the beam and the limits of validity."""
    length = beam.length
    middle = beam.at(beam.deflection, length / 2)
    moment = beam.at(EI * beam.curvature, length / 2)
    force = beam.at(beam.tension, 0)
    stress = beam.at(beam.tension, length / 2) / A - moment / I * sqrt(12 * I / A) / 2
    euler = pi**2 * EI / length**2
    linkage.output("midpoint_deflection", middle, "m", "deflection at midspan")
    axial = "axial force of the straight coupler at the crank pin, tension positive"
    linkage.output("axial_force", force, "N", axial)
    linkage.output("bending_moment", moment, "N m", "bending moment E I w'' at midspan")
    surface = "at midspan, on the side to which w is positive; rectangular section of height sqrt(12 I/A)"
    linkage.output("stress", stress, "Pa", f"axial stress {surface}")
    linkage.output("deflection_ratio", Abs(middle) / length, "1", "deflection at midspan divided by l3")
    linkage.output("euler_ratio", Abs(force) / euler, "1", "axial force divided by Euler's load")
    linkage.limit("deflection_ratio", "<= 0.02", beyond="the deflection is not small relative to the length")
    linkage.limit(
        "euler_ratio", "<= 0.5", beyond="the axial force is close to the buckling load of the coupler"
    )
