"""One fleet for all tests of this folder: five robots that drive."""

import re
from collections.abc import Iterator

import pytest

from containers.harness import Fleet, fleet


@pytest.fixture(scope="session")
def started() -> Iterator[tuple[Fleet, float]]:
    """Five robots that were sent to a place each, and the CPU time until all drove [s]."""
    with fleet("pioneer-test", "10.88.7") as made:
        said = made.pioneer("up", "--robots", "5", "--waypoints", "1")
        assert re.search(r"^5 robots drive after \d+ s", said, re.M), said
        yield made, made.cpu_seconds()


@pytest.fixture(scope="session")
def driving(started: tuple[Fleet, float]) -> Fleet:
    """Five robots that drive; whichever test comes first starts them."""
    return started[0]
