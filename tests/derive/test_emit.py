"""Generated modules: required contents, reproducible text, and operation counts."""

import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import casadi
import numpy as np
import pytest
from modules import module_in, module_of, values

from derive import Mechanism, cos, loader, rate, rectangle
from derive.errors import UnitError
from derive.freshness import derive_sha256, sha256

ROOT = Path(__file__).resolve().parents[2]
BASELINE = Path(__file__).with_name("operations.toml")
NAMES = loader.names()
STATE = ["phase", "speed", "q", "qd", "qdd", "p"]


def generated(name: str) -> ModuleType:
    return module_in(ROOT / "generated" / f"{name}.py")


MODELS = [name for name in NAMES if name != loader.BEAM_ELEMENTS]
EQUATIONS = [name for name in MODELS if hasattr(generated(name), "linearised")]


def choices(module: ModuleType) -> list[dict[str, str]]:
    """Option values, one dict per allowed value, with default values of the other options."""
    return [{}] + [{name: value} for name, values, _ in module.OPTIONS for value in values]


@pytest.mark.parametrize("name", NAMES)
def test_every_generated_module_has_a_valid_hash(name):
    module = generated(name)
    text = (ROOT / "generated" / f"{name}.py").read_text(encoding="utf-8")
    assert derive_sha256() == module.DERIVE_SHA256
    assert loader.find(name).sha256 == module.MECHANISM_SHA256
    assert sha256("".join(text.split(f'FILE_SHA256 = "{module.FILE_SHA256}"\n'))) == module.FILE_SHA256
    assert f"Renew with: python -m derive {name}\n" in module.__doc__


@pytest.mark.parametrize("name", MODELS)
def test_every_generated_model_has_the_required_contents(name):
    module = generated(name)
    assert name == module.NAME
    assert module.TITLE in module.__doc__
    assert all(len(row) == 3 and all(row) for row in (*module.COORDINATES, *module.OUTPUTS))
    assert all(len(row) == 4 and all(row[:3]) for row in module.PARAMETERS)
    assert set(module.VALIDITY) <= {row[0] for row in module.COORDINATES}
    assert {row[0] for row in module.LIMITS} <= {row[0] for row in module.OUTPUTS}
    assert all(default in values for _, values, default in module.OPTIONS)
    assert 0 < module.PERIOD <= 2 * math.pi
    expected = ["linearised", "residual", "outputs"] if name in EQUATIONS else ["properties"]
    assert list(module.OPERATIONS) == expected


@pytest.mark.parametrize("name", EQUATIONS)
def test_every_generated_function_has_named_inputs_and_outputs(name):
    module = generated(name)
    for options in choices(module):
        linearised, residual = module.linearised(**options), module.residual(**options)
        outputs = module.outputs(**options)
        n, count = linearised.size1_out("d"), len(module.PARAMETERS)
        assert (linearised.name_in(), linearised.name_out()) == (
            ["phase", "speed", "p"],
            ["M", "C", "K", "d"],
        )
        assert (residual.name_in(), residual.name_out()) == (STATE, ["r"])
        assert outputs.name_in() == STATE
        for constant in (residual, outputs):
            varying = getattr(module, f"{constant.name()}_varying")(**options)
            assert varying.name_in() == [*STATE[:2], "acceleration", *STATE[2:]]
            assert varying.name_out() == constant.name_out()
        assert outputs.name_out() == [row[0] for row in module.OUTPUTS]
        assert [linearised.size_out(i) for i in range(4)] == [(n, n)] * 3 + [(n, 1)]
        assert linearised.size1_in("p") == residual.size1_in("p") == outputs.size1_in("p") == count
        assert all(linearised.sparsity_out(i).is_dense() for i in range(4))
        assert residual.size_out("r") == (n, 1)
        assert all(outputs.size_out(i) == (1, 1) for i in range(outputs.n_out()))


def test_option_value_that_is_not_allowed_raises_an_error():
    with pytest.raises(ValueError, match="option load is 'heavy'; allowed: tracking, constant"):
        generated("gear_pair").linearised(load="heavy")


@pytest.mark.slow
def test_generated_text_does_not_depend_on_the_hash_seed(tmp_path):
    runs = [
        subprocess.Popen(
            [sys.executable, "-m", "derive", *NAMES, "--out", str(tmp_path / str(seed))],
            cwd=ROOT,
            env=os.environ | {"PYTHONHASHSEED": str(seed)},
            stderr=subprocess.PIPE,
            text=True,
        )
        for seed in range(2)
    ]
    for seed, run in enumerate(runs):
        _, err = run.communicate()
        assert run.returncode == 0, err
        for name in NAMES:
            made, committed = tmp_path / str(seed) / f"{name}.py", ROOT / "generated" / f"{name}.py"
            assert made.read_bytes() == committed.read_bytes(), f"{name}, hash seed {seed}"


@pytest.mark.parametrize("name", MODELS)
def test_operation_counts_do_not_grow(name):
    allowed = tomllib.loads(BASELINE.read_text(encoding="utf-8"))
    counted = generated(name).OPERATIONS
    line = f"{name} = {{ {', '.join(f'{key} = {value}' for key, value in counted.items())} }}"
    remedy = f"if the growth is meant, put this line into {BASELINE.relative_to(ROOT)}: {line}"
    assert name in allowed, remedy
    assert all(counted[key] <= allowed[name][key] for key in counted), remedy


def test_names_in_generated_code_do_not_collide():
    """Parameters have the names of temporary variables in generated code, and a coordinate has the name of
    the vector."""
    odd = Mechanism("odd", 'Odd "names" \\ in a title')
    (q,) = odd.coordinates(q=("rad", "twist"))
    p, x0, U_1, r, zip_ = odd.parameters(
        p=("kg m^2", "inertia", "> 0"),
        x0=("N m/rad", "stiffness"),
        U_1=("kg", "mass"),
        r=("1", "factor"),
        zip=("1", "factor"),
    )
    U = odd.transmission("U", harmonics=1, unit="m")
    odd.kinetic = (p * rate(odd.phase + q) ** 2 + U_1 * rate(U(odd.phase + q)) ** 2) * r * zip_ / 2
    odd.potential = x0 * q**2 * r * zip_ / 2
    module = module_of(odd)
    values = [2.0, 5.0, 3.0, 1.5, 2.0, 0.4, 0.0]
    M, _, K, _ = module.linearised()(0.0, 1.0, values)
    assert float(M) == pytest.approx((2.0 + 3.0 * 0.4**2) * 3)
    assert float(K) == pytest.approx((5.0 - 3.0 * 0.4**2) * 3)
    assert module.__doc__.startswith('Odd "names" \\ in a title.')


def test_mechanism_without_parameters_or_excitation():
    bare = Mechanism("bare", "Equation without units", energy="1/s^2")
    (q,) = bare.coordinates(q=("1", "number"))
    bare.kinetic = rate(q) ** 2 / 2
    bare.decline_drive_torque("it has no units")
    module = module_of(bare)
    M, C, K, d = module.linearised()(0.0, 1.0, casadi.DM.zeros(0, 1))
    assert [float(each) for each in (M, C, K, d)] == [1, 0, 0, 0]
    assert module.OUTPUTS == ()
    assert module.outputs().n_out() == 0
    assert module.NO_DRIVE_TORQUE == "it has no units"


def shaken(length: str, stiffness: str, angle: str, force: str) -> Mechanism:
    """Mass on a spring with base excitation and a step in its load, in units of any size."""
    one = Mechanism("shaken", "A mass on a shaken spring")
    q = one.coordinate("q", "m", "deflection")
    r, m = one.parameter("r", length, "amplitude"), one.parameter("m", "kg", "mass", "> 0")
    k, a = one.parameter("k", stiffness, "spring"), one.parameter("a", angle, "where the load ends")
    one.kinetic = m * rate(q) ** 2 / 2
    one.potential = k * (q - r * cos(one.phase)) ** 2 / 2
    one.force(k * r * rectangle(one.phase, 0, a), along=q)
    one.output("spring_force", k * (q - r * cos(one.phase)), force, "force in the spring")
    return one


def test_parameters_and_outputs_in_units_of_other_sizes():
    si = module_of(shaken("m", "N/m", "rad", "N"))
    other = module_of(shaken("mm", "kN/mm", "deg", "kN"))
    numbers, given = [0.03, 2.0, 5e6, math.radians(70)], [30.0, 2.0, 5.0, 70.0]
    for phase in (0.4, 1.2, 1.3):
        for theirs, ours in zip(
            values(si.linearised(), phase, 3.0, numbers),
            values(other.linearised(), phase, 3.0, given),
            strict=True,
        ):
            np.testing.assert_allclose(ours, theirs, rtol=1e-14)
        states = [0.01, 0.2, 0.5]
        (residual,), (same,) = (
            values(module.residual(), phase, 3.0, *states, p) for module, p in ((si, numbers), (other, given))
        )
        np.testing.assert_allclose(same, residual, rtol=1e-13)
        force, in_kN = (
            values(module.outputs(), phase, 3.0, *states, p)[-1]
            for module, p in ((si, numbers), (other, given))
        )
        np.testing.assert_allclose(1e3 * in_kN, force, rtol=1e-13)
    assert sorted(other.breaks(3.0, given)) == pytest.approx(sorted(si.breaks(3.0, numbers)), rel=1e-15)
    assert [unit for _, unit, *_ in other.PARAMETERS] == ["mm", "kg", "kN/mm", "deg"]


@pytest.mark.parametrize("unit", ["mm", "deg"])
def test_coordinates_must_be_in_si_units(unit):
    with pytest.raises(UnitError, match=rf'q is in "{unit}", which is 0.0.* times the SI unit'):
        Mechanism("one", "One").coordinate("q", unit, "deflection")
