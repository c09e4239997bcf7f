"""The simulator in lockstep with two nodes that do nothing but say when they act."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_harness.error import ProcessDiedError
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

MEMBER = Path(__file__).with_name("lockstep_member.py")
PATIENCE = 90.0

pytestmark = pytest.mark.filterwarnings("ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning")


class Fleet:
    """The simulator and the ring ``a`` of ``one`` and ``two``."""

    def __init__(self, master: Master, group: ProcessGroup, folder: Path) -> None:
        self.group, self.folder, self.diary = group, folder, folder / "diary"
        self._environment = master.environment
        lockstep = {"rings": "a", "deadline": 2.0}
        master.set_param("/gazebo", {"world_name": "blank", "real_time_factor": 0.0, "lockstep": lockstep})
        server = ["rosrun", "pioneer_gazebo", "pioneer_gazebo_server", "__name:=gazebo"]
        group.start("simulator", server, self._environment, self.log)

    @property
    def log(self) -> Path:
        """What the simulator prints."""
        return self.folder / "simulator.log"

    def start(self, name: str) -> int:
        """Starts a member; returns its process."""
        own = {"LOCKSTEP_MEMBERS": "one two", "MEMBER": name, "DIARY": str(self.diary), "ROS_NAMESPACE": "a"}
        command = [sys.executable, str(MEMBER)]
        return self.group.start(name, command, {**self._environment, **own}, self.folder / f"{name}.log")

    def lines(self) -> list[str]:
        """Returns the whole lines of the diary."""
        text = self.diary.read_text() if self.diary.exists() else ""
        return text[: text.rfind("\n") + 1].splitlines()


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    """Returns a simulator that waits for its ring."""
    with Master() as master, ProcessGroup() as group:
        yield Fleet(master, group, tmp_path)


def test_members_act_in_their_order_in_each_period_and_a_silent_one_is_named(fleet: Fleet) -> None:
    fleet.start("one")
    wait_until(
        lambda: "lockstep waits for a" in fleet.log.read_text(), "the simulator to report whom it waits for", PATIENCE
    )
    assert fleet.lines() == []
    two = fleet.start("two")
    wait_until(lambda: len(fleet.lines()) > 100, "fifty periods", PATIENCE)
    told = fleet.lines()[2:100]
    expected = []
    for number in range(2, 51):
        then, now = f"{(number - 1) * 0.05:.2f}", f"{number * 0.05:.2f}"
        expected += [f"{now} one one@{then},two@{then}", f"{now} two two@{then},one@{now}"]
    assert told == expected

    os.kill(two, signal.SIGSTOP)

    def ended() -> bool:
        try:
            fleet.group.check()
        except ProcessDiedError:
            return True
        return False

    wait_until(ended, "the simulator to end", PATIENCE)
    assert "/a/two does not answer" in fleet.log.read_text()
