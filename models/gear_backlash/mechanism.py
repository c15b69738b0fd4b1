"""Gear pair with backlash: a mass on a varying mesh stiffness with a clearance."""

from derive import Abs, Heaviside, Max, Mechanism, Min, cos, pi, rate, rectangle, sin, tanh, wrapped


def mechanism() -> Mechanism:
    """Return the mechanism m q̈ + c q̇ + k(φ) g(q) = F + m Ω² E cos φ (A. Kahraman, R. Singh, J. Sound Vib.
    142 (1990) 49–75).

    The phase is that of the mesh, with one period per tooth. q is measured from the mean deflection F/k. The
    function g is 0 while the teeth are within the clearance 2b.
    """
    pair = Mechanism("gear_backlash", "Gear pair with backlash and varying mesh stiffness")
    (q,) = pair.coordinates(q=("m", "deflection of the mesh minus its value under the mean load"))
    m, c, k, F = pair.parameters(
        m=("kg", "equivalent mass along the line of action", "> 0"),
        c=("N s/m", "damping coefficient of the mesh", ">= 0"),
        k=("N/m", "mean mesh stiffness", "> 0"),
        F=("N", "mean load along the line of action", "> 0"),
    )
    e, E, b, s = pair.parameters(
        e=("1", "relative amplitude of the mesh stiffness", "> -1, < 1"),
        E=("m", "amplitude of the transmission error without load"),
        b=("m", "half of the backlash", ">= 0"),
        s=("1", "fraction of the period with two pairs of teeth, for rectangular stiffness", "> 0, < 1"),
    )
    p, z1, z2 = pair.parameters(
        p=("m", "base pitch, for the sliding speed", "> 0"),
        z1=("1", "number of teeth of the pinion, for the sliding speed", "integer, >= 1"),
        z2=("1", "number of teeth of the wheel, for the sliding speed", "integer, >= 1"),
    )
    mesh = pair.option("mesh", ("harmonic", "rectangular"))

    two = rectangle(pair.phase, -pi * s, pi * s)
    change = mesh.choose(harmonic=cos(pair.phase), rectangular=(two - s) / (1 - s))
    deflection, behind = q + F / k, q + F / k + 2 * b
    stiffness = k * (1 + e * change)
    mesh_force = stiffness * (Max(0, deflection) + Min(0, behind))
    pair.kinetic, pair.dissipation = m * rate(q) ** 2 / 2, c * rate(q) ** 2 / 2
    pair.force(F + m * pair.speed**2 * E * cos(pair.phase) - mesh_force, along=q)
    pair.decline_drive_torque("the rotation of the gears is not in the model")

    position = p * (wrapped(pair.phase + pi) / (2 * pi) - 1 / 2)
    sliding = pair.speed * (1 / z1 + 1 / z2) * Abs(position)
    pair.output("mesh_force", mesh_force, "N", "elastic mesh force, positive on the driving flanks")
    opening = Max(0, -deflection) - Max(0, -behind)
    pair.output("gap", opening, "m", "distance between the driving flanks, at most 2b")
    drive, back = Heaviside(deflection), Heaviside(-behind)
    pair.output("driving_contact", drive, "1", "1 while the driving flanks touch; mean: fraction of time")
    pair.output("back_contact", back, "1", "1 while the rear flanks touch; mean: fraction of time")
    pair.output("wear", Abs(mesh_force) * sliding, "W", "mesh force times sliding speed")

    size = 0.05 * pair.metre
    for name, x, z, turn in (("pinion", 0, z1, 1), ("wheel", 2 * size, z2, -1)):
        rim, at = size * (1 + tanh(2 * sin(z * pair.around)) / 12), pair.around + turn * pair.phase / z
        pair.sketch(name, [(x + rim * cos(at), rim * sin(at))])
    return pair
