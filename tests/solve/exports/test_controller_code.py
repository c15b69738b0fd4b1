"""Exported controllers: compiled C code and MATLAB files, compared with the result."""

import ctypes
import subprocess

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import loadmat

import solve
from solve.errors import FileError, ValueOutOfBoundsError
from solve.kernel.compiler import CompilerError, c_compiler


@pytest.fixture(scope="module")
def found():
    noise = {"u": 1.0}, {"q1": 1e-9}
    press = solve.load("manipulator")
    return solve.lqg(press, "70 rpm", {"q2": 1e8}, {"u": 1e-3}, *noise, feedforward=True, rtol=1e-6)


def test_matlab_file_contains_the_gains_and_the_observer(found, tmp_path):
    solve.export(found, tmp_path / "c.mat", samples=16)
    content = loadmat(tmp_path / "c.mat")
    phase = content["phase"].ravel()
    assert np.allclose(np.moveaxis(content["K"], -1, 0), found.gain(phase))
    assert np.allclose(np.moveaxis(content["L"], -1, 0), found.observer.gain(phase))
    space = solve.state_space(found.compensator, found.speed, samples=16)
    assert np.allclose(np.moveaxis(content["A"], -1, 0), space.A)
    assert space.signals.inputs == ("q1_measured",)
    assert np.allclose(space.C, -found.gain(phase))


def test_compiled_code_computes_the_inputs_and_the_estimates(found, tmp_path):
    try:
        compiler = c_compiler()
    except CompilerError:
        pytest.skip("no C compiler")
    solve.export(found, tmp_path / "c.c", samples=2048)
    library = tmp_path / "c.so"
    subprocess.run(
        [*compiler.command, "-shared", "-fPIC", "-O1", tmp_path / "c.c", "-o", library, "-lm"],
        check=True,
    )
    code, vector = ctypes.CDLL(str(library)), ctypes.c_double * 4
    x = np.array([0.01, -0.002, 0.3, 0.05])
    u, phase = (ctypes.c_double * 1)(), -1.234
    code.manipulator_controller(ctypes.c_double(phase), vector(*x), u)
    exact = found.feedforward(phase) - found.gain(phase)[0] @ x
    assert u[0] == pytest.approx(float(exact[0, 0]), rel=1e-4)

    dt, y = 1e-3, np.array([0.012])
    estimates = vector(*x)
    code.manipulator_controller_observe(
        ctypes.c_double(phase), ctypes.c_double(dt), (ctypes.c_double * 1)(*y), estimates
    )

    def rates(t, state):
        at = np.array([phase + found.speed * t])
        A, b, L, _, _ = found.compensator.equations_at(at, found.speed)
        return A[0] @ state + b[0] + L[0] @ y

    later = solve_ivp(rates, (0, dt), x, rtol=1e-9, atol=1e-12).y[:, -1]
    assert np.abs(np.array(estimates[:]) - later).max() < 1e-3 * np.abs(later - x).max()


def test_filters_and_unsupported_file_types_are_refused(found, tmp_path):
    with pytest.raises(ValueOutOfBoundsError, match="regulator"):
        solve.export(found.observer, tmp_path / "c.c")
    with pytest.raises(FileError, match=r"\.mat"):
        solve.export(found, tmp_path / "c.csv")
