"""MATLAB files, read by SciPy and compared with the system."""

import numpy as np
from scipy.io import loadmat

import solve


def read(system, folder, *speed):
    solve.export(system, folder / "made.mat", *speed, samples=12)
    return loadmat(folder / "made.mat", squeeze_me=True)


def test_mat_file_contains_the_matrices_with_phase_as_last_index(tmp_path):
    model, speed = solve.load("cam"), 60.0
    values = read(model, tmp_path, speed)
    parts = dict(zip(("M", "Cq", "K", "d"), model.at(values["phase"], speed), strict=True))
    for name, expected in parts.items():
        np.testing.assert_array_equal(np.moveaxis(values[name], -1, 0), expected)
    for k in range(12):
        M, Cq, K = (values[name][..., k] for name in ("M", "Cq", "K"))
        A, B = values["A"][..., k], values["B"][..., k]
        np.testing.assert_allclose(M @ A[3:], -np.hstack((K, Cq)), rtol=1e-9, atol=1e-9 * np.abs(K).max())
        np.testing.assert_allclose(M @ B[3:], np.eye(3), atol=1e-12)


def test_mat_file_contains_names_units_parameters_and_multipliers(tmp_path):
    model = solve.load("manipulator")
    values = read(model, tmp_path)
    assert values["outputs"].tolist() == ["q1", "q2", *model.outputs]
    assert values["input_units"].tolist() == ["N m", "N"]
    assert dict(zip(values["parameter_names"], values["parameter_values"], strict=True)) == model.parameters
    np.testing.assert_allclose(values["speed"], 50 * 2 * np.pi / 60, rtol=1e-14)
    np.testing.assert_array_equal(values["multipliers"], solve.floquet(model, "50 rpm").multipliers)
    assert values["verdict"] == "asymptotically stable"


def test_user_systems_and_structures_of_beams_are_exported(tmp_path):
    def oscillator(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]

    values = read(solve.PeriodicSystem(oscillator, ["q"]), tmp_path, 1.0)
    assert values["A"].shape == (2, 2, 12)
    assert values["parameter_values"].size == 0
    assert read(solve.load("four_bar"), tmp_path, "30 rad/s")["A"].shape == (18, 18, 12)
