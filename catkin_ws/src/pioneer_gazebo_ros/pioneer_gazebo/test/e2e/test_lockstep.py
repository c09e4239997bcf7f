"""The simulator in lockstep with nodes that only report when they act."""

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
LOSSY_LINK = Path(__file__).with_name("lossy_link.py")
PATIENCE = 90.0

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


RINGS = {"a": "one two", "b": "three"}


class Fleet:
    """The simulator with the ring ``a`` (``one`` and ``two``) and, if requested, the ring ``b`` (``three``)."""

    def __init__(
        self,
        master: Master,
        group: ProcessGroup,
        folder: Path,
        rings: str,
        silence: str,
        *remappings: str,
    ) -> None:
        self.group, self.folder, self.diary = group, folder, folder / "diary"
        self._environment = master.environment
        lockstep = {"rings": rings, "deadline": 2.0, "silence": silence}
        master.set_param(
            "/gazebo", {"world_name": "blank", "real_time_factor": 0.0, "lockstep": lockstep}
        )
        server = [
            "rosrun",
            "pioneer_gazebo",
            "pioneer_gazebo_server",
            "__name:=gazebo",
            *remappings,
        ]
        group.start("simulator", server, self._environment, self.log)

    @property
    def log(self) -> Path:
        """The file with the simulator's output."""
        return self.folder / "simulator.log"

    def start(self, name: str, *remappings: str) -> int:
        """Starts a member; returns its process ID."""
        ring = next(ring for ring, members in RINGS.items() if name in members)
        own = {
            "LOCKSTEP_MEMBERS": RINGS[ring],
            "MEMBER": name,
            "DIARY": str(self.diary),
            "ROS_NAMESPACE": ring,
        }
        command = [sys.executable, str(MEMBER), *remappings]
        return self.group.start(
            name, command, {**self._environment, **own}, self.folder / f"{name}.log"
        )

    def lose(self, topic: str, *periods: int) -> Path:
        """Forwards a topic to ``TOPIC_lossy`` without the tokens of ``periods``; returns the link's log file."""
        log = self.folder / f"{topic.rpartition('/')[2]}.log"
        command = [sys.executable, str(LOSSY_LINK), topic, f"{topic}_lossy", *map(str, periods)]
        self.group.start(f"lossy {topic}", command, self._environment, log)
        return log

    def lines(self) -> list[str]:
        """Returns the complete lines of the diary."""
        text = self.diary.read_text() if self.diary.exists() else ""
        return text[: text.rfind("\n") + 1].splitlines()

    def times(self, name: str) -> list[float]:
        """Returns the times at which a member acted [s of simulated time]."""
        words = (line.split() for line in self.lines())
        return [float(time) for time, member, *_ in words if member == name]


@pytest.fixture
def fleet(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Fleet]:
    """Returns a simulator that waits for its rings. Parameters: ring names, action on silence, remappings."""
    rings, silence, *remappings = getattr(request, "param", ("a", "abort"))
    with Master() as master, ProcessGroup() as group:
        yield Fleet(master, group, tmp_path, rings, silence, *remappings)


def test_members_act_in_their_order_in_each_period_and_a_silent_one_is_named(fleet: Fleet) -> None:
    fleet.start("one")
    wait_until(
        lambda: "lockstep waits for a" in fleet.log.read_text(),
        "the simulator to report whom it waits for",
        PATIENCE,
    )
    assert fleet.lines() == []
    two = fleet.start("two")
    assert_acts_in_order(fleet)

    os.kill(two, signal.SIGSTOP)

    def ended() -> bool:
        try:
            fleet.group.check()
        except ProcessDiedError:
            return True
        return False

    wait_until(ended, "the simulator to end", PATIENCE)
    assert "/a/two does not answer" in fleet.log.read_text()


def assert_acts_in_order(fleet: Fleet) -> None:
    """Checks the first fifty periods: which member acted when, and which messages it had received."""
    wait_until(lambda: len(fleet.lines()) > 100, "fifty periods", PATIENCE)
    expected = []
    for number in range(2, 51):
        then, now = f"{(number - 1) * 0.05:.2f}", f"{number * 0.05:.2f}"
        expected += [f"{now} one one@{then},two@{then}", f"{now} two two@{then},one@{now}"]
    assert fleet.lines()[2:100] == expected


@pytest.mark.parametrize(
    "fleet", [("a", "abort", "/a/lockstep/done:=/a/lockstep/done_lossy")], indirect=True
)
def test_a_lost_token_is_sent_again_wherever_it_was_lost_and_changes_nothing(fleet: Fleet) -> None:
    """Tokens are lost before, within and after the ring; one is lost twice."""
    losses = {"period": (10, 10), "after_one": (20, 40), "done": (30, 40)}
    logs = {name: fleet.lose(f"/a/lockstep/{name}", *periods) for name, periods in losses.items()}
    fleet.start("one", "/a/lockstep/period:=/a/lockstep/period_lossy")
    fleet.start("two", "/a/lockstep/after_one:=/a/lockstep/after_one_lossy")
    assert_acts_in_order(fleet)
    for name, periods in losses.items():
        assert logs[name].read_text() == "".join(f"lost {period}\n" for period in periods)


@pytest.mark.parametrize("fleet", [("a b", "drop")], indirect=True)
def test_time_continues_without_a_silent_ring_which_joins_again(fleet: Fleet) -> None:
    pids = {name: fleet.start(name) for name in ("one", "two", "three")}
    wait_until(lambda: len(fleet.times("two")) > 10, "ten periods", PATIENCE)
    os.kill(pids["two"], signal.SIGSTOP)
    wait_until(
        lambda: "continuing without a" in fleet.log.read_text(), "the ring to be dropped", PATIENCE
    )
    assert "/a/two does not answer; continuing without a" in fleet.log.read_text()
    dropped = fleet.times("two")[-1]
    wait_until(
        lambda: fleet.times("three")[-1] > dropped + 1.0, "the other ring to continue", PATIENCE
    )
    os.kill(pids["two"], signal.SIGCONT)
    again = fleet.times("three")[-1]
    wait_until(
        lambda: fleet.times("two")[-1] > again + 1.0, "the ring to take part again", PATIENCE
    )
    assert fleet.log.read_text().count("a takes part: /a/one, /a/two") == 2
    joined = min(time for time in fleet.times("one") if time > again)
    later = [time for time in fleet.times("two") if time > joined + 0.01]
    assert later == [time for time in fleet.times("one") if joined + 0.01 < time <= later[-1]], (
        "both, in each period"
    )
