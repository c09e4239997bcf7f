"""A swarm of three engines, one of which joins late, and one fleet on it for all tests of this folder."""

from collections.abc import Iterator, Sequence

import pytest
from errand import Errands
from tested_fleet import Fleet, fleet, may_have_base

from containers.hosts import Host, swarm_here


@pytest.fixture(scope="session")
def hosts() -> Iterator[Sequence[Host]]:
    """Yields two more hosts; the first one has joined the swarm and may run the base station."""
    with swarm_here(2) as made:
        made[0].join()
        may_have_base(made[0])
        yield made


@pytest.fixture(scope="session")
def on_swarm(hosts: Sequence[Host]) -> Iterator[Fleet]:
    """Yields a fleet that the tests start, at half speed because three engines each count this machine's processors."""
    with fleet("pioneer-swarm", "10.88.12") as made:
        yield made


@pytest.fixture
def errands(on_swarm: Fleet) -> Iterator[Errands]:
    """Yields the robots' errands; those that a test leaves unfinished are abandoned."""
    made = Errands(on_swarm)
    yield made
    made.close()
