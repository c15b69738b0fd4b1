"""No public function of `solve` has the name of a package, so that no import hides a function."""

import inspect
import pkgutil
import random
import subprocess
import sys
from pathlib import Path

import pytest

import solve

FOLDER = Path(solve.__file__).parent
MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages([str(FOLDER)], "solve.")
    if not module.name.endswith("__main__")
)
FUNCTIONS = sorted(name for name in solve.__all__ if inspect.isfunction(getattr(solve, name)))

CALLS = """
import tempfile

import numpy as np

import solve

mathieu, cam = solve.load("mathieu", delta=1.3, epsilon=0.2, zeta=0.05), solve.load("cam")
manipulator = solve.load("manipulator")
rough = {"rtol": 1e-2, "engine": "numpy"}


def reopened(folder):
    solve.floquet(mathieu, 1.0, **rough).save(f"{folder}/kept.npz")
    return solve.open(f"{folder}/kept.npz")


def read_back(folder):
    import scipy.io, xarray
    from tests.solve.readers.lin_files import write_set
    from pathlib import Path

    arrays = {"M": np.eye(1), "K": np.eye(1)}
    np.savez(f"{folder}/a.npz", **arrays)
    scipy.io.savemat(f"{folder}/a.mat", arrays)
    variables = {name: (("row", "column"), value) for name, value in arrays.items()}
    xarray.Dataset(variables).to_netcdf(f"{folder}/a.nc", engine="h5netcdf")
    from tests.solve.op4_files import binary

    Path(f"{folder}/a.op4").write_bytes(binary(arrays))
    for name, value in arrays.items():
        scipy.io.mmwrite(f"{folder}/a.{name}.mtx", value)
    return {
        "read_npz": solve.read_npz(f"{folder}/a.npz"),
        "read_op4": solve.read_op4(f"{folder}/a.op4"),
        "read_mat": solve.read_mat(f"{folder}/a.mat"),
        "read_netcdf": solve.read_netcdf(f"{folder}/a.nc"),
        "read_matrix_market": solve.read_matrix_market(f"{folder}/a.*.mtx"),
        "read_openfast": solve.read_openfast(write_set(Path(folder))),
    }


def read_unit(folder):
    try:
        solve.export(mathieu, f"{folder}/a.fmu", 1.0)
        return solve.read_fmu(f"{folder}/a.fmu", 1.0, ["phase", "speed"], period=np.pi)
    except solve.errors.MissingLibraryError as missing:
        return missing


def at(delta):
    return mathieu.varied({"delta": delta}), 1.0


orbit_file = tempfile.mkdtemp() + "/cam.csv"
solve.periodic(cam, "300 rpm", steps=32).save(orbit_file)
called = {
    "load": mathieu,
    **read_back(tempfile.mkdtemp()),
    "read_fmu": read_unit(tempfile.mkdtemp()),
    "case_numbers": solve.case_numbers("cam"),
    "periodic": solve.periodic(cam, "600 rpm", **rough),
    "nonlinear": solve.nonlinear(cam, "100 rpm", **rough),
    "branch": solve.branch(cam, "100:110 rpm", points=2, rtol=1e-2),
    "scatter": solve.scatter(cam, "100 rpm", 2, rtol=1e-2, engine="numpy"),
    "special_curves": solve.special_curves(
        mathieu, "doubling", ["delta=0.8:1.2", "epsilon=0.2:0.1"], 1.0, points=3, rtol=1e-2
    ),
    "transient": solve.transient(cam, "600 rpm", 1, rtol=1e-2),
    "fit": solve.fit(cam, orbit_file, "k1", speed="300 rpm", rtol=1e-3),
    "optimise": solve.optimise(mathieu, "spectral_radius", {"zeta": (0.0, 0.1)}, 1.0, rtol=1e-4),
    "tolerances": solve.tolerances(mathieu, 1.0, {"delta": "±1 %"}, samples=64, index_samples=2, rtol=1e-4),
    "control": solve.control(manipulator, "50 rpm", {"q2": 1e8, "u": 1e-2}, rtol=1e-4),
    "lqr": solve.lqr(manipulator, "50 rpm", {"q2": 1e8}, {"u": 1e-2}, rtol=1e-4),
    "kalman": solve.kalman(manipulator, "50 rpm", {"u": 1.0}, {"q1": 1e-9}, rtol=1e-4),
    "lqg": solve.lqg(manipulator, "50 rpm", {"q2": 1e8}, {"u": 1e-2}, {"u": 1.0}, {"q1": 1e-9}, rtol=1e-4),
    "closed_loop": solve.floquet(
        solve.closed_loop(manipulator, solve.lqr(manipulator, "50 rpm", {"q2": 1e8}, {"u": 1e-2}, rtol=1e-4)),
        "50 rpm",
        rtol=1e-4,
    ),
    "sampled": solve.sampled(solve.OutputFeedback(manipulator, ["q1_dot"]), "50 rpm", 10),
    "stability_margin": solve.stability_margin(mathieu.varied({"zeta": 0.01}), 1.0, ["delta"]),
    "h2_norm": solve.h2_norm(manipulator, "50 rpm", ["q2"], rtol=1e-3),
    "hinf_norm": solve.hinf_norm(manipulator, "50 rpm", ["q2"], rtol=1e-2),
    "sensitivities": solve.sensitivities(cam, "600 rpm", "q1.max_abs", "k1", **rough),
    "validity": solve.validity(cam, "100 rpm", rtol=1e-2),
    "follow_modes": solve.follow_modes(mathieu, [1.0, 1.1], rtol=1e-4),
    "floquet": solve.floquet(mathieu, 1.0, **rough),
    "export": solve.export(cam, tempfile.mkdtemp() + "/cam.c"),
    "state_space": solve.state_space(cam, "600 rpm"),
    "harmonic_transfer": solve.harmonic_transfer(mathieu, 1.0),
    "sweep": solve.sweep(cam, [62.0, 63.0], **rough),
    "variants": (stiffer := solve.variants(cam, "k1", [8e4, 9e4])),
    "sweeps": solve.sweeps(stiffer, [62.0, 63.0], ["q1"], rtol=1e-2),
    "bands": solve.bands(mathieu, [0.8, 1.2], **rough, tolerance=1e-3),
    "sensitivities_over": solve.sensitivities_over(cam, [62.0, 63.0], "q1.max", "k1", rtol=1e-2),
    "speed_sensitivities": solve.speed_sensitivities(
        solve.bands(solve.load("mathieu", delta=1.0, epsilon=0.3), [0.8, 1.2]), "delta"
    ),
    "compare": solve.compare(mathieu, 1.0, ["gauss", "radau"], [64]),
    "chart": solve.chart(mathieu, {"delta": [0.5, 1.0]}, {"epsilon": [0.1, 0.2]}, **rough),
    "critical_speeds": solve.critical_speeds(cam, [60.0, 62.0, 64.0], **rough, tolerance=1e-2),
    "frequencies": solve.frequencies(cam),
    "prove": solve.prove(mathieu, 1.0),
    "report": solve.report(solve.load("portal_frame")),
    "animate": solve.animate(cam, "100 rpm", rtol=1e-2),
    "explore": solve.explore("mathieu").close(),
    "frequencies_over": solve.frequencies_over(cam, "k1", [8e4, 9e4], np.zeros(1)),
    "boundaries": solve.boundaries(at, [0.5, 1.0, 1.5]),
    "open": reopened(tempfile.mkdtemp()),
    "signal_statistics": solve.signal_statistics(np.cos, 2 * np.pi),
}
print(sorted(called))
"""
NONE_HIDDEN = """
import solve
assert all(inspect.isfunction(getattr(solve, name)) for name in %r)
assert not any(inspect.ismodule(getattr(solve, name)) for name in solve.__all__)
"""


def test_modules_and_public_names_do_not_collide():
    below = {name.split(".")[1] for name in MODULES}
    assert not below & set(solve.__all__)
    assert len(MODULES) > 80


def test_public_name_is_looked_up_only_once():
    assert vars(solve)["load"] is solve.load


@pytest.mark.parametrize(
    "called", [[2], pytest.param([0, 1, 2], marks=pytest.mark.slow)], ids=["one", "every"]
)
def test_public_functions_work_after_any_import_order(called):
    """A single process imports the modules in several orders. Other packages are imported only once."""
    lines = ["import importlib, inspect, sys"]
    for seed in called:
        order = random.Random(seed).sample(MODULES, len(MODULES))
        lines += ["for name in [name for name in sys.modules if name.split('.')[0] == 'solve']:"]
        lines += ["    del sys.modules[name]"]
        lines += [*(f"importlib.import_module({name!r})" for name in order), NONE_HIDDEN % FUNCTIONS]
        lines += [CALLS]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [str(FUNCTIONS)] * len(called)
