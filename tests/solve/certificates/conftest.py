"""Print rates after the tests, whether or not output is captured."""

import pytest

LINES = pytest.StashKey[list[str]]()


@pytest.fixture
def report(request):
    """Lines to print after the run."""
    return request.config.stash.setdefault(LINES, []).append


def pytest_terminal_summary(terminalreporter, config):
    lines = config.stash.get(LINES, [])
    if lines:
        terminalreporter.section("honesty of error estimates")
        for line in lines:
            terminalreporter.write_line(line)
