"""Claims of Chapters 5, 7 and 9 of the thesis about the running four-bar and Mathieu's equation."""

import numpy as np
import pytest
from scipy.special import mathieu_a, mathieu_b

import solve
from solve.equations import output_values
from solve.results.periodic_motion import QuasiStatic

TURN = np.arange(180) * (2 * np.pi / 180)
LINKS = ("coupler", "follower")


def test_quasi_static_response_has_no_peaks_versus_speed():
    """Thesis 7.1. Without gravity, it is proportional to the square of the speed."""
    model = solve.load("four_bar")
    curves = [
        output_values(model, TURN, speed, *QuasiStatic(model, speed).state(TURN))[
            "follower_midpoint_deflection"
        ]
        / speed**2
        for speed in (20.0, 46.14, 61.33)
    ]
    for curve in curves[1:]:
        np.testing.assert_allclose(curve, curves[0], rtol=0, atol=1e-12 * np.abs(curves[0]).max())


@pytest.fixture(scope="module")
def orbit():
    return solve.periodic(solve.load("four_bar", options={"elements": 2}), 30.0, rtol=1e-6)


def truncation_error(orbit, output, count):
    """Return the largest difference over a period between the lowest modes and all modes, relative to the
    largest value of all modes."""
    computed = orbit.system.modal_contributions(orbit, output, count=count)
    return np.abs(computed.values.sum(axis=0) - computed.total).max() / np.abs(computed.total).max()


def test_four_modes_reproduce_the_motion(orbit):
    """Thesis 5.4.2. Deflections agree to 0.5 %, stresses to 10 %."""
    for link in LINKS:
        assert truncation_error(orbit, f"{link}_midpoint_deflection", 4) < 0.005
        assert truncation_error(orbit, f"{link}_midpoint_stress_plus", 4) < 0.1


def test_modal_truncation_affects_stresses_more_than_deflections(orbit):
    """Thesis 7.4. Three modes give the deflection of the coupler to 1 % and its stress to no better than
    5 %."""
    assert truncation_error(orbit, "coupler_midpoint_deflection", 3) < 0.01
    assert truncation_error(orbit, "coupler_midpoint_stress_plus", 3) > 0.05


def test_stresses_require_more_elements_than_deflections(orbit):
    """Thesis 7.4. Two elements per link are compared with quintic elements, whose curvature converges."""
    options = {"element": "internal", "elements": 2}
    fine = solve.periodic(solve.load("four_bar", options=options), 30.0, rtol=1e-5)
    deflection, stress = (
        abs(orbit.statistics(name).max_abs / fine.statistics(name).max_abs - 1)
        for name in ("follower_midpoint_deflection", "follower_midpoint_stress_plus")
    )
    assert deflection < 0.01
    assert stress > 0.1


def test_phase_agrees_except_for_the_one_element_model(orbit):
    """Thesis 7.4.1, Fig. 7.9. The crank angle (degrees) of the largest stress of the follower at 30 rad/s is
    compared."""
    others = [
        solve.periodic(solve.load("four_bar", options={"elements": n}), 30.0, rtol=1e-4) for n in (1, 3)
    ]
    one, two, three = (
        np.degrees(each.statistics("follower_midpoint_stress_plus").min_phase)
        for each in (others[0], orbit, others[1])
    )
    assert abs(two - three) < 0.5
    assert abs(one - three) > 4


@pytest.mark.slow
def test_more_elements_lower_the_critical_speeds():
    """Thesis 7.4.1, harmonic 4. With one element per link, the speed is over 8 % higher than with two."""
    at = []
    for elements, speeds in ((1, np.arange(45.0, 47.6, 0.25)), (2, np.arange(41.0, 42.6, 0.125))):
        model = solve.load("four_bar", options={"elements": elements})
        sweep = solve.sweep(model, speeds, rtol=1e-4, quantities=["follower_midpoint_deflection"])
        size = sweep.figures("follower_midpoint_deflection")
        assert 0 < size.argmax() < len(speeds) - 1
        at.append(speeds[size.argmax()])
    assert at[0] > 1.08 * at[1]


@pytest.mark.parametrize(("zeta", "stable"), [(0.0, False), (0.02, True)])
def test_damping_removes_an_instability_far_below_the_first_frequency(zeta, stable):
    """Thesis 7.2.3 and 9.1. The speed is 61.05 rad/s, at which the stress has its peak of harmonic 3. No
    natural frequency at any position is below 160 rad/s."""
    model = solve.load("four_bar", options={"terms": "full"}, zeta=zeta)
    assert solve.frequencies(model, TURN[::5], 1).values.min() > 160
    stability = solve.floquet(model, 61.05, rtol=1e-5)
    assert stability.stable is stable
    assert (stability.spectral_radius > 1.005) == (not stable)


def cycles(speed, zeta):
    """Return the number of cycles after which a transient has decayed to 1e-4, from the largest modulus of
    the multipliers."""
    stability = solve.floquet(solve.load("four_bar", zeta=zeta), speed, rtol=1e-5)
    return np.log(1e-4) / np.log(stability.spectral_radius)


def test_damping_determines_the_convergence_of_marching():
    """Thesis 2.2.2, 6.2 and 7.2. The speed 61.33 rad/s is compared with non-resonant speeds on either side,
    and with a tenth of the damping."""
    critical, *quiet = (cycles(speed, 0.02) for speed in (61.33, 56.0, 67.0))
    assert max(quiet) < critical < 1.25 * min(quiet)
    assert cycles(61.33, 0.002) > 5 * critical


@pytest.mark.parametrize(
    ("low", "high", "peaks"), [(8.0, 17.0, False), (20.0, 24.0, True), (28.0, 33.0, True)]
)
def test_damping_removes_critical_speeds_at_low_speeds(low, high, peaks):
    """Thesis 7.2.3. Up to 17 rad/s, the largest deflection increases with the speed without a maximum."""
    speeds, name = np.linspace(low, high, 25), "follower_midpoint_deflection"
    size = solve.sweep(solve.load("four_bar"), speeds, rtol=1e-4, quantities=[name]).figures(name)
    assert (np.diff(size) > 0).all() != peaks


@pytest.mark.slow
def test_unstable_bands_widen_with_the_speed():
    """Thesis 7.3, without damping. The bands are those of the lowest mode near 2/7, 2/6, 2/5 and 2/4 of its
    mean frequency."""
    model = solve.load("four_bar", options={"terms": "full"}, zeta=0.0)
    windows = ([52.2, 52.45], [60.9, 61.15], [72.45, 72.75], [91.55, 92.05])
    widest = [
        max(band.high - band.low for band in solve.bands(model, window, rtol=1e-6)) for window in windows
    ]
    assert (np.diff(widest) > 0).all()


def half_trace(frequencies, speeds):
    """Return J_N of (7.11) at speeds (m,) for y″ + ω_i² y = 0 on N equal intervals of a period."""
    turned = np.broadcast_to(np.eye(2), (len(speeds), 2, 2))
    for omega in frequencies:
        angle = omega * 2 * np.pi / speeds / len(frequencies)
        c, s = np.cos(angle), np.sin(angle)
        turned = np.moveaxis(np.array([[c, s / omega], [-omega * s, c]]), -1, 0) @ turned
    return np.trace(turned, axis1=1, axis2=2) / 2


@pytest.mark.parametrize("parts", [2, 3, 4])
def test_two_to_four_intervals_give_the_critical_speeds(parts):
    """Thesis 7.2.3, Fig. 7.3. The maxima of J2, J3 and J4, with the first frequency at the middle of each
    interval, are within 1.5 % of the peaks of the deflection from an independent program."""
    peaks = np.array([26.37, 30.73, 36.87, 46.14, 61.33, 92.59])
    middles = (np.arange(parts) + 0.5) * 2 * np.pi / parts
    first = solve.frequencies(solve.load("four_bar"), middles, 1).values[:, 0]
    speeds = np.linspace(25.0, 100.0, 20_001)
    J = half_trace(first, speeds)
    maxima = speeds[1:-1][(J[1:-1] > J[:-2]) & (J[1:-1] >= J[2:])]
    nearest = np.array([maxima[np.abs(maxima - peak).argmin()] for peak in peaks])
    np.testing.assert_allclose(nearest, peaks, rtol=0.015)


def mathieu(delta, epsilon, zeta):
    return solve.floquet(solve.load("mathieu", delta=delta, epsilon=epsilon, zeta=zeta), 1.0, rtol=1e-8)


@pytest.mark.parametrize("i", [1, 2, 3])
def test_mathieus_equation_without_its_cosine_is_stable_at_squares(i):
    """Thesis 7.2.3 calls it unstable. Solutions of y″ + i² y = 0 rotate by multiples of half a revolution, so
    that both multipliers are 1 or -1 and all solutions are bounded. With a small cosine term, the equation is
    unstable."""
    assert mathieu(float(i**2), 0.0, 0.0).verdict == "stable"
    epsilon = 0.5
    middle = (mathieu_b(i, epsilon / 2) + mathieu_a(i, epsilon / 2)) / 2
    assert mathieu(middle, epsilon, 0.0).verdict == "unstable"
    assert middle == pytest.approx(i**2, abs=0.1)


def test_mathieus_unstable_regions_narrow_as_d_grows():
    """Thesis 7.2.3. The widths follow from SciPy's characteristic values. The damping that removes the growth
    in the middle of a region decreases with them."""
    epsilon, growth, width = 4.0, [], []
    for i in range(1, 5):
        low, high = mathieu_b(i, epsilon / 2), mathieu_a(i, epsilon / 2)
        width.append(high - low)
        growth.append(np.log(mathieu((low + high) / 2, epsilon, 0.0).spectral_radius))
    assert (np.diff(width) < 0).all()
    assert (np.diff(growth) < 0).all()
    assert min(growth) > 0
