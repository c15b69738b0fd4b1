"""Sensitivities of free machines, compared with finite differences and closed forms."""

import numpy as np
import pytest
from scipy.linalg import eigh

import solve
from derive import Mechanism, cos, rate
from solve.errors import NoDerivativeError
from tests.solve.free_machines import (
    SPEED,
    J,
    K,
    after_a_period,
    mechanism,
)


@pytest.mark.parametrize("numbers", [{"T0": 0.0, "b": 0.0}, {"T0": 3.0, "b": 0.07}], ids=["free", "dragged"])
def test_sensitivities_of_a_free_machine_match_differences(numbers):
    """The quantities include static twist and drift."""
    of = ["q1.harmonic2", "q5.max_abs", "q2.max", "q3.min", "q2.mean", "shaft.max", "drag.max"]
    of.append("spectral_radius")
    by, numbers = ["J1", "k2", "c", "T", "speed"], {"c": 1e-5, **numbers}
    if numbers["b"]:
        by.append("b")
    else:
        of.remove("drag.max")
    machine = mechanism(**numbers)
    sensitivities = solve.sensitivities(machine, SPEED, of=of, by=by)

    def values(name, step):
        speed = SPEED + step * (name == "speed")
        changed = {} if name == "speed" else {name: machine.parameters[name] + step}
        orbit = solve.periodic(machine.varied(changed), speed)
        figures = [orbit.statistics(each.split(".")[0]) for each in of[1:-1]]
        of_turn = [getattr(each, text.split(".")[1]) for each, text in zip(figures, of[1:-1], strict=True)]
        return np.array([orbit.harmonics("q1")[0][2], *of_turn, orbit.spectral_radius])

    sizes = np.abs(values("T", 0.0))
    for at, name in enumerate(by):
        given = SPEED if name == "speed" else machine.parameters[name]
        step = 1e-4 * given
        differences = (values(name, step) - values(name, -step)) / (2 * step)
        made = np.array([sensitivities.found[text].derivatives[at] for text in of])
        # Round-off and errors of the orbits, 1e-10 of each quantity, over the step; the mean may be zero.
        allowed = 1e-6 * np.maximum(sizes, 1e-4 * (np.array(of) == "q2.mean")) / given
        assert (np.abs(made - differences) <= 2e-6 * np.abs(differences) + allowed).all()


def test_critical_speed_derivatives_follow_from_natural_frequencies():
    """dω/dk4 = (φ4 - φ5)²/(2ω) for modes φ of unit modal mass. The response is a single harmonic, so its
    maximum and minimum have equal magnitudes. Other modes and the slope of envelopes change the maxima by
    1e-4 of this value."""
    speeds = np.linspace(2000, 5000, 31) * np.pi / 30
    critical = solve.critical_speeds(mechanism(c=1e-6), speeds, "q5")
    squares, shapes = eigh(K, J)
    slopes = (shapes[3] - shapes[4]) ** 2 / 2 / np.sqrt(np.maximum(squares, 1e-9))
    derived = solve.speed_sensitivities(critical, ["k4"])
    assert derived.warnings == []
    for way in ("response", "multiplier"):
        rows = [row for row in critical.rows if getattr(row, way)]
        assert len(rows) == 2
        for number, row in enumerate(rows, start=1):
            truth = slopes[row.mode - 1] / row.order
            assert derived[f"{way}{number}"]["k4"] == pytest.approx(truth, rel=2e-4)


def test_multipliers_of_free_machines_have_derivatives_at_any_speed():
    """The derivatives exist even where the multipliers cannot be separated from the double +1 of the
    rigid-body mode. At the first speed, only the monodromy matrix gives their eigenvectors. With damping
    proportional to K, |ρ| = exp(-c ω²π/Ω)."""
    squares, shapes = eigh(K, J)
    slopes = (shapes[3] - shapes[4]) ** 2
    for speed in (170.3159590038997, *np.random.default_rng(11).uniform(50, 320, 8)):
        sensitivities = solve.sensitivities(mechanism(c=1e-5), speed, ["rho3.abs", "rho5.abs"], ["k4"])
        assert sensitivities.warnings == []
        for at, mode in ((3, 1), (5, 2)):
            rate = -1e-5 * np.pi / speed
            truth = rate * slopes[mode] * np.exp(rate * squares[mode])
            assert sensitivities[f"rho{at}.abs"]["k4"] == pytest.approx(truth, rel=1e-7)


def test_rigid_body_mode_has_no_derivatives():
    sensitivities = solve.sensitivities(mechanism(b=0.07), SPEED, of=["rho1.abs", "rho3.abs"], by=["k1", "c"])
    (warning,) = sensitivities.warnings
    assert "rho1.abs belongs to a rigid-body mode" in warning
    assert np.isfinite(list(sensitivities["rho3.abs"].values())).all()


def test_sensitivities_with_conserved_momentum_are_refused():
    machine = Mechanism("crank_train", "Two discs, one of varying inertia")
    q1, q2 = machine.coordinates(q1=("rad", "crank"), q2=("rad", "wheel"))
    J1, k = machine.parameters(J1=("kg m^2", "crank", "> 0"), k=("N m/rad", "shaft", "> 0"))
    T = machine.parameter("T", "N m", "torque")
    machine.kinetic = J1 * ((1 + cos(machine.phase) / 3) * rate(q1) ** 2 + 2 * rate(q2) ** 2) / 2
    machine.potential = k * (q1 - q2) ** 2 / 2
    machine.force(T * cos(2 * machine.phase), along=q2)
    system = solve.load(machine, J1=1.0, k=3.0, T=1.0)
    orbit = solve.periodic(system, 1.1)
    grown, start = after_a_period(system, 1.1, orbit)
    np.testing.assert_allclose(grown, start, atol=1e-8)
    with pytest.raises(NoDerivativeError, match="add drag"):
        solve.sensitivities(system, 1.1, of="q1.max_abs", by=["k"])
