"""Makes property tests draw the same examples in every run, and skips the tests of tools/ without a set-up checkout.

``./pioneer package --test`` runs the tests against the installed Debian package.
"""

from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parent

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skips the tests of tools/ if this folder was not set up."""
    if (ROOT / ".setup" / "venv").exists():
        return
    for item in items:
        if item.path.is_relative_to(ROOT / "tools"):
            item.add_marker(pytest.mark.skip(reason="needs a checkout that is set up"))
