"""Studies of free machines: rigid-body modes in all results."""

import numpy as np
import pytest

import solve
from tests.solve.free_machines import (
    DRAG,
    SHAFTS,
    SPEED,
    J,
    amplitudes,
    exact_multipliers,
    mechanism,
    orders,
    train,
)

ALL = ["periodic", "sweep", "chart", "compare", "critical", "sensitivity", "validity"]


@pytest.mark.parametrize("command", ALL)
def test_all_studies_agree_on_a_free_machine(command):
    machine, truth = mechanism(), amplitudes(SPEED, SHAFTS)
    if command == "periodic":
        assert orders(solve.periodic(machine, SPEED)) == pytest.approx(truth, rel=1e-8)
    elif command == "sweep":
        computed = solve.sweep(machine, [SPEED], over={"T": [10.0, 20.0]}, spectra=["q5"], harmonics=2)
        assert computed.spectrum("q5")[:, 2] == pytest.approx(np.array([1, 2]) * truth[4], rel=1e-8)
    elif command == "chart":
        for of, value in (("q5.harmonic2", truth[4]), ("rho1.abs", 1.0)):
            chart = solve.chart(machine, {"speed": [SPEED, 1.1 * SPEED]}, {"c": [1e-4, 2e-4]}, of=of)
            assert chart.values[0, 0] == pytest.approx(value, rel=1e-8)
        assert "rigid-body modes at all points" in chart.notes[0]
        exact = np.abs(exact_multipliers(SHAFTS, SPEED)[2])
        assert chart.spectral_radius[0, 0] == pytest.approx(exact, rel=1e-8)
        assert set(chart.verdicts.ravel()) == {"asymptotically stable"}
    elif command == "compare":
        computed = solve.compare(machine, SPEED, ["gauss", "fourier"], targets=[1e-6])
        assert orders(computed.reference) == pytest.approx(truth, rel=1e-8)
        assert all(row.orbit_error <= 1e-6 for row in computed.rows if row.target)
    elif command == "critical":
        computed = solve.critical_speeds(machine, np.linspace(2000, 3000, 21) * np.pi / 30, figure="rms")
        (row,) = (row for row in computed.rows if row.response)
        assert (row.mode, row.order) == (2, 2)
        around = row.response.speed * (1 + 1e-3 * np.array([-1, 0, 1]))
        below, top, above = (amplitudes(speed, SHAFTS)[0] for speed in around)
        assert top > max(below, above)
        assert row.response.height == pytest.approx(top / np.sqrt(2), rel=1e-6)
    elif command == "sensitivity":
        computed = solve.sensitivities(machine, SPEED, of=["q5.harmonic2", "shaft.max_abs"], by=["T", "J1"])
        assert computed.elasticities("q5.harmonic2")["T"] == pytest.approx(1.0, rel=1e-8)
        changed = [amplitudes(SPEED, SHAFTS, J + np.diag([h, 0, 0, 0, 0]))[4] for h in (-1e-8, 1e-8)]
        slope = (changed[1] - changed[0]) / 2e-8
        assert computed.elasticities("q5.harmonic2")["J1"] == pytest.approx(
            slope * 3.5e-3 / truth[4], rel=1e-6
        )
    else:
        # The equations of the machine are linear.
        assert solve.validity(machine, [SPEED]).errors.max() < 1e-12


def test_rigid_body_modes_come_first_on_the_unit_circle():
    machine = mechanism(c=0.0)
    for speed in (500, 700, 1000, 1500, 2000):
        orbit = solve.periodic(machine, f"{speed} rpm")
        assert orbit.multipliers[:2].tolist() == [1, 1]
        sensitivities = solve.sensitivities(machine, f"{speed} rpm", ["rho3.abs", "exponent3.im"], ["k4"])
        assert sensitivities.warnings == []
        assert sensitivities["rho3.abs"]["k4"] == pytest.approx(0.0, abs=1e-12)


def test_drag_without_a_mean_load_leaves_no_steady_velocity():
    (note,) = solve.periodic(mechanism(b=0.07), SPEED).notes
    assert note.endswith("; the motion has no steady velocity along this mode")


def test_bands_report_rigid_body_modes():
    bands = solve.bands(mechanism(), "500:3000:5 rpm")
    assert bands.notes[0].startswith("rigid-body modes: ")
    assert list(bands) == []


def test_saved_orbit_of_a_free_machine_is_read(tmp_path):
    orbit = solve.periodic(train(DRAG, mean=1.0), SPEED)
    orbit.save(tmp_path / "orbit.nc")
    again = solve.open(tmp_path / "orbit.nc")
    assert again.rigid_body_modes == orbit.rigid_body_modes
    np.testing.assert_array_equal(again.qd, orbit.qd)
    assert again.notes == orbit.notes
