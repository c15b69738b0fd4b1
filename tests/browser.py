"""Headless Chromium, if it is installed."""

import shutil
import subprocess
import tempfile
from pathlib import Path

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def run(page: Path, *flags: str) -> tuple[str, str]:
    """Return standard output and standard error of the browser after it has opened a page. Raises LookupError
    if there is no browser."""
    if CHROMIUM is None:
        raise LookupError("no Chromium is installed")
    with tempfile.TemporaryDirectory() as own:
        usual = ("--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--v=0")
        ran = subprocess.run(
            [CHROMIUM, *usual, f"--user-data-dir={own}", *flags, page.resolve().as_uri()],
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=120,
            check=True,
        )
    return ran.stdout, ran.stderr
