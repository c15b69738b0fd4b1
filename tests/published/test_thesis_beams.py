"""Claims of Chapters 3 to 5 and Section 8.5 of the thesis about links and elements."""

import numpy as np
import pytest

import solve
from models.four_bar.linkage import Linkage
from solve.equations import output_values
from solve.results.periodic_motion import QuasiStatic
from solve.studies.frequencies import turn

PARAMETERS = solve.case_numbers("four_bar").parameters
L1, L2, L3, L4 = (PARAMETERS[name] for name in ("L1", "L2", "L3", "L4"))
LINKAGE = Linkage(L1, L2, L3, L4)
TURN = np.arange(720) * (2 * np.pi / 720)


def test_small_transmission_angle_causes_high_accelerations():
    """Thesis 3.3. The smallest transmission angle decreases with L4 until crank and ground align and coupler
    and follower fold."""
    folded = L1 + abs(L3 - L2)
    made = [Linkage(L1, L2, L3, ground) for ground in (L4, 0.5, 0.45, 0.4, 0.37, folded + 1e-3)]
    least = [linkage.transmission_extremes().min for linkage in made]
    largest = [np.abs(linkage.motion(TURN, 1.0).alpha[2]).max() for linkage in made]
    assert (np.diff(least) < 0).all()
    assert (np.diff(largest) > 0).all()
    assert largest[-1] > 10 * largest[0]


@pytest.mark.parametrize(("speed", "likeness"), [(5.0, 0.99), (17.0, 0.99), (30.0, 0.85)])
def test_follower_deflection_follows_its_rigid_acceleration(speed, likeness):
    """Thesis 3.5. The correlation over a period is computed for deflection and stress. The coupler is also
    loaded by the motion of its pins."""
    orbit = solve.periodic(solve.load("four_bar", options={"elements": 2}), speed, rtol=1e-4)
    outputs = output_values(orbit.system, TURN, speed, *orbit.state(TURN))
    alpha = LINKAGE.motion(TURN, speed).alpha
    for link, number, least, most in (("follower", 2, likeness, 1.0), ("coupler", 1, 0.0, 0.3)):
        for quantity in ("deflection", "stress_plus"):
            computed = np.corrcoef(outputs[f"{link}_midpoint_{quantity}"], alpha[number])[0, 1]
            assert least < abs(computed) < most


def test_mass_and_stiffness_are_symmetric_without_rotation():
    """Thesis 4.2.3, (4.28), without damping. In 2.2.1, (2.1), the same two matrices appear."""
    full, still = (
        solve.load("four_bar", options={"terms": terms}, zeta=0.0).at(TURN[::60], 30.0)
        for terms in ("full", "instantaneous")
    )

    def asymmetry(A):
        return np.abs(A - A.transpose(0, 2, 1)).max() / np.abs(A).max()

    assert max(asymmetry(still[0]), asymmetry(still[2])) < 1e-12
    assert np.abs(still[1]).max() == 0
    assert asymmetry(full[1]) > 0.1
    assert asymmetry(full[2] - still[2]) > 0.1


def mean_errors(**options):
    """Return the numbers of degrees of freedom and the errors of the mean first four frequencies."""
    model, exact = (solve.load("four_bar", options=each) for each in (options, {"element": "dynamic"}))
    computed, truth = (solve.frequencies(each, turn(each), 4) for each in (model, exact))
    return computed.freedoms, computed.mean / truth.mean - 1


@pytest.mark.parametrize(
    ("quintic", "cubic"),
    [
        ({"element": "curvature"}, {"elements": 1}),
        ({"element": "curvature", "elements": 2}, {"elements": 3}),
        ({"element": "internal"}, {"elements": 2}),
        ({"element": "internal", "elements": 2}, {"elements": 4}),
    ],
)
def test_p_version_is_more_accurate_at_equal_freedoms(quintic, cubic):
    """Thesis 4.1, 4.4. All four means are more accurate, with equally many or fewer degrees of freedom, or
    one more."""
    (freedoms, errors), (others, coarser) = mean_errors(**quintic), mean_errors(**cubic)
    assert freedoms <= others + 1
    assert (errors < coarser).all()


def test_one_curvature_element_matches_three_cubic_elements():
    """Thesis 4.3, "almost the same result", with 10 degrees of freedom instead of 27."""
    (few, one), (many, three) = mean_errors(element="curvature"), mean_errors(elements=3)
    assert (few, many) == (10, 27)
    np.testing.assert_allclose(one, three, rtol=0, atol=0.003)


@pytest.mark.parametrize("sign", [1, -1])
def test_tension_stiffens_and_compression_softens_a_beam(sign):
    """Thesis 4.2.6. The effect of the option on the stiffness for rotations of the follower is compared with
    the force at B along the follower in the quasi-static solution."""
    stiffened, plain = (solve.load("four_bar", options={"stiffening": how}) for how in ("on", "off"))
    phase, speed = TURN[::15], 10.0
    added = stiffened.at(phase, speed)[2] - plain.at(phase, speed)[2]
    forces = output_values(plain, phase, speed, *QuasiStatic(plain, speed).state(phase))
    angle = LINKAGE.motion(phase).t[2]
    tension = forces["B_force_x"] * np.cos(angle) + forces["B_force_y"] * np.sin(angle)
    clear = sign * tension > 0.2 * np.abs(tension).max()
    assert clear.any()
    own = [k for k, name in enumerate(plain.coordinates) if name.startswith("follower")]
    assert (sign * np.linalg.eigvalsh(added[np.ix_(clear, own, own)]) > 0).all()


def pinned(number, **changed):
    """Return (π/L)² sqrt(EI/ρA) of a pinned-pinned link."""
    p = {**PARAMETERS, **changed}
    wave = np.pi / p[f"L{number}"]
    return wave**2 * np.sqrt(p["E"] * p[f"I{number}"] / (p["rho"] * p[f"A{number}"]))


def test_most_flexible_link_determines_the_first_mean_frequency():
    """Thesis 8.5.2 and 9.2. They agree within 2 %."""
    alone = {}
    for length, softest in ((0.328, "follower"), (0.636, "coupler")):
        alone = {name: pinned(k, L2=length) for k, name in enumerate(("crank", "coupler", "follower"), 1)}
        model = solve.load("four_bar", options={"element": "dynamic"}, L2=length)
        assert model.pinned_frequencies() == pytest.approx(alone, rel=1e-9)
        assert min(alone, key=lambda name: alone[name]) == softest
        assert solve.frequencies(model, turn(model), 1).mean[0] == pytest.approx(alone[softest], rel=0.02)
    assert (round(alone["coupler"], 1), round(alone["follower"], 1)) == (124.6, 168.4)
    assert alone["crank"] > 10 * alone["follower"]
    assert pinned(2) > 2.5 * pinned(3)
