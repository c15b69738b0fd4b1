"""Random command lines end with a result or a one-line error; `python -m tests.random_commands 5000` runs
more."""

import pytest

from tests.random_commands.lines import MODELS, flags
from tests.random_commands.run import SECONDS, Ended, complaint, inside, outside, random_commands
from tests.random_commands.values import VALUES, prepare

INSIDE, OUTSIDE, SEED = 240, 60, 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("lines")
    prepare(place)
    return place


def test_same_seed_gives_the_same_command_lines():
    assert list(random_commands(3, 50)) == list(random_commands(3, 50))
    assert len({str(each) for each in random_commands(3, 50)}) > 45


def test_every_flag_of_every_command_has_values():
    """New commands and flags must also be tested."""
    known = {flag: valued for command in flags().values() for flag, valued in command.items()}
    assert {flag for flag, valued in known.items() if valued} == set(VALUES)
    assert {each[0] for each in flags()} == {"derive", "solve", *MODELS}
    assert "models.portal_frame" in MODELS


@pytest.mark.parametrize(
    ("ended", "expected"),
    [
        (Ended(70, "solve: a fault"), "status 70: solve: a fault"),
        (Ended(-11, ""), "status -11"),
        (Ended(2, ""), "0 lines of refusal"),
        (Ended(2, "a\nb\nc\nd"), "4 lines of refusal"),
        (Ended(0, "RuntimeWarning: overflow"), "unexpected"),
        (Ended(None, ""), f"took more than {SECONDS} s"),
        (Ended(2, "solve: no\n"), ""),
        (Ended(0, "warning: w\nwrote a.csv\n"), ""),
        (Ended(0, "solve: 10 s so far: 3 of 4 points\ncam: I0 moves nothing\nwrote cam.py\n"), ""),
    ],
)
def test_faults_are_classified(ended, expected):
    assert complaint(ended).startswith(expected)
    assert bool(complaint(ended)) == bool(expected)


@pytest.mark.slow
@pytest.mark.parametrize(("run", "seed", "count"), [(inside, SEED, INSIDE), (outside, SEED + 1, OUTSIDE)])
def test_random_command_lines_end_with_a_result_or_one_line(folder, run, seed, count):
    wrong = {}
    for program, arguments in random_commands(seed, count):
        text = complaint(run(program, arguments, folder))
        if text:
            wrong[program, *arguments] = text
    assert wrong == {}
