"""Errors of the command, each with a message of one line: arguments, mechanism files, case files."""

from pathlib import Path

import pytest

ROTOR = (Path(__file__).parent / "rotor.py").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "rotor.toml cannot be read as a case file: no such file or directory"),
        ("[case", "rotor.toml cannot be read as a case file: Expected ']'"),
        ("x = 1", "rotor.toml cannot be read as a case file: it has no 'case'"),
        ("[case.b]", 'rotor.toml has no case "a"; it has: b'),
        (
            "[case.a.parameters]\nI = {value = 1, unit = 'm'}",
            "I = 1 is not the number of a parameter of",
        ),
        (
            "[case.a.parameters]\nJ = {value = 'x', unit = 'kg m^2'}",
            "J = 'x' is not the number of",
        ),
        ("[case.a.parameters]\nJ = 3", "J is 3; give a table with value or values, and unit"),
        ("[case.a.parameters]\nJ = {value = 1, unit = 'm'}", 'J is in "m"; it must be in "kg m^2"'),
        ("[case.a.parameters]\nJ = {value = 1, unit = 'ells'}", 'the unit "ells" is not understood'),
    ],
)
def test_case_files_without_numbers_for_the_equations(derive, rotor, content, message):
    if content is not None:
        rotor.with_suffix(".toml").write_text(content, encoding="utf-8")
    status, out, err = derive("--show", "--numbers", "a", rotor)
    assert (status, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give one or more mechanisms, or --all (known: "),
        (["cam", "--all"], "give one or more mechanisms, or --all"),
        (["kam"], 'there is no mechanism "kam"; did you mean "cam"? (known: '),
        (["xyzzy"], 'there is no mechanism "xyzzy" (known: '),
        (["models/cam"], '"models/cam" is neither a name nor a file: a path must end in .py'),
        (["..\\cam"], "a path must end in .py"),
        (["nowhere/cam.py"], "there is no file nowhere/cam.py"),
        (["x" * 300 + ".py"], "there is no file xxx"),
        (["cam", "--full"], "--full requires --check"),
        (["cam", "--check", "--show"], "--show cannot be combined with --check or --full"),
        (["cam", "--numbers", "1"], "--numbers requires --show"),
        (["cam", "--frobnicate"], "No such option: --frobnicate"),
        (["cam", "--out"], "--out"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(derive, arguments, message):
    status, out, err = derive(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith("derive: ")
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "has no function mechanism(); it must return a derive.Mechanism"),
        ("mechanism = 3\n", "has no function mechanism()"),
        ("def mechanism():\n    return 3\n", "returns int; it must return a derive.Mechanism"),
        ("def mechanism():\n    return None\n", "returns NoneType"),
        ("def mechanism():\n\n    return 1 / 0\n", ", line 3: ZeroDivisionError: division by zero"),
        ("def mechanism(:\n", ", line 1: SyntaxError: "),
        ("import nothing_of_that_name\n", ", line 1: ModuleNotFoundError: No module named"),
        ("raise ValueError('two\\nlines')\n", "ValueError: two lines"),
        ("raise SystemExit(0)\n", ", line 1: SystemExit: 0"),
        ("def mechanism():\n    raise GeneratorExit\n", ", line 2: GeneratorExit"),
        ("class Own(BaseException): ...\nraise Own('stop')\n", ", line 2: Own: stop"),
        ("class Own(KeyboardInterrupt): ...\nraise Own('stop')\n", ", line 2: Own: stop"),
        ("def mechanism():\n    return mechanism()\n", "RecursionError: maximum recursion depth exceeded"),
        (ROTOR.replace("kg m^2", "kg m^99999999"), '"kg m^99999999" is not understood: powers are numbers'),
        ("from derive import nothing\n", "ImportError: cannot import name 'nothing'"),
        (
            ROTOR.replace('"rotor", "Rotor', '"other", "Rotor'),
            'states a mechanism "other"; it must be called "rotor"',
        ),
        (ROTOR.replace("J * rate", "k * rate"), "rotor.py, line 10: kinetic energy must be in "),
        (ROTOR.replace("kg m^2", "kg mq^2"), 'rotor.py, line 9: the unit "kg mq^2" is not understood'),
        (
            ROTOR.replace("rotor.potential", "rotor.potentail"),
            ", line 11: AttributeError: 'Mechanism' object has no attribute 'potentail'",
        ),
    ],
)
def test_invalid_mechanism_files_are_refused_in_one_line(derive, rotor, text, message):
    rotor.write_text(text, encoding="utf-8")
    status, out, err = derive(rotor)
    assert (status, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not (rotor.parent / "generated").exists()


LATE = """
from sympy import Symbol

from derive import *


def mechanism():
    one = Mechanism("rotor", "One mass")
    q = one.coordinate("q", "m", "deflection")
    m, k = one.parameters(m=("kg", "mass", "> 0"), k=("N/m", "spring"))
    c, F = one.parameters(c=("N s/m", "damper"), F=("N", "load"))
    one.kinetic = m * rate(q) ** 2 / 2
    one.potential = k * q**2 / 2
    one.dissipation = c * rate(q) ** 2 / 2
    one.force(F, along=q)
    {fault}
    one.trust(q=1)
    return one
"""


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("one.potential += c * q**2", "they cannot be added"),
        ("one.potential += k * q * Symbol('x')", "x, which is not declared; declare it with"),
        ("one.potential += k * q * Symbol('kk')", "kk, which is not declared; did you mean k?"),
        ("one.potential += c * q * rate(q)", "is not allowed there; remove "),
        ("one.potential += k * q**2 / (m - m)", "not finite: "),
        (
            "one.potential += Piecewise((k * q**2, one.phase < pi))",
            "add a last piece with the condition True",
        ),
        ("one.kinetic += m * rectangle(one.phase, 0, 1) * rate(q) ** 2", "is an impulse there"),
        ("one.kinetic += m * rate(q) * rate(rectangle(one.phase, 0, pi))", "is an impulse there"),
        ("one.force(-F * sign(rate(q)), along=q)", "smooth it by a velocity v0, a parameter"),
        ("one.force(-F * sign(q), along=q)", "give it a clearance or a preload, or smooth it"),
        ("one.potential += F * Abs(q)", "give it a clearance or a preload, or smooth it"),
        ("one.force(F * Heaviside(sin(one.phase + q * k / F)), along=q)", "give it a clearance"),
        ("one.force(F * Heaviside(sin(one.phase) + sin(one.phase * 3)), along=q)", "phases where"),
        ("one.force(k, along=q)", "virtual work of k along q must be in"),
        ("one.force(F, along=rate(q))", "virtual work of F along qd must be in"),
        ("one.parameter('unused', 'N', 'load')", "is not used; use it or remove it"),
        ("one.output('speed_', q, 'm/s', 'its speed')", "output speed_ must be in"),
        (
            "one.kinetic = m * one.speed**2 * q**2",
            "M is singular: a motion of q has no kinetic energy; add a mass",
        ),
        ("one.damping_ratio = c", "damping ratio must be in"),
        ("rate(one.coordinates(y=('m', 'other')))", "write coordinate(...), or (q,) = coordinates(...)"),
    ],
)
def test_errors_during_derivation_state_the_line(derive, rotor, fault, message):
    rotor.write_text(LATE.format(fault=fault), "utf-8")
    status, out, err = derive(rotor)
    assert (status, out) == (2, "")
    line = rotor.read_text("utf-8").splitlines().index(f"    {fault}") + 1
    assert err.startswith(f"derive: {rotor}, line {line}: ")
    assert message in err
    assert err.count("\n") == 1


def test_more_damping_ratios_than_modes_are_refused(derive, rotor):
    rotor.write_text(ROTOR.replace("    return", "    rotor.damping_ratio = 0.1, 0.2\n    return"), "utf-8")
    status, _, err = derive(rotor)
    assert status == 2
    assert "2 damping ratios for 1 coordinate; give at most one per mode" in err


@pytest.mark.parametrize("name", ["math", "casadi", "class", "__init__", "solve", "random"])
def test_names_that_would_shadow_a_module_are_refused(derive, tmp_path, name):
    path = tmp_path / f"{name}.py"
    path.write_text(ROTOR.replace('"rotor", "Rotor', f'"{name}", "Rotor'), encoding="utf-8")
    status, out, err = derive(path)
    assert (status, out) == (2, "")
    assert f'a mechanism cannot be called "{name}"' in err
    assert err.count("\n") == 1
    assert not (tmp_path / "generated").exists()


def test_binary_file_is_refused(derive, rotor):
    rotor.write_bytes(b"\xff\xfe\x00")
    status, _, err = derive(rotor)
    assert status == 2
    assert "cannot be read" in err
