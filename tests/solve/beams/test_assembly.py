"""Assembled matrices compared with loops over elements, and energies of rigid motions."""

import numpy as np
import pytest

import solve
from solve.beams.assembly import Positions
from solve.beams.element import element
from solve.errors import StructureError
from tests.solve.beams.frames import beams

KINDS = ("cubic", "internal", "curvature")
PHASES = np.array([0.0, 0.7, 2.1, 4.4])


def textbook(L, EA, EI, mu):
    """Return mass and stiffness of the cubic element for u1, v1, θ1, u2, v2, θ2, as printed in a textbook."""
    M = mu * L / 420 * np.array(
        [
            [140, 0, 0, 70, 0, 0],
            [0, 156, 22 * L, 0, 54, -13 * L],
            [0, 22 * L, 4 * L**2, 0, 13 * L, -3 * L**2],
            [70, 0, 0, 140, 0, 0],
            [0, 54, 13 * L, 0, 156, -22 * L],
            [0, -13 * L, -3 * L**2, 0, -22 * L, 4 * L**2],
        ]
    )  # fmt: skip
    a, b = EA / L, EI / L**3
    K = np.array(
        [
            [a, 0, 0, -a, 0, 0],
            [0, 12 * b, 6 * b * L, 0, -12 * b, 6 * b * L],
            [0, 6 * b * L, 4 * b * L**2, 0, -6 * b * L, 2 * b * L**2],
            [-a, 0, 0, a, 0, 0],
            [0, -12 * b, -6 * b * L, 0, 12 * b, -6 * b * L],
            [0, 6 * b * L, 2 * b * L**2, 0, -6 * b * L, 4 * b * L**2],
        ]
    )
    return M, K


def looped(model, phase):
    """Return M and K of the four-bar from a loop over elements, rotations and degrees of freedom (thesis
    (4.28), (4.30))."""
    p = model.parameters
    t1 = phase
    across = p["L4"] - p["L1"] * np.exp(1j * t1)
    d = abs(across)
    cosine = (p["L2"] ** 2 + d**2 - p["L3"] ** 2) / (2 * p["L2"] * d)
    t2 = np.angle(across) + np.arccos(cosine)
    t3 = np.angle(p["L2"] * np.exp(1j * t2) - across)
    names = model.beams.freedoms.names
    M, K = np.zeros((2, len(names), len(names)))
    ends = {"crank": "OA", "coupler": "AB", "follower": "CB"}
    for i, (link, angle) in enumerate(zip(ends, (t1, t2, t3), strict=True), start=1):
        count = model.beams.freedoms.counts[i - 1]
        EA, EI, mu = (p["E"] * p[f"A{i}"], p["E"] * p[f"I{i}"], p["rho"] * p[f"A{i}"])
        local = textbook(p[f"L{i}"] / count, EA, EI, mu)
        c, s = np.cos(angle), np.sin(angle)
        R = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
        start, end = ends[link]
        for e in range(count):
            row = []
            for node in (e, e + 1):
                joint = {0: start, count: end}.get(node)
                place = f"{joint}" if joint else f"{link}_{node}"
                turn = f"{link}_{joint}_turn" if joint else f"{link}_{node}_turn"
                row += [f"{place}_x", f"{place}_y", turn]
            here = [names.index(name) if name in names else None for name in row]
            for matrix, each in zip((M, K), local, strict=True):
                turned = R.T @ each @ R
                for a, x in enumerate(here):
                    for b, y in enumerate(here):
                        if x is not None and y is not None:
                            matrix[x, y] += turned[a, b]
    for joint in "AB":
        for axis in "xy":
            at = names.index(f"{joint}_{axis}")
            M[at, at] += p[f"m{joint}"]
    return M, K


@pytest.mark.parametrize("elements", [1, 2, "3,1,2"])
def test_assembled_matrices_equal_a_loop_over_elements(elements):
    model = solve.load("four_bar", options={"elements": elements})
    M, K = model.at_positions(PHASES).matrices()
    for phase, m, k in zip(PHASES, M, K, strict=True):
        expected_m, expected_k = looped(model, phase)
        np.testing.assert_allclose(m, expected_m, atol=1e-13 * abs(expected_m).max())
        np.testing.assert_allclose(k, expected_k, atol=1e-12 * abs(expected_k).max())


def free_frame(kind, count):
    """Return an unsupported frame: three arms with different angles that meet at a common joint."""
    links = [("one", "A", "B", "w", "b"), ("two", "A", "C", "w", "c"), ("three", "A", "D", "a", "d")]
    angles = [lambda p: p, lambda p: 1.1 + 0.5 * np.sin(p), lambda p: -2 * p]
    lengths, mu = [0.7, 1.2, 0.4], [1.0, 2.0, 3.0]
    return beams(links, (), lengths, angles, kind, count, EA=50.0, EI=0.3, mu=mu, masses={"B": 0.6})


def rigid(positions):
    """Return the displacements (m, n, 3) of translations along x and y and of a rotation about joint A at the
    origin."""
    names = positions.beams.freedoms.names
    vectors = np.zeros((len(positions.phase), len(names), 3))
    for number, nodes in enumerate(positions.beams.freedoms.nodes):
        length = positions.beams.properties.length[number]
        for node in nodes:
            place = node.place * length * np.exp(1j * positions.angle[:, number])
            vectors[:, node.x, 0] = vectors[:, node.y, 1] = 1
            vectors[:, node.x, 2], vectors[:, node.y, 2] = -np.imag(place), np.real(place)
    for i, name in enumerate(names):
        vectors[:, i, 2] += name.endswith("_turn")
    return vectors


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, 3])
def test_rigid_motions_have_total_mass_and_no_strain_energy(kind, count):
    positions = Positions(free_frame(kind, count), PHASES)
    vectors = rigid(positions)
    M, K = positions.matrices()
    np.testing.assert_allclose(K @ vectors, 0, atol=1e-9 * abs(K).max())
    weight = np.swapaxes(vectors, 1, 2) @ M @ vectors
    mass, inertia = 0.7 + 2.4 + 1.2 + 0.6, (0.7**3 + 2 * 1.2**3 + 3 * 0.4**3) / 3 + 0.6 * 0.7**2
    np.testing.assert_allclose(weight[:, 0, 0], mass, rtol=1e-12)
    np.testing.assert_allclose(weight[:, 1, 1], mass, rtol=1e-12)
    np.testing.assert_allclose(weight[:, 0, 1], 0, atol=1e-12)
    np.testing.assert_allclose(weight[:, 2, 2], inertia, rtol=1e-12)


def test_exact_stiffness_approaches_finite_elements_at_low_frequencies():
    """K − ω²M of the cubic element contains the first terms of the power series of D. The remainder is of
    order ω⁴."""
    exact, cubic = (Positions(free_frame(kind, 1), PHASES) for kind in ("dynamic", "cubic"))
    M, K = cubic.matrices()
    index = np.arange(len(PHASES))
    errors = []
    for omega in (0.2, 0.1):
        D = exact.dynamic_stiffness(index, np.full(len(PHASES), omega))
        errors.append(abs(D - (K - omega**2 * M)).max())
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.01)
    M_exact = exact.dynamic_mass(index, np.full(len(PHASES), 1e-3))
    np.testing.assert_allclose(M_exact, M, atol=1e-6 * abs(M).max())


def test_links_may_have_different_element_types():
    """The frequencies agree for different combinations of elements."""
    frequencies = [
        solve.frequencies(solve.load("four_bar", options=options), 1.0).values[0]
        for options in (
            {"element": "dynamic"},
            {"element": "cubic,dynamic,internal", "elements": "6,1,4"},
            {"element": "curvature,cubic,dynamic", "elements": "3,10,2"},
        )
    ]
    for frequency in frequencies[1:]:
        np.testing.assert_allclose(frequency, frequencies[0], rtol=3e-5)


def test_four_bar_coordinates_have_the_expected_names():
    counts = {}
    for elements in (1, 2, 3, 4):
        counts[elements] = solve.load("four_bar", options={"elements": elements}).n
    assert counts == {1: 9, 2: 18, 3: 27, 4: 36}
    curved = solve.load("four_bar", options={"element": "curvature"})
    assert curved.n == 10
    assert set(curved.coordinates) == {
        "A_x", "A_y", "crank_O_curvature", "crank_A_turn",
        "B_x", "B_y", "coupler_A_turn", "coupler_B_turn", "follower_C_turn", "follower_B_turn",
    }  # fmt: skip


def test_welded_links_share_the_rotation_but_not_the_curvature():
    links = [("one", "A", "B", "", "w"), ("two", "B", "C", "w", "c")]
    positions = Positions(beams(links, ["A"], 1.0, [0.0, 1.0], "curvature"), np.zeros(1))
    assert set(positions.beams.freedoms.names) == {
        "one_A_curvature", "B_x", "B_y", "w_turn", "one_B_curvature", "two_B_curvature",
        "C_x", "C_y", "c_turn",
    }  # fmt: skip


def test_displacement_in_an_element_follows_the_shape_functions():
    axial, transverse = element("cubic").shapes(0.5, np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(axial[:, :2], [[1, 0], [0.5, 0.5], [0, 1]])
    np.testing.assert_allclose(axial[:, 2:], 0)
    np.testing.assert_allclose(transverse[1], [0, 0, 0.5, 0.5 / 8, 0.5, -0.5 / 8])


def tied(EA=1.0, inextensible=True, kind="cubic", count=2):
    """Return a triangle of two legs and a tie that rotates with the phase about the fixed joint A."""
    links = [
        ("leg", "A", "B", "a", "b"),
        ("tie", "B", "C", "x", "y", inextensible),
        ("post", "A", "C", "a", "c"),
    ]
    turn = [lambda p: p, lambda p: p + 2 * np.pi / 3, lambda p: p + np.pi / 3]
    return beams(links, ["A"], 1.0, turn, kind, count, EA=[40.0, EA, 40.0], EI=0.02)


@pytest.mark.parametrize("kind", [*KINDS, "dynamic"])
def test_inextensible_link_is_the_limit_of_increasing_stiffness(kind):
    stiff = Positions(tied(1e8, False, kind), PHASES)
    ideal = Positions(tied(1.0, True, kind), PHASES)
    count = 2 if kind == "dynamic" else ideal.beams.freedoms.counts[1] * (2 if kind == "internal" else 1)
    assert ideal.n == ideal.beams.freedoms.n - count
    systems = [_frequencies(each) for each in (stiff, ideal)]
    np.testing.assert_allclose(systems[1], systems[0], rtol=1e-6, atol=1e-3)


def _frequencies(positions):
    from solve.beams.frequencies import lowest

    return lowest(positions, 6)


def test_links_that_do_not_reach_their_joint_are_refused():
    links = [("leg", "A", "B", "a", "b"), ("back", "A", "B", "c", "d")]
    with pytest.raises(StructureError, match=r"link back misses joint B by 0\.1 m"):
        Positions(beams(links, ["A"], [1.0, 1.1], [0.0, 0.0]), np.zeros(1))


def test_fixed_joint_that_moves_with_the_angles_is_refused():
    links = [("leg", "A", "B", "a", "b")]
    with pytest.raises(StructureError, match="joint B is supported, but the angles of the links move it"):
        Positions(beams(links, ["A", "B"], 1.0, [lambda p: p]), PHASES)


def test_dependent_inextensible_links_are_refused():
    """The links form an inextensible parallelogram, which is flat at phase 0."""
    links = [
        ("one", "A", "B", "a", "b", True),
        ("two", "B", "C", "c", "d", True),
        ("three", "D", "C", "e", "f", True),
    ]
    frame = beams(links, ["A", "D"], [1.0, 2.0, 1.0], [lambda p: p, 0.0, lambda p: p])
    with pytest.raises(StructureError, match="at 0 deg the inextensible links leave a different number"):
        Positions(frame, np.array([0.5, 0.0])).matrices()
