"""Exported C code of the equations: compiled, called and compared with the matrices and the residual in
Python."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

import solve
from solve.errors import FileError, LinearModelError, NoMotionError

COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")


@pytest.fixture
def library(tmp_path):
    """Return a function that compiles a model to a C library with -Wall -Werror."""

    def compiled(model):
        file = tmp_path / f"{model.labels.name}.c"
        solve.export(model, file)
        flags = ["-shared", "-fPIC", "-std=c99", "-Wall", "-Werror", "-o", str(file.with_suffix(".so"))]
        subprocess.run([COMPILER, *flags, str(file), "-lm"], check=True)
        return ctypes.CDLL(str(file.with_suffix(".so")))

    return compiled


def called(function, results, *inputs):
    """Call a C function with numbers and arrays; return its results, which have the sizes `results`."""
    computed = [np.full(size, np.nan) for size in results]
    doubles = ctypes.POINTER(ctypes.c_double)
    given = [
        ctypes.c_double(each) if isinstance(each, float) else each.ctypes.data_as(doubles)
        for each in (*inputs, *computed)
    ]
    assert function(*given) == 0
    return computed


@needs_compiler
@pytest.mark.parametrize("name", ["cam", "coupler", "meissner"])
def test_linearised_c_code_matches_python(library, name):
    model, speed = solve.load(name), 40.0
    n, p = model.n, np.array(list(model.parameters.values()))
    function = library(model)[f"{name}_linearised"]
    for phase in (0.3, 2.0, 5.5):
        computed = called(function, (n * n, n * n, n * n, n), phase, speed, p)
        for part, expected in zip(computed, model.at(np.array([phase]), speed), strict=True):
            np.testing.assert_allclose(part, expected.ravel(), rtol=1e-12, atol=1e-9 * np.abs(expected).max())


@needs_compiler
def test_parameters_other_than_those_of_the_case_are_used(library):
    computed = library(solve.load("cam"))
    stiffer = solve.load("cam", k1=1.3e5, m2=11.0)
    p = np.array(list(stiffer.parameters.values()))
    M, _, K, _ = called(computed.cam_linearised, (9, 9, 9, 3), 1.0, 30.0, p)
    expected = stiffer.at(np.array([1.0]), 30.0)
    np.testing.assert_allclose(M, expected[0].ravel(), rtol=1e-13)
    np.testing.assert_allclose(K, expected[2].ravel(), rtol=1e-13)


@needs_compiler
def test_residual_vanishes_on_the_nonlinear_orbit(library):
    model, speed = solve.load("cam"), 30.0
    computed, p = library(model), np.array(list(model.parameters.values()))
    orbit = solve.nonlinear(model, speed)
    q, qd, qdd = (np.ascontiguousarray(part[:, 0]) for part in orbit.state(np.array([1.2])))
    (r,) = called(computed.cam_residual, (3,), 1.2, speed, q, qd, qdd, p)
    (pushed,) = called(computed.cam_residual, (3,), 1.2, speed, q + 1e-3, qd, qdd, p)
    assert np.abs(r).max() < 1e-6 * np.abs(pushed).max()
    (y,) = called(computed.cam_outputs, (len(model.outputs),), 1.2, speed, q, qd, qdd, p)
    assert y == pytest.approx([orbit.signal(name)(np.array([1.2]))[0] for name in model.outputs], rel=1e-12)


@needs_compiler
def test_library_contains_the_values_of_the_case(library):
    model = solve.load("cam", k1="90 kN m/rad")
    values = (ctypes.c_double * len(model.parameters)).in_dll(library(model), "cam_parameters")
    assert dict(zip(model.parameters, values, strict=True)) == model.parameters
    assert model.parameters["k1"] == 9e4


@needs_compiler
def test_two_models_can_be_linked_together(tmp_path):
    for name in ("cam", "mathieu"):
        solve.export(solve.load(name), tmp_path / f"{name}.c")
    files = [str(tmp_path / f"{name}.c") for name in ("cam", "mathieu")]
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", str(tmp_path / "both.so"), *files, "-lm"], check=True)


def test_header_lists_parameters_with_unit_and_meaning(tmp_path):
    model = solve.load("coupler", options={"modes": 2})
    exported = solve.export(model, tmp_path / "coupler.c")
    assert [file.name for file in exported.files] == ["coupler.c", "coupler.h"]
    header = (tmp_path / "coupler.h").read_text("utf-8")
    for at, (name, (unit, meaning)) in enumerate(model.labels.parameter_labels.items()):
        assert f"   p[{at}]  {name} ({unit}): {meaning}\n" in header
    assert "modes=2" in header
    assert "#define COUPLER_COORDINATES 2\n" in header


def test_c_export_refuses_models_without_formulas(tmp_path):
    def oscillator(phase, speed):
        one = np.ones((len(phase), 1, 1))
        return one, 0.1 * one, 4.0 * one, np.cos(phase)[:, None]

    along = solve.nonlinear(solve.load("manipulator"), "50 rpm").system
    for given in (solve.load("four_bar"), solve.PeriodicSystem(oscillator, ["q"]), along):
        with pytest.raises(LinearModelError, match=r"export these to a \.mat file"):
            solve.export(given, tmp_path / "a.c")
    with pytest.raises(NoMotionError):
        solve.export(solve.load("portal_frame"), tmp_path / "a.c")
    with pytest.raises(FileError, match="quotes"):
        solve.export(solve.load("mathieu"), tmp_path / 'a"b.c')
    assert list(tmp_path.iterdir()) == []


def test_failed_header_leaves_no_source_file(tmp_path):
    (tmp_path / "mathieu.h").mkdir()
    with pytest.raises(FileError, match="is a folder"):
        solve.export(solve.load("mathieu"), tmp_path / "mathieu.c")
    assert [path.name for path in tmp_path.iterdir()] == ["mathieu.h"]
