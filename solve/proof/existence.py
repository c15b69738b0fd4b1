"""Existence and uniqueness of a nonlinear periodic orbit near a trigonometric polynomial, by the
Newton–Kantorovich theorem.

In the scaled coordinates of `solve.proof.equation`, with z = y₂′, the deviation from the polynomial satisfies
y₁′ = W y₂, z = A₂ y − m⁻¹r_d + g, g = −m⁻¹N, where A = [0 W; A₂] and N is the nonlinear remainder. Let (y¹,
z¹) be the periodic solution for g = 0. It is enclosed as for any linear system. Periodic solutions of the
full equations are fixed points of (y, z) ↦ (y¹, z¹) + G g(y, z), where G g is the periodic solution with
input g.

**G.** By variation of constants, w(t) = Y(t) w(0) + ∫_0^t Ψ(t, s) (0, g) ds and w(0) = (1 − Φ)⁻¹ ∫_0^T
Ψ(T, s) (0, g) ds. With κ and τ of `solve.proof.transitions`,

    ‖w‖ ≤ Γ sup‖g‖,    Γ = τ (1 + κ ‖(1 − Φ)⁻¹‖).

With a₂ ≥ sup‖A₂‖ and κ₂ = a₂ + 1/Γ, ‖w₂′‖ ≤ (a₂Γ + 1) sup‖g‖ = κ₂ Γ sup‖g‖. Hence |G g| ≤ Γ sup‖g‖ also in
the norm |(y, z)| = sup max(‖y‖, ‖z‖/κ₂).

**g.** Let Λ be the bound on second derivatives of `solve.proof.curvature` for deviations of norm ≤ R. By
Taylor's formula, ‖g(v)‖ ≤ Λ|v|²/2 and ‖g(v) − g(v′)‖ ≤ ΛR|v − v′|.

**Fixed point.** With η ≥ |(y¹, z¹)|, the ball of radius ρ ≤ R is mapped to itself if η + ΓΛρ²/2 ≤ ρ, and the
map is a contraction if ΓΛρ < 1. By Banach's fixed-point theorem, this ball then contains exactly one orbit.

**Stability.** The linearisation about that orbit has A₂ + B in place of A₂. From the bound on second
derivatives, ‖By‖ ≤ ρΛ max(‖y‖, ‖z‖/κ₂) with z = A₂y + By. If ‖y‖ is the larger of the two, ‖By‖ ≤ ρΛ‖y‖.
Otherwise ‖By‖ ≤ ρΛa₂/(κ₂ − ρΛ) ‖y‖ ≤ ρΛ‖y‖, since ρΛ < 1/Γ. In both cases ‖B‖ ≤ β = ρΛ. It follows from Y* =
Y + ∫Ψ B Y* that sup‖Y*‖ ≤ κ/(1 − τβ), and

    ‖Φ* − Φ‖ ≤ τβκ/(1 − τβ),    τβ < 1."""

from dataclasses import dataclass

from solve.errors import StepsError
from solve.proof.balls import Ball, Matrix, arb, arb_mat, largest, norm
from solve.proof.curvature import Curvature
from solve.proof.equation import Equation
from solve.proof.instructions import Instructions
from solve.proof.orbit import largest_modulus
from solve.proof.transitions import Transitions
from solve.proof.turn import Turn

_WIDTH = 0.5
"""Relative width of the bounds on the defect. Chosen by judgement."""

_TUBES, _WIDEST = 40, 24
"""Largest number of halvings of the tube in which uniqueness of the orbit is proved, and binary exponent of
the largest radius of the tube. Chosen by judgement: radii from 2^24 to 2^-16 are tried; motions have a size
near 1 in scaled coordinates."""


@dataclass(frozen=True)
class Existence:
    """Radii of balls, in the norm |(y, z)|, in which exactly one orbit exists.

    radius: radius of a ball that contains the orbit. unique: radius of a ball that contains no other orbit.
    change: bound on ‖Φ* − Φ‖. rate: κ₂."""

    radius: Ball
    unique: Ball
    change: Ball
    rate: Ball


@dataclass(frozen=True)
class Linear:
    """Bounds on the linearised problem: Γ (`gamma`), κ₂ (`rate`) and η (`eta`)."""

    gamma: Ball
    rate: Ball
    eta: Ball

    @classmethod
    def from_maps(cls, turn: Turn, Phi: Matrix, bounds: Transitions, states: list[Matrix]) -> "Linear":
        """Compute the bounds from the maps of the steps, and from the states (2n+1, 1) of (y¹, z¹) at the
        starts of the steps. Raises ZeroDivisionError if 1 − Φ may be singular."""
        size = Phi.nrows()
        resolvent = arb_mat([[int(i == j) - Phi[i, j] for j in range(size)] for i in range(size)]).inv()
        gamma = (bounds.tau * (1 + bounds.kappa * norm(resolvent))).upper()
        a = largest(step.advance / h for step, h in zip(turn.steps, turn.lengths, strict=True))
        rate = (a + 1 / gamma).upper()
        loads = [
            step.inverse * largest_modulus(step.load, _WIDTH)[1] / h
            for step, h in zip(turn.steps, turn.lengths, strict=True)
        ]
        y = largest(
            on_step.growth * largest(abs(state[i, 0]) for i in range(size)) + on_step.inside * load
            for on_step, state, load in zip(bounds.steps, states, loads, strict=True)
        )
        z = a * y + largest(loads)
        return cls(gamma, rate, largest((y, z / rate)))


def existence(
    equation: Equation, second: Instructions, turn: Turn, linear: Linear, bounds: Transitions
) -> Existence:
    """Compute the radii of existence and uniqueness. Raises StepsError if existence is not proved."""
    curvature = Curvature.from_equation(equation, second, turn, linear.rate)
    radius = (2 * linear.eta).upper()
    Lambda = curvature.over(radius)
    product = linear.gamma * Lambda
    if not 2 * product * linear.eta < 1:
        raise StepsError(
            "the existence of an orbit is not proved: η ΓΛ must be below 1/2, where η = "
            f"{float(linear.eta):.1e} "
            f"bounds the first Newton correction, and ΓΛ = {float(product):.1e} bounds the curvature of the "
            "equations"
        )
    # η + ΓΛρ²/2 ≤ ρ holds for ρ = η (1 + 2ΓΛη), because 2ΓΛη < 1 implies (1 + 2ΓΛη)² ≤ 4.
    radius = (linear.eta * (1 + 2 * product * linear.eta)).upper()
    beta = radius * Lambda
    turned = bounds.tau * beta
    change = (turned * bounds.kappa / (1 - turned)).upper() if turned < 1 else arb.pos_inf()
    unique = _unique(curvature, linear, radius)
    return Existence(radius, unique, change, linear.rate)


def _unique(curvature: Curvature, linear: Linear, radius: Ball) -> Ball:
    """Radius, as large as possible, of a ball that the contraction maps into itself."""
    tube = (1 / (2 * linear.gamma * curvature.over(radius))).upper()
    if not tube < arb(2) ** _WIDEST:
        tube = arb(2) ** _WIDEST
    for _ in range(_TUBES):
        if not tube > radius:
            break
        product = linear.gamma * curvature.over(tube)
        if product * tube < 1 and linear.eta + product * tube**2 / 2 <= tube:
            return tube
        tube = (tube / 2).mid()
    return radius
