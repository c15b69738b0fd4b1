"""OUTPUT4 files of NASTRAN: all formats are read, and malformed files are refused."""

import numpy as np
import pytest

import solve
from solve.array_files import named_arrays
from solve.errors import FileError
from solve.op4 import op4_arrays
from tests.solve.op4_files import binary, text

RNG = np.random.default_rng(4)
GAPS = RNG.standard_normal((7, 5))
GAPS[[0, 3, 6], :] = GAPS[:, 2] = 0
MATRICES = {
    "GAPS": GAPS,
    "ZERO": np.zeros((3, 3)),
    "KAA": np.diag([4.0, 9.0]),
    "SINGLE": RNG.standard_normal((3, 2)).astype(np.float32),
    "WAVES": RNG.standard_normal((4, 2)) + 1j * RNG.standard_normal((4, 2)),
}
LAYOUTS = "dense", "sparse", "bigmat"


def read(folder, content):
    file = folder / "made.op4"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return op4_arrays(file)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("form", ["text", "little", "big", "64 bits"])
def test_matrices_are_read_back_unchanged(tmp_path, layout, form):
    order, size = (">", 4) if form == "big" else ("<", 8 if form == "64 bits" else 4)
    content = text(MATRICES, layout) if form == "text" else binary(MATRICES, layout, order, size)
    found = read(tmp_path, content)
    assert list(found) == list(MATRICES)
    for name, matrix in MATRICES.items():
        np.testing.assert_array_equal(found[name], matrix)


def test_lines_printed_in_the_manual_are_read(tmp_path):
    """The example has two rows of ones after a zero, in fields of eight characters. Its exponents may have
    the letter D."""
    lines = [
        f"{1:8}{4:8}{2:8}{2:8}{'LOAD':8}1P,5E16.9",
        f"{1:8}{2:8}{3:8}",
        " 1.000000000D+00-2.500000000D-01 3.000000000D+02",
        f"{2:8}{1:8}{1:8}",
        " 1.000000000D+00",
    ]
    np.testing.assert_array_equal(read(tmp_path, "\n".join(lines))["LOAD"], [[0.0], [1.0], [-0.25], [300.0]])


def test_mass_stiffness_and_damping_of_one_set_are_recognised(tmp_path):
    """Superelements also contain placeholders of other sets."""
    two, one = np.eye(2), np.zeros((1, 1))
    content = {"KAA": 4 * two, "MAA": two, "BAA": 0.1 * two, "K4XX": one, "BXX": one, "KASMX": one}
    (tmp_path / "frame.op4").write_text(text(content))
    found = named_arrays(tmp_path / "frame.op4")
    assert sorted(found) == ["C", "K", "M"]
    system = solve.read_op4(tmp_path / "frame.op4", "300 rpm")
    np.testing.assert_allclose(solve.frequencies(system).values[0], [2.0, 2.0])
    rho = np.exp(2 * np.pi * (-0.05 + 1j * np.sqrt(4 - 0.05**2)) / (10 * np.pi))
    assert abs(solve.floquet(system, "300 rpm").multipliers - rho).min() < 1e-9
    (tmp_path / "both.op4").write_text(text(content | {"KGG": two, "MGG": two}))
    with pytest.raises(FileError, match=r"both\.op4': it contains matrices of several sets, KAA, KGG"):
        solve.read_op4(tmp_path / "both.op4")


GOOD, GOOD_BINARY = text({"KAA": np.eye(3)}), binary({"KAA": np.eye(3)})
BAD = {
    "empty": ("", "damaged"),
    "another format": ("not a file of NASTRAN\n" * 3, "damaged"),
    "ends early": (GOOD[:150], "damaged"),
    "row outside": (GOOD.replace(f"{2:8}{2:8}{1:8}", f"{2:8}{9:8}{1:8}"), "damaged"),
    "string without end": (
        text({"KAA": np.eye(3)}, "sparse").replace(f"{3 * 65536 + 2:8}", f"{2:8}"),
        "damaged",
    ),
    "binary ends early": (GOOD_BINARY[:60], "damaged"),
    "binary with wrong lengths": (GOOD_BINARY[:28] + b"\1" + GOOD_BINARY[29:], "damaged"),
    "diagonal form": (GOOD.replace(f"{6:8}{2:8}", f"{3:8}{2:8}"), "allowed: types 1 to 4, forms 1, 2 and 6"),
    "too large": (GOOD.replace(f"{3:8}{3:8}{6:8}", f"{9000:8}{9000:8}{6:8}"), "allowed: up to 5000"),
    "two matrices of one name": (GOOD + GOOD, "it contains two matrices KAA"),
    "two binary matrices of one name": (GOOD_BINARY * 2, "it contains two matrices KAA"),
    "complex": (text({"KAA": 1j * np.eye(2), "MAA": np.eye(2)}), "expected real numbers"),
}


@pytest.mark.parametrize(("content", "expected"), BAD.values(), ids=BAD)
def test_malformed_files_are_refused_in_one_line(tmp_path, content, expected):
    file = tmp_path / "bad.op4"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(FileError, match=r"bad\.op4") as refused:
        solve.read_op4(file)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)
