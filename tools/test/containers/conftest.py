"""A fleet for the tests of one file."""

from collections.abc import Iterator

import pytest

from containers.harness import Fleet, fleet


@pytest.fixture(scope="module")
def five() -> Iterator[Fleet]:
    """Five robots that drive."""
    with fleet("pioneer-test", "10.88.7") as made:
        yield made
