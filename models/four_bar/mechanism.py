"""Four-bar linkage with three flexible links, from Chapters 3 to 5 of the thesis."""

from derive import Section, Structure


def mechanism() -> Structure:
    """Return the structure: crank OA, which is clamped to its flywheel at O, coupler AB, and follower CB,
    which rotates about C at (L4, 0).

    A and B are pins with point masses. The parameters h are the thicknesses of the links in the plane of
    motion.
    """
    linkage = Structure("four_bar", "Four-bar linkage with flexible links (thesis Chapters 3 to 5)")
    L1, L2, L3, L4 = linkage.parameters(
        L1=("m", "length of the crank", "> 0"),
        L2=("m", "length of the coupler", "> 0"),
        L3=("m", "length of the follower", "> 0"),
        L4=("m", "length of the ground link", "> 0"),
    )
    A1, A2, A3, I1, I2, I3 = linkage.parameters(
        A1=("m^2", "cross-sectional area of the crank", "> 0"),
        A2=("m^2", "cross-sectional area of the coupler", "> 0"),
        A3=("m^2", "cross-sectional area of the follower", "> 0"),
        I1=("m^4", "second moment of area of the crank", "> 0"),
        I2=("m^4", "second moment of area of the coupler", "> 0"),
        I3=("m^4", "second moment of area of the follower", "> 0"),
    )
    h1, h2, h3, E, rho = linkage.parameters(
        h1=("m", "thickness of the crank in the plane of motion", "> 0"),
        h2=("m", "thickness of the coupler in the plane of motion", "> 0"),
        h3=("m", "thickness of the follower in the plane of motion", "> 0"),
        E=("Pa", "modulus of elasticity", "> 0"),
        rho=("kg/m^3", "density", "> 0"),
    )
    mA, mB, zeta = linkage.parameters(
        mA=("kg", "mass of the joint of crank and coupler", ">= 0"),
        mB=("kg", "mass of the joint of coupler and follower", ">= 0"),
        zeta=("1", "damping ratio of every mode", ">= 0"),
    )
    branch = linkage.option("branch", ("open", "crossed"))
    t2, t3 = linkage.four_bar(
        "t2", "t3", crank=L1, coupler=L2, follower=L3, ground=L4, side=branch.choose(open=1, crossed=-1)
    )
    linkage.link("crank", "O", "A", L1, linkage.phase, Section(E, A1, I1, rho, h1))
    linkage.link("coupler", "A", "B", L2, t2, Section(E, A2, I2, rho, h2))
    linkage.link("follower", "C", "B", L3, t3, Section(E, A3, I3, rho, h3))
    linkage.clamp("O")
    linkage.support("C")
    linkage.mass("A", mA)
    linkage.mass("B", mB)
    linkage.damping_ratio = zeta
    return linkage
