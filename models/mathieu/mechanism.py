"""Mathieu's equation, from section 7.2.3 and Appendix E of the thesis."""

from derive import Abs, Mechanism, cos, pi, rate, sign, sin, sqrt


def mechanism() -> Mechanism:
    """Return the mechanism q̈ + 2 zeta sqrt(|delta|) q̇ + (delta + epsilon cos 2φ) q = 0 with φ = Ωt. Its
    period in the phase is π.

    At 1 rad/s, the phase equals the time, and this is Mathieu's equation. At another speed Ω, the stiffness
    varies with the frequency 2Ω; with the phase as independent variable, this is Mathieu's equation with
    delta/Ω² and epsilon/Ω².
    """
    mathieu = Mechanism("mathieu", "Mathieu's equation (thesis 7.2.3)", energy="1/s^2", period=pi)
    (q,) = mathieu.coordinates(q=("1", "deflection, for a mass of 1"))
    delta, epsilon, zeta = mathieu.parameters(
        delta=("1/s^2", "mean stiffness for a mass of 1"),
        epsilon=("1/s^2", "amplitude of the stiffness, which varies twice per revolution"),
        zeta=("1", "damping ratio (Lehr) with the mean stiffness", ">= 0"),
    )
    mathieu.kinetic = rate(q) ** 2 / 2
    mathieu.potential = (delta + epsilon * cos(2 * mathieu.phase)) * q**2 / 2
    mathieu.dissipation = zeta * sqrt(Abs(delta)) * rate(q) ** 2
    mathieu.decline_drive_torque("an equation without physical units has no torque")

    # Sketch of a pendulum of length 1 with a vibrating pivot, upright for delta < 0.
    pivot = -sign(delta) * epsilon / (2 * mathieu.speed) ** 2 * cos(2 * mathieu.phase)
    bob = pivot - sign(delta) * cos(q)
    mathieu.sketch("pivot", [(-0.1, pivot), (0.1, pivot)], unit="1")
    mathieu.sketch("pendulum", [(0, pivot), (sin(q), bob)], unit="1")
    at = mathieu.around
    mathieu.sketch("bob", [(sin(q) + 0.08 * cos(at), bob + 0.08 * sin(at))], unit="1")
    return mathieu
