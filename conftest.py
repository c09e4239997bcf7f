"""Makes property tests draw the same examples in every run, so that failures are reproducible."""

from hypothesis import settings

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")
