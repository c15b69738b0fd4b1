"""Tables 1 and 2 of the paper, from hand-coded equations and an independent harmonic collocation."""

import numpy as np
import pytest

from models.coupler import published
from models.coupler.published import AS_PRINTED, CORRECTED, TABLE_1, TABLE_2, Misprint

PRINTED_MAXIMA_MM = {
    600: (0.2750, 0.0090, 0.0011),
    900: (0.6309, 0.0204, 0.0025),
    1200: (1.1583, 0.0364, 0.0046),
    1500: (1.8704, 0.0572, 0.0072),
}
LAST_DIGIT = 0.5e-4


def maxima(parameters, rpm, modes=3, branch="open", misprints=CORRECTED, count=65):
    """Return the largest |q| (mm) on the continuous curve of the periodic solution, collocated at `count`
    phases."""
    speed = rpm * np.pi / 30
    phase = 2 * np.pi * np.arange(count) / count
    M, B, C, h = published.paper_matrices(phase, speed, parameters, modes, branch, misprints)
    order = np.fft.fftfreq(count, 1 / count)
    wave, pulse = np.exp(1j * np.outer(phase, order)), 1j * speed * order
    blocks = (
        np.einsum("tij,tk,k->tikj", M, wave, pulse**2)
        + np.einsum("tij,tk,k->tikj", B, wave, pulse)
        + np.einsum("tij,tk->tikj", C, wave)
    )
    amplitude = np.linalg.solve(blocks.reshape(count * modes, -1), h.reshape(-1)).reshape(count, modes)
    fine = 2 * np.pi * np.arange(4000) / 4000
    return 1e3 * abs((np.exp(1j * np.outer(fine, order)) @ amplitude).real).max(axis=0)


def reproduces_table_2(parameters, misprints=CORRECTED):
    return all(
        np.all(abs(maxima(parameters, rpm, misprints=misprints) - row) <= LAST_DIGIT)
        for rpm, row in PRINTED_MAXIMA_MM.items()
    )


@pytest.mark.parametrize("rpm", PRINTED_MAXIMA_MM)
def test_collocation_reproduces_table_2(rpm):
    np.testing.assert_allclose(maxima(TABLE_2, rpm), PRINTED_MAXIMA_MM[rpm], rtol=0, atol=LAST_DIGIT)


@pytest.mark.parametrize("rpm", PRINTED_MAXIMA_MM)
def test_collocation_has_converged(rpm):
    np.testing.assert_allclose(maxima(TABLE_2, rpm, count=65), maxima(TABLE_2, rpm, count=129), rtol=1e-9)


@pytest.mark.parametrize("name", ["I", "rho"])
def test_printed_parameters_of_table_1_contradict_table_2(name):
    assert not reproduces_table_2(TABLE_2 | {name: TABLE_1[name]})


def test_corrected_parameters_agree_with_section_and_mass():
    width, height = 0.02, 0.03
    assert TABLE_2["A"] == pytest.approx(width * height)
    assert TABLE_2["I"] == pytest.approx(width * height**3 / 12)
    assert TABLE_2["rho"] * TABLE_2["A"] * TABLE_2["l3"] == pytest.approx(TABLE_2["m3"], abs=0.005)


def test_printed_table_1_gives_a_ten_times_softer_coupler():
    at_printed_mass = TABLE_1 | {"A": TABLE_1["m3"] / (TABLE_1["rho"] * TABLE_1["l3"])}
    assert maxima(TABLE_1, 600)[0] == pytest.approx(3.0345, abs=LAST_DIGIT)
    assert maxima(at_printed_mass, 600)[0] == pytest.approx(3.0045, abs=LAST_DIGIT)
    assert maxima(TABLE_1, 1500)[0] == pytest.approx(35.01, abs=0.005)


def test_printed_table_1_is_near_buckling_at_1500_rpm():
    loads = published.load_functions(np.linspace(0, 2 * np.pi, 2001), 50 * np.pi, TABLE_1)
    euler = (np.pi / TABLE_1["l3"]) ** 2
    assert abs(loads.f4).max() / euler == pytest.approx(0.84, abs=0.005)


@pytest.mark.parametrize(
    ("misprint", "seen"),
    [
        (Misprint.AXIAL_DRAG_SIGN, False),
        (Misprint.END_FORCE, False),
        (Misprint.LOST_CENTRIFUGAL, False),
        (Misprint.EVEN_SUM_ODD, False),
        (Misprint.MODE_COUPLING, True),
        (Misprint.MATERIAL_DAMPING, True),
        (Misprint.CENTRIFUGAL_SIGN, True),
    ],
)
def test_table_2_detects_the_stated_misprints(misprint, seen):
    """The other misprints change no printed digit. They are detected only by the second derivation."""
    assert reproduces_table_2(TABLE_2, frozenset({misprint})) is not seen


def test_printed_equations_do_not_reproduce_table_2():
    assert not reproduces_table_2(TABLE_2, AS_PRINTED)


@pytest.mark.parametrize("rpm", PRINTED_MAXIMA_MM)
def test_three_modes_are_sufficient(rpm):
    assert maxima(TABLE_2, rpm, modes=8)[0] == pytest.approx(maxima(TABLE_2, rpm, modes=3)[0], rel=1e-5)
