"""Controllers as functional mock-up units, evaluated by FMPy and compared with the result."""

import shutil

import casadi
import numpy as np
import pytest

import solve

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not any(map(shutil.which, ("cc", "gcc", "clang"))) or not hasattr(casadi.DaeBuilder, "compile_fmu"),
        reason="there is no C compiler, or CasADi is older than 3.8",
    ),
]


def oscillator():
    """q̈ + 0.1 q̇ + (4 + cos φ) q = cos φ + u."""

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        stiffness = (4 + np.cos(phase))[:, None, None]
        return one, 0.1 * one, stiffness, np.cos(phase)[:, None], one

    return solve.PeriodicSystem(matrices, ["q"], inputs=["u"])


def evaluated(file, given, names):
    """Return values of variables of the FMU for given values of others, as mappings from their names."""
    from fmpy import extract, read_model_description
    from fmpy.fmi3 import FMU3Model
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(file)) == []
    description = read_model_description(str(file))
    number = {each.name: each.valueReference for each in description.modelVariables}
    unit = FMU3Model(
        guid=description.instantiationToken,
        unzipDirectory=extract(str(file), str(file.with_suffix(""))),
        modelIdentifier=description.modelExchange.modelIdentifier,
        instanceName="controller",
    )
    unit.instantiate()
    unit.enterInitializationMode()
    unit.exitInitializationMode()
    unit.enterContinuousTimeMode()
    unit.setFloat64([number[name] for name in given], [*given.values()])
    values = unit.getFloat64([number[name] for name in names])
    unit.terminate()
    unit.freeInstance()
    return np.array(values)


def test_fmu_with_an_observer_matches_the_compensator(tmp_path):
    phase, speed, file = 40.0, 2.0, tmp_path / "c.fmu"
    found = solve.lqg(oscillator(), speed, {"q": 3.0}, {"u": 0.5}, {"u": 1.0}, {"q": 0.1}, feedforward=True)
    assert solve.export(found, file, samples=1024).warnings == ()
    given = {"phase": phase, "q": 0.4, "q_hat": 0.5, "q_dot_hat": -0.7}
    values = evaluated(file, given, ["der(q_hat)", "der(q_dot_hat)", "u"])
    A, b, L, _, _ = (each[0] for each in found.compensator.equations_at(np.array([phase]), speed))
    x = np.array([0.5, -0.7])
    u = found.feedforward(phase)[0] - found.gain(phase)[0] @ x
    assert np.allclose(values, np.concatenate((A @ x + b + L @ [0.4], u)), rtol=1e-4)


def test_state_feedback_fmu_has_no_states(tmp_path):
    speed, file = 2.0, tmp_path / "k.fmu"
    found = solve.lqr(oscillator(), speed, {"q": 3.0}, {"u": 0.5})
    solve.export(found, file, samples=1024)
    (u,) = evaluated(file, {"phase": -1.0, "q": 0.4, "q_dot": -0.7}, ["u"])
    assert u == pytest.approx(float(-(found.gain(-1.0)[0] @ [0.4, -0.7])[0]), rel=1e-5)
