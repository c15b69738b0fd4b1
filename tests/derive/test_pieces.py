"""Inactive pieces do not contribute to values or to automatic derivatives of any order."""

import casadi
import numpy as np
import pytest
from modules import module_of, values

from derive import Abs, Heaviside, Max, Mechanism, Min, Piecewise, log, rate, sign, sqrt
from derive.checks import check
from derive.emit import module_text
from derive.errors import ExpansionError
from solve.model.sampling import tangent

K, KR, GAP = 1e4, 4e4, 2e-4


def rotor(gap_bound="> 0"):
    """Mass on a shaft, with its coordinates and the parameters of the ring."""
    made = Mechanism("rotor", "Rotor in a ring")
    x, y = made.coordinates(x=("m", "across"), y=("m", "up"))
    m, k = made.parameters(m=("kg", "mass", "> 0"), k=("N/m", "shaft", "> 0"))
    kr, gap = made.parameters(kr=("N/m", "ring", ">= 0"), gap=("m", "clearance", gap_bound))
    made.kinetic = m * (rate(x) ** 2 + rate(y) ** 2) / 2
    made.potential = k * (x**2 + y**2) / 2
    return made, x, y, kr, gap


def by_energy(energy):
    def state():
        made, x, y, kr, gap = rotor()
        made.potential += kr * energy(sqrt(x**2 + y**2), gap) / 2
        return made

    return state


def by_force(normal):
    def state():
        made, x, y, kr, gap = rotor()
        r = sqrt(x**2 + y**2)
        for coordinate in (x, y):
            made.force(-kr * normal(r, gap) * coordinate / r, along=coordinate)
        return made

    return state


RINGS = {
    "Max in an energy": by_energy(lambda r, gap: Max(0, r - gap) ** 2),
    "Min in an energy": by_energy(lambda r, gap: Min(0, gap - r) ** 2),
    "Piecewise in an energy": by_energy(lambda r, gap: Piecewise(((r - gap) ** 2, r > gap), (0, True))),
    "Abs in an energy": by_energy(lambda r, gap: (Abs(r - gap) + r - gap) ** 2 / 4),
    "Max": by_force(lambda r, gap: Max(0, r - gap)),
    "Min": by_force(lambda r, gap: -Min(0, gap - r)),
    "Heaviside": by_force(lambda r, gap: Heaviside(r - gap) * (r - gap)),
    "its complement": by_force(lambda r, gap: (1 - Heaviside(gap - r)) * (r - gap)),
    "Abs": by_force(lambda r, gap: (Abs(r - gap) + r - gap) / 2),
    "sign": by_force(lambda r, gap: (1 + sign(r - gap)) * (r - gap) / 2),
    "Piecewise": by_force(lambda r, gap: Piecewise((0, r < gap), (r - gap, True))),
}


@pytest.mark.parametrize("state", RINGS.values(), ids=RINGS)
def test_ring_without_contact_at_rest_contributes_nothing(state):
    """At rest, K is that of the shaft. Beyond the gap, the residual and its derivatives contain the ring
    force kr (1 - gap/r) (x, y); within the gap, also at the centre, they are those of the shaft."""
    module = module_of(state())
    _, _, stiffness, d = values(module.linearised(), 0.0, 1.0, [1.0, K, KR, GAP])
    assert np.array_equal(stiffness, K * np.eye(2))
    assert not d.any()
    assert not hasattr(module, "CONDITIONS")
    residual = module.residual()
    matrices = tangent(residual, np.array([1.0, K, KR, GAP]))
    for x, y in [(0.0, 0.0), (1e-4, -5e-5), (1.5e-4, 2.5e-4), (-3e-4, 0.0)]:
        r = np.hypot(x, y)
        expected_force, expected = K * np.array([x, y]), K * np.eye(2)
        if r > GAP:
            e = np.array([x, y]) / r
            expected_force = expected_force + KR * (r - GAP) * e
            expected = expected + KR * ((1 - GAP / r) * np.eye(2) + GAP / r * np.outer(e, e))
        (force,) = values(residual, 0.0, 1.0, [x, y], [0, 0], [0, 0], [1.0, K, KR, GAP])
        assert force.ravel() == pytest.approx(expected_force, rel=1e-12, abs=1e-15)
        (computed,) = values(matrices, 0.0, 1.0, [x, y], [0, 0], [0, 0])
        assert computed.ravel()[8:12].reshape(2, 2) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_second_derivatives_are_finite_where_the_piece_is_inactive():
    residual = module_of(RINGS["Max"]()).residual()
    q, p = casadi.SX.sym("q", 2), casadi.SX.sym("p", 4)
    (r,) = residual.call([0, 1, q, casadi.SX(2, 1), casadi.SX(2, 1), p], True, False)
    second = casadi.jacobian(casadi.jacobian(r, casadi.vertcat(q, p)), casadi.vertcat(q, p))
    (computed,) = values(casadi.Function("second", [q, p], [second]), [0, 0], [1.0, K, KR, GAP])
    assert np.isfinite(computed).all()


def test_gap_of_unknown_sign_adds_a_condition():
    made, x, y, kr, gap = rotor(gap_bound="")
    made.potential += kr * Max(0, sqrt(x**2 + y**2) - gap) ** 2 / 2
    module = module_of(made)
    assert [text for text, *_ in module.CONDITIONS] == ["gap > 0"]
    (margins,) = values(module.conditions(), 0.0, [1, K, KR, -0.5])
    assert margins == [[-0.5]]


def _log_energy(normal):
    """Energy kr gap² log(r/gap)²/2 beyond the gap; `normal` is its factor that depends on r/gap."""
    return by_energy(lambda r, gap: gap**2 * normal(r, gap))


INFINITE_AT_REST = {
    "Max": _log_energy(lambda r, gap: Max(0, log(r / gap)) ** 2),
    "Min": _log_energy(lambda r, gap: Min(0, log(gap / r)) ** 2),
    "Heaviside": _log_energy(lambda r, gap: Heaviside(log(r / gap)) * log(r / gap) ** 2),
    "Piecewise": _log_energy(lambda r, gap: Piecewise((log(r / gap) ** 2, log(r / gap) > 0), (0, True))),
    "quotient": _log_energy(lambda r, gap: Piecewise((log(r / gap) ** 2, gap / r < 1), (0, True))),
}


@pytest.mark.parametrize("state", INFINITE_AT_REST.values(), ids=INFINITE_AT_REST)
def test_inactive_piece_may_be_infinite_at_rest(state):
    """log(r/gap) is -∞ at rest. Beyond the gap, the ring force is kr gap² log(r/gap)/r."""
    module = module_of(state())
    p = [1.0, K, KR, GAP]
    _, _, stiffness, _ = values(module.linearised(), 0.0, 1.0, p)
    assert np.array_equal(stiffness, K * np.eye(2))
    matrices = tangent(module.residual(), np.array(p))
    for r in (0.0, 0.9 * GAP, 1.4 * GAP):
        (force,) = values(module.residual(), 0.0, 1.0, [0.6 * r, -0.8 * r], [0, 0], [0, 0], p)
        ring = KR * GAP**2 * np.log(r / GAP) / r if r > GAP else 0.0
        assert force.ravel() == pytest.approx((K * r + ring) * np.array([0.6, -0.8]), rel=1e-12, abs=1e-15)
        (computed,) = values(matrices, 0.0, 1.0, [0.6 * r, -0.8 * r], [0, 0], [0, 0])
        assert np.isfinite(computed).all()
        if r < GAP:
            assert computed.ravel()[8:12] == pytest.approx([K, 0, 0, K])


@pytest.mark.parametrize(
    "energy",
    [
        lambda r, gap: gap**2 * Max(0, gap / r - 2) ** 2,
        lambda r, gap: gap**2 * Max(0, log(gap / r)) ** 2,
        lambda r, gap: gap**2 * Piecewise((log(r / gap), 1 / r > 1 / gap), (0, True)),
    ],
)
def test_active_piece_that_is_infinite_at_rest_is_rejected(energy):
    with pytest.raises(ExpansionError, match="K is not finite"):
        module_of(by_energy(energy)())


def test_comparison_with_limit_of_unknown_sign_is_rejected():
    """1/x is +∞ on one side of the rest position and -∞ on the other."""
    made, x, _, kr, gap = rotor()
    made.potential += kr * gap**2 * Max(0, gap / x - 2) ** 2
    with pytest.raises(ExpansionError, match="K is not finite"):
        module_of(made)


def test_singular_piece_active_at_rest_has_no_linearisation():
    made, x, y, kr, gap = rotor()
    made.potential += kr * Max(0, sqrt(x**2 + y**2) + gap) ** 2 / 2
    with pytest.raises(ExpansionError, match="K is not finite"):
        module_of(made)


def test_logarithm_in_an_inactive_piece_is_finite():
    """Gas is compressed beyond a gap: F log(q/gap) has an infinite slope at q = 0, where it is inactive."""
    made = Mechanism("gas", "Mass before a cushion")
    q = made.coordinate("q", "m", "deflection")
    m, k, F, gap = made.parameters(
        m=("kg", "mass", "> 0"), k=("N/m", "spring"), F=("N", "force"), gap=("m", "gap", "> 0")
    )
    made.kinetic, made.potential = m * rate(q) ** 2 / 2, k * q**2 / 2
    made.force(-Piecewise((F * log(q / gap), q > gap), (0, True)), along=q)
    module = module_of(made)
    p = np.array([1.0, 5.0, 3.0, 0.1])
    assert float(module.linearised()(0, 1, p)[2]) == 5.0
    for at, slope in [(0.0, 5.0), (0.05, 5.0), (0.2, 5.0 + 3.0 / 0.2), (-1.0, 5.0)]:
        (force,) = values(module.residual(), 0, 1, at, 0, 0, p)
        (computed,) = values(tangent(module.residual(), p), 0, 1, at, 0, 0)
        assert float(force[0, 0]) == pytest.approx(5.0 * at + (3.0 * np.log(at / 0.1) if at > 0.1 else 0))
        assert computed[2, 0] == pytest.approx(slope)


def test_code_without_singular_pieces_is_unchanged():
    """A stop is printed as a kink, because none of its terms is singular."""
    made, x, _, kr, gap = rotor()
    made.potential += kr * Max(0, x - gap) ** 2 / 2
    check(made)
    text = module_text(made, "0" * 64, "rotor")
    assert "fmax" in text or " > 0)" in text
    assert "if_else" not in text
