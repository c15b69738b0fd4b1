"""Model of the flexible four-bar linkage: links, parameters, and agreement with the rigid linkage."""

import numpy as np
import pytest

import solve
from models.four_bar.linkage import Linkage
from solve.errors import SolveError

PHASES = np.linspace(0, 2 * np.pi, 24, endpoint=False)


@pytest.mark.parametrize("branch", ["open", "crossed"])
def test_link_positions_match_the_rigid_linkage(branch):
    model = solve.load("four_bar", options={"branch": branch})
    rigid = Linkage(*(model.parameters[f"L{i}"] for i in range(1, 5)), branch=branch).motion(PHASES)
    positions = model.at_positions(PHASES)
    np.testing.assert_allclose(np.exp(1j * positions.angle.T), np.exp(1j * rigid.t), atol=1e-13)
    places = dict(zip("OABC", positions.joints.T, strict=True))
    np.testing.assert_allclose(places["A"], rigid.position(2), atol=1e-14)
    np.testing.assert_allclose(places["B"], rigid.position(3, model.parameters["L3"]), atol=1e-13)
    np.testing.assert_allclose(places["C"], model.parameters["L4"], atol=1e-13)


def test_mirrored_linkage_has_equal_frequencies_in_mirrored_positions():
    computed = [
        solve.frequencies(solve.load("four_bar", options={"branch": branch}), sign * PHASES, 4).values
        for branch, sign in (("open", 1), ("crossed", -1))
    ]
    np.testing.assert_allclose(computed[0], computed[1], rtol=1e-9)


def test_joint_masses_lower_and_stiffness_raises_every_frequency():
    def values(**parameters):
        return solve.frequencies(
            solve.load("four_bar", options={"element": "dynamic"}, **parameters), 1.0
        ).values[0]

    base = values()
    assert (values(mA=0.3) < base).all()
    assert (values(mB=0.3) < base).all()
    np.testing.assert_allclose(values(E=4 * 210e9), 2 * base, rtol=1e-10)
    assert (values(rho=2 * 7850) < base).all()


def test_crank_is_clamped_to_flywheel():
    names = solve.load("four_bar").coordinates
    assert not [name for name in names if name.startswith(("O_", "crank_O", "C_"))]
    assert {"crank_A_turn", "coupler_A_turn", "follower_C_turn"} <= set(names)


@pytest.mark.parametrize("lengths", [(0.4, 0.3, 0.5, 0.5), (0.17, 0.1, 0.525, 0.547), (0.5, 0.5, 0.2, 0.6)])
def test_elastic_and_rigid_linkage_require_the_same_full_turn(lengths):
    named = dict(zip(("L1", "L2", "L3", "L4"), lengths, strict=True))
    assert not Linkage(*lengths).turns_fully
    with pytest.raises(SolveError, match="the crank cannot turn fully"):
        solve.load("four_bar", **named)


def test_element_options_are_taken_link_by_link():
    one = solve.load("four_bar", options={"elements": "2,1,3", "element": "cubic,internal,curvature"})
    same = solve.load(
        "four_bar", options={"elements": (2, 1, 3), "element": ["cubic", "internal", "curvature"]}
    )
    assert one.coordinates == same.coordinates
    assert one.labels.options == same.labels.options
    assert one.beams.freedoms.counts == (2, 1, 3)
    assert one.beams.freedoms.kinds == ("cubic", "internal", "curvature")


def test_exact_elements_permit_frequencies_only():
    with pytest.raises(
        SolveError, match="has natural frequencies only, without equations of motion; choose another"
    ):
        solve.periodic(solve.load("four_bar", options={"element": "dynamic"}), 30.0)


@pytest.mark.parametrize(
    ("element", "elements"),
    [
        ("cubic", 30),
        *(pytest.param(name, 50, marks=pytest.mark.slow) for name in ("internal", "dynamic")),
    ],
    ids=lambda value: str(value),
)
def test_low_frequencies_stay_accurate_with_very_high_modes(element, elements):
    """A short crank with many elements has modes that are a million times faster than the lowest one."""
    exact = solve.load("four_bar", options={"element": "dynamic"}, L1=0.02)
    fine = solve.load("four_bar", options={"element": element, "elements": elements}, L1=0.02)
    expected = solve.frequencies(exact, 0.3, 4).values
    assert np.all(expected > 100)
    assert solve.frequencies(fine, 0.3, 4).values == pytest.approx(expected, rel=1e-5)
