"""Tables of `docs/commands.md`: the flags of every command, and the JSON keys of `json_keys.toml`.

`python docs/extensions/commands_page.py` updates the tables between the markers of the page.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

_DOCS = Path(__file__).parents[1]
PAGE = _DOCS / "commands.md"
COMMAND = "python docs/extensions/commands_page.py"
"""Command that updates the page."""

_SHARED = 3
"""Smallest number of commands with a flag in the table of shared flags. Chosen by judgement."""

_MARKED = re.compile(r"(<!-- begin (\w+), by [^>]*-->\n).*?(<!-- end \2 -->)", re.DOTALL)


def programs() -> Iterator[tuple[str, Any]]:
    """Yield the name and the Typer command of every command of the package."""
    for name, module in (
        ("solve", "solve.commands.app"),
        ("models.four_bar", "models.four_bar.__main__"),
        ("models.coupler", "models.coupler.__main__"),
        ("models.portal_frame", "models.portal_frame.__main__"),
    ):
        program = getattr(import_module(module), "SOLVE" if name == "solve" else "PROGRAM")
        for command in program.listed:
            app = typer.main.get_command(program.commands(command))
            several = len(program.listed) > 1
            yield f"{name} {command}" if several else name, app.commands[command] if several else app
    yield "derive", typer.main.get_command(import_module("derive.command").app)


class Flag:
    """One row of a table of flags."""

    def __init__(self, parameter: Any) -> None:
        """Create the row of a Typer parameter."""
        names = ", ".join([*parameter.opts, *parameter.secondary_opts])
        form = "" if parameter.is_flag or parameter.metavar is None else f" {parameter.metavar}"
        self.text = f"`{names}{form}`"
        self.help = parameter.help or ""
        default = parameter.default
        if default not in (None, False, (), []) and not callable(default):
            self.help += f" Default: {default}."

    @property
    def row(self) -> str:
        """Row of the table, without the column of commands."""
        return f"| {_cell(self.text)} | {_cell(self.help)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def flags() -> dict[str, list[Flag]]:
    """Return the flags of every command, except `--help`."""
    return {
        name: [
            Flag(parameter)
            for parameter in command.params
            if parameter.param_type_name == "option" and "--help" not in parameter.opts
        ]
        for name, command in programs()
    }


def flags_text() -> str:
    """Return the tables of flags: shared flags first, then the other flags of each command."""
    commands = flags()
    users: dict[str, list[str]] = {}
    for name, listed in commands.items():
        for flag in listed:
            users.setdefault(flag.row, []).append(name)
    shared = [row for row, names in users.items() if len(names) >= _SHARED]
    lines = ["### Flags of several commands", "", "| flag | meaning | commands |", "|---|---|---|"]
    lines += [f"{row} {_names(users[row], commands)} |" for row in shared]
    for name, listed in commands.items():
        own = [flag.row for flag in listed if flag.row not in shared]
        if own:
            lines += ["", f"### Flags of `{name}`", "", "| flag | meaning |", "|---|---|", *own]
    return "\n".join(lines)


def _names(users: list[str], commands: Mapping[str, object]) -> str:
    """Return the text that lists the commands `users` of a flag."""
    missing = [name for name in commands if name not in users]
    if not missing:
        return "all"
    if len(missing) < len(users) and len(missing) <= _SHARED:
        return f"all except {', '.join(f'`{name}`' for name in missing)}"
    return ", ".join(f"`{name.removeprefix('solve ')}`" for name in users)


def keys() -> dict[str, dict[str, Any]]:
    """Return the groups of JSON keys, a mapping from titles to groups."""
    return tomllib.loads((_DOCS / "json_keys.toml").read_text(encoding="utf-8"))


def keys_text() -> str:
    """Return the tables of JSON keys, one table per group."""
    lines: list[str] = []
    for title, group in keys().items():
        text = [group["_text"], ""] if "_text" in group else []
        lines += ["", f"### Keys of {title[0].lower()}{title[1:]}", "", *text, "| key | value |", "|---|---|"]
        lines += [f"| `{_cell(key)}` | {_cell(value)} |" for key, value in flat(group)]
    return "\n".join(lines[1:])


def flat(group: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return pairs of a key of the group and its description."""
    return [(key, value) for key, value in group.items() if not key.startswith("_")]


def patterns(group: Mapping[str, Any]) -> list[str]:
    """Return the keys of a group. A key that ends in `*` is replaced by the keys of the inner object in the
    preceding rows."""
    expanded, inner, last = list[str](), list[str](), ""
    for key, _ in flat(group):
        outer, _, name = key.rpartition(".")
        if name == "*":
            expanded += [f"{outer}.{key}" for key in inner]
            continue
        inner, last = [*(inner if outer == last else []), name], outer
        expanded.append(key)
    return expanded


def renewed(page: str) -> str:
    """Return the page with new tables between its markers."""
    texts = {"flags": flags_text, "keys": keys_text}
    return _MARKED.sub(lambda block: f"{block[1]}\n{texts[block[2]]()}\n\n{block[3]}", page)


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
