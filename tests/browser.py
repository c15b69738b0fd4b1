"""Chromium without a window, where it is installed."""

import shutil
import subprocess
import tempfile
from pathlib import Path

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def run(page: Path, *flags: str) -> tuple[str, str]:
    """Standard output and error of the browser that opens a page. Raises LookupError where there is none."""
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
