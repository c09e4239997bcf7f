"""The simulator in lockstep with nodes that only report when they act."""

import contextlib
import itertools
import os
import random
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from gazebo_msgs import srv
from gazebo_msgs.msg import ModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from nav_msgs.msg import Odometry
from std_srvs.srv import Empty, Trigger

from pioneer_harness.error import ProcessDiedError
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from tcpros.client import Client

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
        self.master = master
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


FLOATING = """<sdf version="1.6"><model name="floating"><link name="box"><inertial><mass>1</mass></inertial>
<collision name="c"><geometry><box><size>0.2 0.2 0.2</size></box></geometry></collision></link>
<plugin name="truth" filename="libgazebo_ros_p3d.so"><bodyName>box</bodyName><topicName>/truth</topicName>
<updateRate>100</updateRate></plugin></model></sdf>"""


@contextmanager
def recorded_truth(client: Client) -> Iterator[list[tuple[float, float]]]:
    """Returns a growing list of the times and x coordinates that the simulator publishes."""
    found: list[tuple[float, float]] = []
    connection = client.subscribe("/gazebo", "/truth")
    connection.be_patient()

    def receive() -> None:
        with connection, contextlib.suppress(ConnectionError):
            while True:
                message = Odometry().deserialize(connection.read_frame())
                found.append((message.header.stamp.to_sec(), message.pose.pose.position.x))

    thread = threading.Thread(target=receive)
    thread.start()
    try:
        yield found
    finally:
        connection.interrupt()
        thread.join()


@pytest.mark.parametrize("fleet", [("a b", "abort")], indirect=True)
def test_steps_pauses_and_runs_lose_no_message_and_extrapolate_no_pose(fleet: Fleet) -> None:
    """A box moves through space at 1 m/s: each of its poses is on a line, whatever makes time advance."""
    for name in ("one", "two", "three"):
        fleet.start(name)
    wait_until(lambda: len(fleet.times("three")) > 10, "ten periods", PATIENCE)
    client = Client(fleet.master.uri, "/test")
    client.call("/gazebo/pause_physics", Empty)
    physics = client.call("/gazebo/get_physics_properties", srv.GetPhysicsProperties)
    answer = client.call(
        "/gazebo/set_physics_properties",
        srv.SetPhysicsProperties,
        time_step=physics.time_step,
        ode_config=physics.ode_config,
    )
    assert answer.success, answer.status_message
    height = Pose(Point(0, 0, 5), Quaternion(0, 0, 0, 1))
    answer = client.call(
        "/gazebo/spawn_sdf_model",
        srv.SpawnModel,
        model_name="floating",
        model_xml=FLOATING,
        initial_pose=height,
    )
    assert answer.success, answer.status_message
    state = ModelState("floating", height, Twist(Vector3(1, 0, 0), Vector3()), "world")
    answer = client.call("/gazebo/set_model_state", srv.SetModelState, model_state=state)
    assert answer.success, answer.status_message
    began = fleet.times("three")[-1]
    chance = random.Random(1)
    with recorded_truth(client) as poses:
        for _ in range(15):
            for _ in range(chance.randrange(1, 9)):
                answer = client.call("/gazebo/step", Trigger)
                assert answer.success, answer.message
            client.call("/gazebo/unpause_physics", Empty)
            count = len(fleet.times("three")) + chance.randrange(1, 5)
            wait_until(lambda n=count: len(fleet.times("three")) >= n, "periods", PATIENCE)  # type: ignore[misc]
            client.call("/gazebo/pause_physics", Empty)
        seen = list(poses)
    assert len(seen) > 100
    start, x = seen[0]
    for number, (time, place) in enumerate(seen):
        assert time == pytest.approx(start + 0.01 * number, abs=1e-6), "no pose is left out"
        assert place - x == pytest.approx(time - start, abs=1e-6)
    assert_nothing_lost(fleet, began)


def assert_nothing_lost(fleet: Fleet, began: float) -> None:
    """Checks that since a time each member acted in each period, on the messages of the period before."""
    times = sorted({time for time in fleet.times("one") if time >= began})
    assert times == pytest.approx([began + 0.05 * number for number in range(len(times))], abs=1e-6)
    entries = [line.split() for line in fleet.lines()]
    heard = {(time, name): set(",".join(words).split(",")) for time, name, *words in entries}
    # The last period may not be complete.
    for then, now in itertools.pairwise(times[:-1]):
        before = {f"{name}@{then:.2f}" for name in ("one", "two", "three")}
        assert heard[f"{now:.2f}", "one"] == before
        assert heard[f"{now:.2f}", "three"] == before
        assert heard[f"{now:.2f}", "two"] == before - {f"one@{then:.2f}"} | {f"one@{now:.2f}"}
