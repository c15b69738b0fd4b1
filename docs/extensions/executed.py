"""Run the commands of the pages when the site is built, and insert their output.

A block of type `console` contains commands after `$ `, with their output. A block whose first line is a
comment with a file name, such as `# saw.py`, is written to this file. `python docs/extensions/executed.py
PAGE …` updates the output in the pages.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

_BLOCK = re.compile(r"```(\w+)\n(?:# (\w+\.\w+)\n)?(.*?)```", re.DOTALL)

_PASSING = re.compile(r"compiling |(?:solve|derive): \d.* so far")
"""Lines that depend on the machine and are omitted."""


def printed(command: str, folder: Path) -> str:
    """Run a command in the folder and return its output, including errors and warnings, but without notes on
    compilation and progress.

    Raises RuntimeError if its exit status is neither 0 nor 2.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    environment = {**os.environ, "PATH": path, "MPLBACKEND": "Agg", "COLUMNS": "80"}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "timeout": 120}
    run = subprocess.run(command, shell=True, cwd=folder, env=environment, check=False, **streams)
    if run.returncode not in (0, 2):
        raise RuntimeError(f"{command} ended in {run.returncode}:\n{run.stdout}")
    lines = [line.rstrip() for line in run.stdout.splitlines()]
    return "\n".join(line for line in lines if not _PASSING.match(line))


def executed(page: str) -> str:
    """Return the page with the present output of its commands, which are run in sequence in a new folder."""
    with tempfile.TemporaryDirectory() as name:

        def renewed(block: re.Match[str]) -> str:
            language, file, text = block.groups()
            if file:
                (Path(name) / file).write_text(text, encoding="utf-8")
            if language != "console":
                return block[0]
            commands = re.findall(r"^\$ (.*)$", text, flags=re.MULTILINE)
            shown = [f"$ {command}\n{printed(command, Path(name))}".strip() for command in commands]
            return "```console\n" + "\n".join(shown) + "\n```"

        return _BLOCK.sub(renewed, page)


def _read(app: Any, page: str, source: list[str]) -> None:
    if "```console\n" in source[0]:
        source[0] = executed(source[0])


def setup(app: Any) -> dict[str, bool]:
    app.connect("source-read", _read)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    for page in map(Path, sys.argv[1:]):
        page.write_text(executed(page.read_text(encoding="utf-8")), encoding="utf-8")
