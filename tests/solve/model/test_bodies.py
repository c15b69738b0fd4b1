"""Elastic bodies from files: a beam from scikit-fem compared with its full matrices, and invalid files."""

import hashlib

import numpy as np
import pytest
import scipy.io
import scipy.linalg
import scipy.sparse
from scipy.optimize import brentq

import solve
from derive import Mechanism, rate
from derive.command import run as derive
from solve.errors import CaseFileError, MissingValueError, UnknownNameError
from tests.solve.model.cantilever import LENGTH, MASS, STIFFNESS, cantilever
from tests.solve.op4_files import binary, text

M, K, ROWS = cantilever()
TIP, SPRING, DEPTH, SPEED = 0.5, 900.0, 0.4, 21.0

MECHANISM = """
from derive import Mechanism, cos, rate


def mechanism():
    made = Mechanism("rig", "Beam with a mass on its tip, on a spring of periodic stiffness")
    y, slope = made.coordinates(y=("m", "tip"), slope=("rad", "tip"))
    m, k, e = made.parameters(m=("kg", "tip", ">= 0"), k=("N/m", "spring", ">= 0"), e=("1", "its variation"))
    beam = made.reduced_body("beam", {"tip": (y, "m"), "slope": (slope, "rad")}, modes=MODES, damping=DAMPING)
    made.kinetic = beam.kinetic + m * rate(y) ** 2 / 2
    made.potential = beam.potential + k * (1 + e * cos(made.phase)) * y**2 / 2
    made.dissipation = beam.dissipation
    return made
"""


def write_case(folder, entry, numbers=(TIP, SPRING, DEPTH)):
    values = zip(("m", "k", "e"), numbers, ("kg", "N/m", "1"), strict=True)
    rows = [
        f'{name} = {{ value = {value}, unit = "{unit}", source = "test" }}' for name, value, unit in values
    ]
    case = "\n".join(["[case.one]", "[case.one.parameters]", *rows, f"beam = {{ {entry} }}"])
    (folder / "rig.toml").write_text(case, encoding="utf-8")


def rig(folder, modes=3, damping=False):
    """Return the path of the mechanism after its derivation."""
    file = folder / "rig.py"
    file.write_text(MECHANISM.replace("MODES", str(modes)).replace("DAMPING", str(damping)), encoding="utf-8")
    assert derive([str(file)]) in (0, None)
    return str(file)


def body_entry(file, more="", unit="m kg s"):
    return f'file = "{file}", interface = {ROWS}, unit = "{unit}", source = "scikit-fem"{more}'


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Return models with 1, 3 and 5 modes from files with different units and formats."""
    models = {}
    for modes, ending in ((1, "mat"), (3, "npz"), (5, "mtx")):
        folder = tmp_path_factory.mktemp("rig")
        if ending == "mat":
            scipy.io.savemat(
                folder / "beam.mat", {"M": scipy.sparse.csc_matrix(M), "K": scipy.sparse.csc_matrix(K)}
            )
        elif ending == "npz":
            # Millimetres and tonnes: deflections in mm, slopes in rad, energies in N mm.
            scale = np.where(np.arange(len(M)) % 2 == (ROWS[0] - 1) % 2, 1e-3, 1.0)
            scaled = {"M": 1e3 * M * scale * scale[:, None], "K": 1e3 * K * scale * scale[:, None]}
            np.savez(folder / "beam.npz", **scaled)
        else:
            for name, matrix in (("M", M), ("K", K)):
                scipy.io.mmwrite(folder / f"beam.{name}.mtx", matrix, precision=17)
        write_case(folder, body_entry(f"beam.{ending}", unit="mm t s" if ending == "npz" else "m kg s"))
        models[modes] = solve.load(rig(folder, modes))
    return models


def test_frequencies_match_the_full_and_the_exact_beam(loaded):
    """Cantilever with a tip mass: 1 + cos β cosh β = μ β (sin β cosh β − cos β sinh β)."""
    mu = TIP / (MASS * LENGTH)

    def determinant(b):
        c, s, ch, sh = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        return 1 + c * ch - mu * b * (s * ch - c * sh)

    exact = [brentq(determinant, *interval) ** 2 for interval in ((0.5, 2), (3, 4.6))]
    exact = np.array(exact) * np.sqrt(STIFFNESS / MASS) / LENGTH**2
    errors = []
    for model in loaded.values():
        found = solve.frequencies(model.varied({"k": 0.0})).values[0][:2]
        errors.append(np.abs(found / exact - 1).max())
    assert errors[0] > 10 * errors[1] > 10 * errors[2]
    assert errors[2] < 1e-5


def test_periodic_solution_converges_to_that_of_all_coordinates(tmp_path):
    """A beam of four elements is solved with 1 and 4 modes and with its eight coordinates."""
    mass, stiffness, rows = cantilever(4)
    tip = np.zeros_like(mass)
    tip[rows[0] - 1, rows[0] - 1] = 1.0

    def matrices(phase, speed):
        one = np.ones((len(phase), 1, 1))
        spring = (SPRING * (1 + DEPTH * np.cos(phase)))[:, None, None]
        return one * (mass + TIP * tip), 0 * one * mass, stiffness + spring * tip, np.zeros((len(phase), 8))

    def lowest(system):
        return np.sort([mode.unfolded for mode in solve.floquet(system, SPEED).modes])[:2]

    truth = lowest(solve.PeriodicSystem(matrices, [f"w{k}" for k in range(8)]))
    np.savez(tmp_path / "beam.npz", M=mass, K=stiffness)
    write_case(tmp_path, body_entry("beam.npz").replace(str(ROWS), str(rows)))
    errors = [np.abs(lowest(solve.load(rig(tmp_path, modes))) / truth - 1).max() for modes in (1, 4)]
    assert 1e-6 < errors[0] < 1e-2
    assert errors[1] < 1e-5


def test_source_reports_hash_and_discarded_modes(loaded, tmp_path):
    source = loaded[1].setup.case.sources["beam_K3_3"]
    assert source.startswith("scikit-fem; beam.mat, SHA-256 ")
    squares = scipy.linalg.eigh(
        *(np.delete(np.delete(each, np.array(ROWS) - 1, 0), np.array(ROWS) - 1, 1) for each in (K, M)),
        eigvals_only=True,
    )
    assert source.endswith(f"modes of {np.sqrt(squares[1]):.4g} rad/s and above discarded")
    assert loaded[1].parameters["beam_K3_3"] == pytest.approx(squares[0], rel=1e-8)


@pytest.mark.slow
def test_damping_matrix_is_reduced_with_mass_and_stiffness(tmp_path):
    """C = a M + b K damps a mode of frequency ω with the ratio (a/ω + bω)/2."""
    a, b = 0.3, 2e-4
    np.savez(tmp_path / "beam.npz", M=M, K=K, C=a * M + b * K)
    write_case(tmp_path, body_entry("beam.npz"), (0.0, 0.0, 0.0))
    model = solve.load(rig(tmp_path, 3, damping=True))
    followed = solve.follow_modes(model, [SPEED, 1.01 * SPEED])
    exponents = followed.exponents[0]
    omega = np.abs(exponents)
    first = omega.argmin()
    assert followed.damping[0, first] == pytest.approx((a / omega[first] + b * omega[first]) / 2, rel=1e-6)


def test_reduced_matrices_are_reproduced(tmp_path):
    """The matrices of three modes are reduced again to three modes."""
    from solve.model.craig_bampton import craig_bampton

    reduced = craig_bampton(M, K, np.array(ROWS) - 1, 3)
    np.savez(tmp_path / "beam.npz", M=reduced.mass, K=reduced.stiffness)
    write_case(tmp_path, 'file = "beam.npz", unit = "m kg s", source = "reduced"')
    model = solve.load(rig(tmp_path, 3))
    np.testing.assert_allclose(
        np.abs(model.at(np.zeros(1), 1.0)[0][0][:2, 2:]), np.abs(reduced.mass[:2, 2:]), rtol=1e-7
    )
    assert "no modes discarded" in model.setup.case.sources["beam_M1_1"]


def test_incorrect_hash_is_refused(tmp_path):
    np.savez(tmp_path / "beam.npz", M=M, K=K)
    digest = hashlib.sha256((tmp_path / "beam.npz").read_bytes()).hexdigest()
    file = rig(tmp_path)
    write_case(tmp_path, body_entry("beam.npz", f', sha256 = "{digest[:16]}"'))
    assert solve.load(file).n == 5
    write_case(tmp_path, body_entry("beam.npz", f', sha256 = "{"0" * 16}"'))
    with pytest.raises(CaseFileError, match=f"is {digest}, but the case states '0000"):
        solve.load(file)


@pytest.mark.parametrize("content", [binary, text])
def test_nastran_matrices_give_the_same_body(shared_rig, content):
    folder, file = shared_rig
    np.savez(folder / "beam.npz", M=M, K=K)
    write_case(folder, body_entry("beam.npz"))
    expected = solve.load(file).parameters
    made = content({"KAA": K, "MAA": M}, "sparse")
    (folder / "beam.op4").write_bytes(made if isinstance(made, bytes) else made.encode())
    write_case(folder, body_entry("beam.op4"))
    found = solve.load(file)
    assert found.parameters == pytest.approx(expected, rel=1e-9)
    assert "beam.op4, SHA-256" in found.setup.case.sources["beam_M1_1"]


ASYMMETRIC = K + np.triu(K)
BAD = {
    "missing": ({}, "there is no file"),
    "no K": ({"M": M}, "has no K"),
    "asymmetric": ({"M": M, "K": ASYMMETRIC}, "K is not symmetric"),
    "other size": ({"M": M[1:, 1:], "K": K}, "M has shape"),
    "NaN": ({"M": M * np.nan, "K": K}, "finite real"),
    "words": ({"M": M, "K": np.array(["a"])}, "finite real"),
    "free": ({"M": M, "K": np.zeros_like(K)}, "rigid-body mode"),
    "few": ({"M": M[:3, :3], "K": K[:3, :3]}, "allowed"),
}


@pytest.mark.parametrize(("arrays", "expected"), BAD.values(), ids=BAD)
def test_invalid_files_are_refused_in_one_line(shared_rig, arrays, expected):
    folder, file = shared_rig
    (folder / "beam.npz").unlink(missing_ok=True)
    if arrays:
        np.savez(folder / "beam.npz", **arrays)
    write_case(folder, body_entry("beam.npz").replace(str(ROWS), "[1, 2]"))
    with pytest.raises(CaseFileError, match=r"beam in rig\.toml") as refused:
        solve.load(file)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def shared_rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bad")
    return folder, rig(folder)


BAD_ENTRIES = {
    "unit": (body_entry("beam.npz", unit="mm"), CaseFileError, '"mm t s"'),
    "dimension": (body_entry("beam.npz", unit="kg m s"), CaseFileError, "kg"),
    "rows": (body_entry("beam.npz").replace(str(ROWS), "[1]"), CaseFileError, "give 2 row numbers"),
    "range": (body_entry("beam.npz").replace(str(ROWS), "[0, 1]"), CaseFileError, "from 1 to 24"),
    "twice": (body_entry("beam.npz").replace(str(ROWS), "[1, 1]"), CaseFileError, "different"),
    "ending": (body_entry("beam.op2"), CaseFileError, "allowed: .mat"),
    "source": ('file = "beam.npz", unit = "m kg s"', CaseFileError, "requires a file"),
    "key": (body_entry("beam.npz", ", modes = 3"), UnknownNameError, "modes"),
}


@pytest.mark.parametrize(("entry", "kind", "expected"), BAD_ENTRIES.values(), ids=BAD_ENTRIES)
def test_invalid_entries_are_refused_in_one_line(shared_rig, entry, kind, expected):
    folder, file = shared_rig
    np.savez(folder / "beam.npz", M=M, K=K)
    write_case(folder, entry)
    with pytest.raises(kind) as refused:
        solve.load(file)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


def test_file_for_an_undeclared_body_is_refused(shared_rig):
    folder, file = shared_rig
    write_case(folder, body_entry("beam.npz"))
    case = (folder / "rig.toml").read_text("utf-8").replace("beam =", "plate =")
    (folder / "rig.toml").write_text(case, encoding="utf-8")
    with pytest.raises(UnknownNameError, match="plate"):
        solve.load(file)
    with pytest.raises(MissingValueError, match="beam_M1_1"):
        solve.load(lambda: statement("beam"), m=1.0)


def statement(name, interface=None, modes=2):
    made = Mechanism("rig", "Beam")
    y = made.coordinate("y", "m", "tip")
    m = made.parameter("m", "kg", "tip", ">= 0")
    body = made.reduced_body(name, interface or {"tip": (y, "m")}, modes)
    made.kinetic, made.potential = body.kinetic + m * rate(y) ** 2 / 2, body.potential
    return made
