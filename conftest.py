"""Property tests draw the same examples in every run: what is red once is red again."""

from hypothesis import settings

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")
