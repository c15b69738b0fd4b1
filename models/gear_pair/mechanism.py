"""Gear pair with tooth errors, from section 4.2 of the chapter."""

from derive import Mechanism, cos, pi, rate, sin, sqrt, tanh


def mechanism() -> Mechanism:
    """Return the mechanism of Eqs. (66)–(74) of the chapter. The rotation of each gear is the sum of a
    uniform rotation and a multiple of q.

    The factors of q are such that r_b1 φ1 + r_b2 φ2 = q, Eq. (68), and that q is decoupled from the uniform
    rotation.
    """
    pair = Mechanism("gear_pair", "Gear pair with tooth errors (chapter 4.2)")
    (q,) = pair.coordinates(q=("m", "dynamic transmission error, along the line of contact"))
    J1, J2, rb1, rb2 = pair.parameters(
        J1=("kg m^2", "moment of inertia of the pinion", "> 0"),
        J2=("kg m^2", "moment of inertia of the wheel", "> 0"),
        rb1=("m", "base radius of the pinion", "> 0"),
        rb2=("m", "base radius of the wheel", "> 0"),
    )
    z1, zeta, q0 = pair.parameters(
        z1=("1", "number of teeth of the pinion", "integer, >= 1"),
        zeta=("1", "damping ratio (Lehr) of the mesh with mean stiffness", ">= 0"),
        q0=("m", "static tooth deflection under the constant load"),
    )
    k = pair.harmonic_series("k", 10, unit="N/m", meaning="mesh stiffness", angles="gamma", bound="> 0")
    e = pair.harmonic_series("e", 6, unit="m", meaning="tooth error", angles="alpha", mean=False)
    load = pair.option("load", ("tracking", "constant"))

    m_red = J1 * J2 / (J1 * rb2**2 + J2 * rb1**2)
    c_z = 2 * zeta * sqrt(k.mean * m_red)
    k_z, error = k(z1 * pair.phase), e(pair.phase)
    phi1 = pair.phase + m_red * rb1 / J1 * q
    phi2 = -rb1 / rb2 * pair.phase + m_red * rb2 / J2 * q
    pair.kinetic = (J1 * rate(phi1) ** 2 + J2 * rate(phi2) ** 2) / 2
    pair.potential = k_z * (q + error) ** 2 / 2
    pair.dissipation = c_z * rate(q + error) ** 2 / 2
    pair.force(k.mean * (q0 + load.choose(tracking=error, constant=0)), along=q)
    pair.decline_drive_torque("the loads' work on the uniform rotation of the gears is not in the model")

    mesh_force = k_z * (q + error) + c_z * rate(q + error)
    wheel_ripple = rate(phi2) + rb1 / rb2 * pair.speed
    pair.output("transmission_error_rate", rate(q), "m/s", "rate of the dynamic transmission error")
    pair.output("mesh_force", mesh_force, "N", "force between the teeth, compression positive")
    pair.limit("mesh_force", ">= 0", beyond="the teeth separate; backlash is not in the model")
    pair.output("pinion_speed_ripple", rate(phi1 - pair.phase), "rad/s", "speed of the pinion minus its mean")
    pair.output("wheel_speed_ripple", wheel_ripple, "rad/s", "speed of the wheel minus its mean")

    # Radii of the pitch circles, for a pressure angle of 20°.
    r1, r2, z2 = rb1 / cos(pi / 9), rb2 / cos(pi / 9), z1 * rb2 / rb1
    for name, x, r, z, turn in (("pinion", 0, r1, z1, phi1), ("wheel", r1 + r2, r2, z2, phi2 + pi)):
        rim, at = r + 1.8 * r1 / z1 * tanh(2 * sin(z * pair.around)), pair.around + turn
        pair.sketch(name, [(x + rim * cos(at), rim * sin(at))])
        pair.sketch(f"{name}_mark", [(x, 0), (x + r * cos(turn) * 0.8, r * sin(turn) * 0.8)])
    return pair
