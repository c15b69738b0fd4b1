"""`python -m tests.random_commands [COUNT [SEED]]`: run random command lines and report what ends otherwise
than in a result or in one line."""

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.random_commands.run import complaint, inside, random_commands
from tests.random_commands.values import prepare


def main(count: int = 5000, seed: int = 1) -> int:
    """Return the number of complaints."""
    found, statuses = 0, Counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        prepare(folder)
        for number, (program, arguments) in enumerate(random_commands(seed, count)):
            begun = time.process_time()
            ended = inside(program, arguments, folder)
            statuses[ended.status] += 1
            seconds, wrong = time.process_time() - begun, complaint(ended)
            found += bool(wrong)
            if wrong or seconds > 20:
                shown = [
                    argument if len(argument) < 60 else f"{argument[:20]}…({len(argument)})"
                    for argument in arguments
                ]
                print(f"{number} ({seconds:.1f} s) {program} {shown}: {wrong[:300]}", flush=True)
    print(f"{count} command lines, seed {seed}: {found} complaints; statuses {dict(statuses)}")
    return found


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, sys.argv[1:]))))
