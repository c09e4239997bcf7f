"""Masters, talkers and relays."""

import sys
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until

sys.path.insert(0, str(Path(__file__).parent))
from relay_side import NODES, Side


@pytest.fixture(scope="module")
def source_master():
    with Master() as master:
        yield master


@pytest.fixture(scope="module")
def sink_master():
    with Master() as master:
        yield master


@pytest.fixture(scope="module")
def talkers(source_master, tmp_path_factory):
    """Two talkers on the source's master."""
    logs = tmp_path_factory.mktemp("talkers")
    with ProcessGroup() as group:
        for name in ("talker1", "talker2"):
            argv = [sys.executable, str(NODES / "talker.py"), "last", "of", name, f"__name:={name}"]
            group.start(name, argv, source_master.environment, logs / name)
        wait_until(
            lambda: len(source_master.system_state()[0].get("/latched", [])) == 2,
            "two talkers",
            START,
        )
        yield group


@pytest.fixture
def certificates():
    """The certificates of relays that are not given others: none."""
    return


@pytest.fixture
def relays(source_master, sink_master, certificates):
    """Creates relays and shuts them down."""
    made = []

    def make(name, **settings):
        master = source_master if name == "source" else sink_master
        made.append(Side(name, master, **{"certificates": certificates, **settings}))
        return made[-1]

    yield make
    for side in made:
        side.relay.shutdown()
    assert not [
        name
        for name in sink_master.system_state()[0].values()
        if any(n.startswith("/source/") for n in name)
    ]


@pytest.fixture
def sides(relays, talkers):
    """A source and a sink without any links."""
    return relays("source"), relays("sink")
