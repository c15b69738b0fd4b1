"""Case files in TOML format: parameter values of a model with their units and sources."""

import json
import math
import tomllib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from solve.arguments import matches_annotations, require_size
from solve.errors import (
    CaseFileError,
    MissingValueError,
    UnitError,
    UnknownNameError,
    ValueOutOfBoundsError,
    cause,
)
from solve.labels import Labels
from solve.model.bodies import EXAMPLE, Body, body_parameters
from solve.model.spread import spread_of
from solve.model.tables import Fit, Series, fitted, series_of
from solve.units import conversion

_SPREAD_KEYS = {"tolerance", "distribution"}
_NUMBER_KEYS = {"value", "values", "count", "unit", "source"} | _SPREAD_KEYS
_TABLE_KEYS = {"table", "columns", "harmonics", "source"}
_BODY_KEYS = {"file", "interface", "unit", "sha256", "source"}
_NUMBERS_A_BYTE = 64
"""Upper estimate of the memory for parsing a file, in numbers per byte of the file. It is compared with the
memory limit."""


@dataclass(frozen=True)
class Case:
    """Case of a model: parameter values with their sources and units.

    Parameters
    ----------
    name : str
        Name of the case.
    speed : str or None
        Speed with unit.
    parameters : mapping
        Mapping from names to values in the units of the model.
    fits : mapping
        Mapping from names of series to their fits to tables.
    sources, units : mapping
        Mappings from names of parameters to their sources, and to the units stated in the file.
    spreads : mapping
        Mapping from names of parameters to tolerances or distributions in text form, such as "±2 %".
    """

    name: str
    speed: str | None
    parameters: Mapping[str, Any]
    fits: Mapping[str, Fit] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict, compare=False)
    units: Mapping[str, str] = field(default_factory=dict, compare=False)
    spreads: Mapping[str, str] = field(default_factory=dict, compare=False)

    @matches_annotations
    def replaced(
        self,
        parameters: Mapping[str, Any],
        fits: Mapping[str, Fit] = MappingProxyType({}),
        sources: Mapping[str, str] = MappingProxyType({}),
        units: Mapping[str, str] = MappingProxyType({}),
        spreads: Mapping[str, str] = MappingProxyType({}),
    ) -> "Case":
        """Return the case with some parameters replaced, and with further fits, sources, units and spreads.

        A series with a replaced parameter no longer counts as fitted. A replaced parameter loses its source
        and its distribution, unless new ones are given. It keeps the unit stated in the file, and its
        tolerance, which then applies to the new value."""
        old_fits = {
            name: fit for name, fit in self.fits.items() if fit.parameters.keys().isdisjoint(parameters)
        }
        old_sources = {name: text for name, text in self.sources.items() if name not in parameters}
        old_spreads = {
            name: text for name, text in self.spreads.items() if name not in parameters or "(" not in text
        }
        return replace(
            self,
            parameters={**self.parameters, **parameters},
            fits={**old_fits, **fits},
            sources={**old_sources, **sources},
            units={**self.units, **units},
            spreads={**old_spreads, **spreads},
        )


def chosen_case(
    module: ModuleType,
    path: Path | None,
    case: str | None,
    replaced: Mapping[str, float | str],
    required: bool = True,
    otherwise: Mapping[str, float | str] = MappingProxyType({}),
) -> Case:
    """Return a case with a value for every declared parameter. It is read from a file; by default, it is the
    first case of the file. Values in `replaced` take precedence.

    path: None for a model in memory. required: whether the file must exist; if False, a missing file results
    in a case without a name and values. otherwise: default values of parameters. Raises UnknownNameError,
    CaseFileError and MissingValueError."""
    declared = {name: unit for name, unit, *_ in module.PARAMETERS}
    functions = functions_of(module)
    cases = read_cases(path, declared, functions) if path and (required or path.is_file()) else None
    if cases is None and case is not None:
        where = (
            f"no case file '{path}'" if path else f"{module.NAME} was derived in memory and has no case file"
        )
        raise CaseFileError(f"{where} for case '{case}'; write one, or omit the case")
    cases = cases or {"": Case("", None, {})}
    if case is not None and case not in cases:
        raise UnknownNameError(f"case of {module.NAME}", case, cases)
    chosen = cases[case] if case is not None else next(iter(cases.values()))
    for name in (*replaced, *otherwise):
        if name not in declared:
            raise UnknownNameError(f"parameter of {module.NAME}", name, declared)
    defined = chosen.parameters.keys() | replaced.keys()
    defaults = {name: value for name, value in otherwise.items() if name not in defined}
    chosen = chosen.replaced({**defaults, **replaced})
    missing = [name for name in declared if name not in chosen.parameters]
    if missing:
        where = f"case '{chosen.name}' of {module.NAME}" if chosen.name else f"{module.NAME} has no case and"
        them = "it" if len(missing) == 1 else "them"
        raise MissingValueError(
            f"{where} gives no value for {', '.join(missing[:8])}; add {them} to the case file or "
            f"set {them}: {missing[0]}=NUMBER"
        )
    return chosen


def functions_of(module: ModuleType) -> dict[str, Series | Body]:
    """Mapping from names to declared series and elastic bodies. A case may take the parameters of a series or
    body from a file."""
    bodies = [Body(*row) for row in getattr(module, "BODIES", ())]
    return {**series_of(getattr(module, "SERIES", ())), **{body.name: body for body in bodies}}


def read_cases(
    path: Path, units: Mapping[str, str], series: Mapping[str, Series | Body] = MappingProxyType({})
) -> dict[str, Case]:
    """Read the cases of a file, in the order of the file.

    units: units of the declared parameters. series: declared series and elastic bodies.

    An entry has the form { value, unit, source }. Instead of one value, { values = […] } defines NAME1,
    NAME2, …, and { value, count } assigns the same value to NAME1 … NAMEcount. `tolerance` or `distribution`
    states the spread of the numbers. { table, columns, harmonics } fits a series to a CSV file in the same
    folder. { file, unit, source } states the file with the matrices of an elastic body. Entries of
    [common.parameters] hold for every case.

    Raises CaseFileError, UnknownNameError for a misspelt key or parameter, UnitError for a unit of another
    dimension."""
    table = _read(path)
    _require_no_parameters(table, {"parameters", *units}, "", path)
    _require_known_keys(table, {"common", "case"}, f"key of {path.name}")
    common = _table(table.get("common", {}), "common", path)
    _require_no_parameters(common, units, "common", path)
    _require_known_keys(common, {"parameters"}, f"key of [common] in {path.name}")
    shared = Case("", None, {}).replaced(*_parameters(common.get("parameters", {}), units, series, path))
    cases = {}
    for name, raw in _table(table.get("case", {}), "case", path).items():
        entry = _table(raw, f"case.{name}", path)
        _require_no_parameters(entry, units, f"case.{name}", path)
        _require_known_keys(entry, {"title", "speed", "parameters"}, f"key of [case.{name}] in {path.name}")
        speed = entry.get("speed")
        if speed is not None and not isinstance(speed, str):
            raise CaseFileError(
                f"speed of case '{name}' is {speed!r}; give a string with a unit, such as '600 rpm'"
            )
        specific = _parameters(entry.get("parameters", {}), units, series, path)
        cases[name] = replace(shared, name=name, speed=speed).replaced(*specific)
    if not cases:
        raise CaseFileError(f"case file '{path}' has no [case.NAME]; add one")
    return cases


def _read(path: Path) -> dict[str, Any]:
    """Content of a TOML file. Raises CaseFileError."""
    try:
        if path.exists() and not path.is_file():
            raise CaseFileError(
                f"case file '{path}' does not exist or is not a file; give the path of a .toml file"
            )
        require_size(f"bytes in case file '{path}'", path.stat().st_size, _NUMBERS_A_BYTE)
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise CaseFileError(
            f"case file '{path}' cannot be read ({cause(error)}); give a readable case file"
        ) from None
    except RecursionError:
        raise CaseFileError(f"case file '{path}' nests too deeply; give plain tables") from None
    except ValueError as error:
        raise CaseFileError(f"case file '{path}' is not TOML: {error}") from None


def _parameters(
    raw: Any, units: Mapping[str, str], series: Mapping[str, Series | Body], path: Path
) -> tuple[dict[str, float], dict[str, Fit], dict[str, str], dict[str, str], dict[str, str]]:
    """Return values in the units declared by the model, fitted series, sources, units used in the file, and
    spreads. All are mappings from names."""
    spreads: dict[str, str] = {}
    values: dict[str, float] = {}
    fits: dict[str, Fit] = {}
    sources: dict[str, str] = {}
    file_units: dict[str, str] = {}
    for name, raw_entry in _table(raw, "parameters", path).items():
        if not isinstance(raw_entry, dict):
            raise CaseFileError(
                f"{name} in {path.name} is {raw_entry!r}; write {_entry_form(name, units.get(name))}"
            )
        entry: dict[str, Any] = raw_entry
        if "table" in entry:
            fit = fits[name.removesuffix("'")] = _fit(name, entry, units, series, path)
            numbers = fit.parameters
        elif "file" in entry:
            numbers, entry["source"] = _body(name, entry, series, path)
        else:
            numbers = _numbers(name, entry, units, path)
            file_units |= dict.fromkeys(numbers, str(entry["unit"]))
            spreads |= _spreads(name, entry, numbers, units, path)
        for member in numbers:
            if member in values:
                raise CaseFileError(f"{member} in {path.name} is given twice, the second time by {name}")
        values |= numbers
        sources |= dict.fromkeys(numbers, str(entry.get("source") or entry.get("table")))
    return values, fits, sources, file_units, spreads


def _body(
    name: str, entry: dict[str, Any], declared: Mapping[str, Series | Body], path: Path
) -> tuple[dict[str, float], str]:
    """Return the parameters of an elastic body, and their source."""
    _require_known_keys(entry, _BODY_KEYS, f"key of {name} in {path.name}")
    body = declared.get(name)
    if not isinstance(body, Body):
        bodies = [each for each, value in declared.items() if isinstance(value, Body)]
        raise UnknownNameError(f"body in {path.name}", name, bodies)
    if not isinstance(entry["file"], str) or not isinstance(entry.get("source"), str):
        raise CaseFileError(f"{name} in {path.name} requires a file, a unit and a source; write {EXAMPLE}")
    return body_parameters(body, entry, path)


def _fit(
    name: str,
    entry: dict[str, Any],
    units: Mapping[str, str],
    series: Mapping[str, Series | Body],
    path: Path,
) -> Fit:
    """Fit of a series to a table."""
    _require_known_keys(entry, _TABLE_KEYS, f"key of {name} in {path.name}")
    function, columns = name.removesuffix("'"), entry.get("columns")
    chosen = series.get(function)
    if not isinstance(chosen, Series):
        known = [each for each, value in series.items() if isinstance(value, Series)]
        raise UnknownNameError(f"series in {path.name}", function, known)
    texts = columns if isinstance(columns, list) else []
    if len(texts) != 2 or not all(isinstance(text, str) for text in (entry["table"], *texts)):
        raise CaseFileError(
            f"{name} in {path.name} requires a table and two columns; write "
            '{ table = "mine.csv", columns = ["angle (deg)", "pressure (bar)"], harmonics = 12 }'
        )
    unit = units[f"{chosen.first}1"]
    return fitted(name, path.parent / entry["table"], texts, entry.get("harmonics"), chosen, unit)


def _numbers(name: str, entry: dict[str, Any], units: Mapping[str, str], path: Path) -> dict[str, float]:
    """Mapping from names to values, for an entry that states numbers."""
    _require_known_keys(entry, _NUMBER_KEYS, f"key of {name} in {path.name}")
    for key in ("unit", "source"):
        if not isinstance(entry.get(key), str) or not entry[key].strip():
            raise CaseFileError(
                f"{name} in {path.name} has no {key}; write {_entry_form(name, units.get(name))}"
            )
    unit: str = entry["unit"]
    values = {}
    for member, number in _members(name, entry, path):
        if member not in units:
            raise UnknownNameError(f"parameter in {path.name}", member, units)
        try:
            values[member] = number * conversion(unit, units[member])
        except UnitError as error:
            raise UnitError(f"{member} in {path.name}: {error}") from None
    return values


def _spreads(
    name: str, entry: dict[str, Any], numbers: Mapping[str, float], units: Mapping[str, str], path: Path
) -> dict[str, str]:
    """Mapping from names of parameters to spreads in text form, for one entry. Raises CaseFileError,
    UnitError."""
    texts = [entry[key] for key in sorted(_SPREAD_KEYS & entry.keys())]
    if len(texts) > 1 or not all(isinstance(text, str) for text in texts):
        raise CaseFileError(
            f"{name} in {path.name} requires exactly one string: either tolerance = '±2 %' or "
            "distribution = 'normal(8e4, 2e3)'"
        )
    try:
        for member, value in numbers.items() if texts else ():
            spread_of(member, texts[0], value, units[member], entry["unit"])
    except ValueOutOfBoundsError as error:
        raise CaseFileError(f"{path.name}: {error}") from None
    return dict.fromkeys(numbers, str(texts[0])) if texts else {}


def _members(name: str, entry: dict[str, Any], path: Path) -> Iterator[tuple[str, float]]:
    """Yield the name and the value of each parameter of an entry with `value`, with `value` and `count`, or
    with `values`."""
    forms = entry.keys() & {"value", "values", "count"}
    if forms == {"value"}:
        pairs = iter([(name, entry["value"])])
    elif forms == {"value", "count"} and type(entry["count"]) is int and entry["count"] > 0:
        pairs = ((f"{name}{k + 1}", entry["value"]) for k in range(entry["count"]))
    elif forms == {"values"} and isinstance(entry["values"], list) and entry["values"]:
        pairs = ((f"{name}{k}", number) for k, number in enumerate(entry["values"], start=1))
    else:
        given = ", ".join(f"{key} = {entry[key]!r}" for key in sorted(forms)) or "no value"
        raise CaseFileError(
            f"{name} in {path.name} has {given[:80]}; allowed: value, value with count (an integer >= 1), or "
            "values (a list that is not empty)"
        )
    for member, number in pairs:
        yield member, _finite(member, number, path)


def _finite(member: str, value: Any, path: Path) -> float:
    try:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        number = float(value) if is_number else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        shown = repr(value) if len(repr(value)) < 40 else "too large"
        raise CaseFileError(f"{member} in {path.name} is {shown}; give a finite number as its value")
    return number


def _entry_form(name: str, unit: str | None) -> str:
    """Example of an entry for a parameter. unit: unit of the declared parameter, or None if there is no such
    parameter."""
    example = "N/m" if unit is None else unit
    return f'{name} = {{ value = NUMBER, unit = "{example}", source = "TEXT" }}'


def _require_no_parameters(table: Mapping[str, Any], names: Collection[str], place: str, path: Path) -> None:
    """Raise CaseFileError if a parameter is stated in a table other than [….parameters]. names: names of
    parameters."""
    for key in table:
        if key in names:
            where = f"[{place}]" if place else "the top level"
            right = f"[{place}.parameters]" if place else "[common.parameters] or [case.NAME.parameters]"
            raise CaseFileError(f"{key} is in {where} of {path.name}; parameters belong in {right}")


def _table(raw: Any, name: str, path: Path) -> dict[str, Any]:
    if not isinstance(raw, dict):
        raise CaseFileError(f"{name} in {path.name} is {raw!r}; a table was expected")
    return raw


def _require_known_keys(table: Mapping[str, Any], allowed: set[str], kind: str) -> None:
    for key in table:
        if key not in allowed:
            raise UnknownNameError(kind, key, allowed)


def case_text(name: str, title: str, labels: Labels, sources: Mapping[str, str]) -> str:
    """Text of a case file with the parameters in `labels`, each with its unit and source. sources: mapping
    from names of some parameters to sources."""
    unchanged = f"as in case {labels.case}" if labels.case else "as given"
    lines = [f"[case.{name}]", f"title = {json.dumps(title)}", f"[case.{name}.parameters]"]
    for parameter, value in labels.parameters.items():
        unit, source = labels.parameter_labels[parameter][0], sources.get(parameter, unchanged)
        lines.append(
            f"{parameter} = {{ value = {value!r}, unit = {json.dumps(unit)}, source = {json.dumps(source)} }}"
        )
    return "\n".join(lines) + "\n"
