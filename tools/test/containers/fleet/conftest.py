"""One fleet for all tests of this folder: five driving robots."""

import re
from collections.abc import Iterator

import pytest
from tested_fleet import Fleet, fleet


@pytest.fixture(scope="session")
def started() -> Iterator[tuple[Fleet, float]]:
    """Yields a fleet whose five robots were each sent to a place, and the CPU time until all were driving [s]."""
    with fleet("pioneer-test", "10.88.7") as made:
        said = made.pioneer("up", "--robots", "5", "--waypoints", "1")
        assert re.search(r"^5 robots drive after \d+ s", said, re.M), said
        yield made, made.cpu_seconds()


@pytest.fixture(scope="session")
def driving(started: tuple[Fleet, float]) -> Fleet:
    """Returns the fleet of five driving robots; the first test that uses it starts it."""
    return started[0]
