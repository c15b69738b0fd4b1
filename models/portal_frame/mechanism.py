"""Square portal frame: three equal bars, welded at the corners and clamped at the feet (section 5.4.1 of the
thesis)."""

from derive import Section, Structure, pi


def mechanism():
    """Return the square portal frame of the thesis."""
    frame = Structure("portal_frame", "Square portal frame of inextensible bars (thesis 5.4.1)")
    E, I, rho, A, L = frame.parameters(  # noqa: E741 - the field's symbol
        E=("Pa", "modulus of elasticity", "> 0"),
        I=("m^4", "second moment of area of each bar", "> 0"),
        rho=("kg/m^3", "density", "> 0"),
        A=("m^2", "cross-sectional area of each bar", "> 0"),
        L=("m", "length of each bar", "> 0"),
    )
    bar = {"length": L, "section": Section(E, A, I, rho), "inextensible": True}
    frame.link("left", "foot_left", "corner_left", angle=pi / 2, **bar)
    frame.link("beam", "corner_left", "corner_right", angle=0, **bar)
    frame.link("right", "foot_right", "corner_right", angle=pi / 2, **bar)
    for corner, foot in (("corner_left", "foot_left"), ("corner_right", "foot_right")):
        frame.weld(corner)
        frame.clamp(foot)
    return frame
