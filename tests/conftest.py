"""What holds for every test: property tests draw the same examples in every run, so that a pass is a pass
everywhere, and a shared machine may be slow, which is no failure.

`--hypothesis-profile=search` draws anew: for looking for failures that no run has seen.
"""

from hypothesis import settings

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", derandomize=False, deadline=None)
settings.load_profile("repeatable")
