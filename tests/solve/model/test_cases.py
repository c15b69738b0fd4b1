"""Case files: their content, and all invalid forms."""

from types import SimpleNamespace

import pytest

import solve
from solve.errors import CaseFileError, MissingValueError, UnitError, UnknownNameError
from solve.model.cases import Case, chosen_case, read_cases

UNITS = {"k1": "N/m", "a1": "m", "a2": "m", "a3": "m", "m": "kg"}
GOOD = """
[common.parameters]
m = { value = 2, unit = "kg", source = "Table 1" }
a = { values = [1, 2.5, 0], unit = "mm", source = "Table 2" }

[case.slow]
title = "below the first resonance"
speed = "60 rpm"
[case.slow.parameters]
k1 = { value = 3, unit = "kN/m", source = "measured" }

[case.light.parameters]
m = { value = 500, unit = "g", source = "weighed" }
a = { value = 4, count = 3, unit = "m", source = "chosen" }
"""


@pytest.fixture
def read(tmp_path):
    def reading(text):
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return read_cases(path, UNITS)

    return reading


def test_cases_include_common_values_in_si_units(read):
    cases = read(GOOD)
    assert list(cases) == ["slow", "light"]
    assert cases["slow"] == Case(
        "slow", "60 rpm", {"m": 2.0, "a1": 1e-3, "a2": 2.5e-3, "a3": 0.0, "k1": 3000.0}
    )
    assert cases["light"] == Case("light", None, {"m": 0.5, "a1": 4.0, "a2": 4.0, "a3": 4.0})


def test_replaced_numbers_lose_their_source(read):
    cases = read(GOOD)
    table = dict.fromkeys(("a1", "a2", "a3"), "Table 2")
    assert cases["slow"].sources == {"m": "Table 1", **table, "k1": "measured"}
    assert cases["light"].sources == {"m": "weighed", **dict.fromkeys(("a1", "a2", "a3"), "chosen")}
    assert cases["slow"].replaced({"m": 3.0}).sources == {**table, "k1": "measured"}


def entry(text):
    return f"[case.1.parameters]\n{text}\n"


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("k1 = [", CaseFileError, "is not TOML"),
        ("", CaseFileError, r"has no \[case.NAME\]; add one"),
        ("[case]", CaseFileError, r"has no \[case.NAME\]; add one"),
        ("case = 1", CaseFileError, "case in mine.toml is 1; a table was expected"),
        ("[cases.1]", UnknownNameError, "unknown key of mine.toml 'cases'; did you mean 'case'"),
        ("[common]\nk1 = 1", CaseFileError, r"belong in \[common.parameters\]"),
        ("[common]\nk = 1", UnknownNameError, r"unknown key of \[common\] in mine.toml 'k'"),
        ("[case.1]\ntitel = 'x'", UnknownNameError, r"'titel'; did you mean 'title'"),
        ("[case.1]\nspeed = 600", CaseFileError, "speed of case '1' is 600; give a string with a unit"),
        ("[case.1]\nparameters = 3", CaseFileError, "parameters in mine.toml is 3; a table was expected"),
        (entry("k1 = 1"), CaseFileError, 'k1 in mine.toml is 1; write k1 = { value = NUMBER, unit = "N/m"'),
        (entry("k1 = '1 N/m'"), CaseFileError, "k1 in mine.toml is '1 N/m'; write k1 = { value = NUMBER, "),
        ("[parameters]\nk1 = 1", CaseFileError, "parameters is in the top level of mine.toml; "),
        ("[case.1]\nk1 = 1", CaseFileError, r"k1 is in .* of mine.toml; .* in \[case.1.parameters\]"),
        (entry("k1 = {vlaue=1, unit='N/m', source='s'}"), UnknownNameError, "'vlaue'; did you mean 'value'"),
        (entry("k2 = {value=1, unit='N/m', source='s'}"), UnknownNameError, "'k2'; did you mean 'k1'"),
        (entry("a = {values=[1,2,3,4], unit='m', source='s'}"), UnknownNameError, "'a4'; did you mean 'a3'"),
        (entry("k1 = {value=1, source='s'}"), CaseFileError, "k1 in mine.toml has no unit"),
        (entry("k1 = {value=1, unit='N/m'}"), CaseFileError, "k1 in mine.toml has no source"),
        (entry("k1 = {value=1, unit='N/m', source=' '}"), CaseFileError, "k1 in mine.toml has no source"),
        (entry("k1 = {value=1, unit='mm', source='s'}"), UnitError, "k1 in mine.toml: unit 'mm' does not"),
        *(
            (entry(f"k1 = {{value={v}, unit='N/m', source='s'}}"), CaseFileError, "k1 .* give a finite num")
            for v in ("nan", "inf", "true", "'1'", "[1]", "9" * 400)
        ),
        (entry("a = {values=[1, 'x'], unit='m', source='s'}"), CaseFileError, "a2 .* give a finite number"),
        *(
            (entry(f"a = {{{numbers}, unit='m', source='s'}}"), CaseFileError, "allowed: value, value")
            for numbers in (
                "count=3", "values=[]", "values=1", "value=1, count=0", "value=1, count=2.7",
                "value=1, count='x'", "value=1, count=true", "value=1, values=[1]", "values=[1], count=1",
            )
        ),
    ],
)  # fmt: skip
def test_all_invalid_entries_are_reported(read, text, error, message):
    with pytest.raises(error, match=message):
        read(text)


@pytest.mark.parametrize("content", [None, b"\xff\xfe"])
def test_unreadable_file_is_refused(tmp_path, content):
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaseFileError, match=r"mine.toml' cannot be read \(.*\); give a readable case file"):
        read_cases(path, UNITS)


def test_values_of_a_selected_case_may_be_replaced(tmp_path):
    module = SimpleNamespace(NAME="mine", PARAMETERS=[("k1", "N/m", "spring", "> 0"), ("a", "m", "arm", "")])
    path = tmp_path / "mine.toml"
    with pytest.raises(CaseFileError, match="cannot be read"):
        chosen_case(module, path, None, {})
    assert chosen_case(module, path, None, {"k1": 1.0, "a": 2.0}, required=False).name == ""
    with pytest.raises(CaseFileError, match=r"no case file .* for case 'b'"):
        chosen_case(module, path, "b", {}, required=False)
    path.write_text(
        "[case.b]\nspeed = '3 rpm'\n" + "[case.b.parameters]\nk1 = {value=1, unit='N/mm', source='s'}\n"
    )
    assert chosen_case(module, path, None, {"a": 2.0}) == Case("b", "3 rpm", {"k1": 1000.0, "a": 2.0})
    assert chosen_case(module, path, "b", {"k1": 5.0, "a": 2.0}).parameters["k1"] == 5.0
    with pytest.raises(MissingValueError, match=r"case 'b' of mine gives no value for a; .* a=NUMBER"):
        chosen_case(module, path, None, {})
    with pytest.raises(UnknownNameError, match="case of mine 'c'"):
        chosen_case(module, path, "c", {"a": 2.0})
    with pytest.raises(UnknownNameError, match="parameter of mine 'k2'"):
        chosen_case(module, path, None, {"k2": 2.0})


def test_misspelt_parameter_of_a_varied_model_is_refused():
    with pytest.raises(UnknownNameError, match="unknown parameter of cam 'K1'; did you mean 'k1'"):
        solve.load("cam").varied({"K1": 5.0})


def test_case_may_be_selected_by_number():
    assert solve.load("cam", 2).parameters == solve.load("cam", case="2").parameters
    with pytest.raises(UnknownNameError, match="unknown case of cam '7'"):
        solve.load("cam", case=7)
