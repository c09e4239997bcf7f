"""The simulator in lockstep with nodes that only report when they act."""

import contextlib
import itertools
import os
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
from tcpros.client import Client, ClientError

MEMBER = Path(__file__).with_name("lockstep_member.py")
LOSSY_LINK = Path(__file__).with_name("lossy_link.py")
PATIENCE = 90.0
FAST = 4.0
"""Real-time factor without lockstep."""
MINUTES = float(os.environ.get("PIONEER_SEQUENCES_MINUTES", "0.1"))
FIRST = int(os.environ.get("PIONEER_SEQUENCES_FIRST", "1"))
ACTIONS = 60
"""Actions of a random sequence."""

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


RINGS = {"a": "one two", "b": "three"}


class Fleet:
    """The simulator with the ring ``a`` (``one`` and ``two``) and, if requested, the ring ``b`` (``three``).

    Without rings it is not in lockstep.
    """

    def __init__(
        self,
        master: Master,
        group: ProcessGroup,
        folder: Path,
        rings: str,
        silence: str,
        *remappings: str,
    ) -> None:
        self.group, self.folder, self.diary, self.rings = group, folder, folder / "diary", rings
        self.master = master
        self._environment = master.environment
        lockstep = {"rings": rings, "deadline": 2.0, "silence": silence}
        pace = (
            {"real_time_factor": 0.0, "lockstep": lockstep} if rings else {"real_time_factor": FAST}
        )
        master.set_param("/gazebo", {"world_name": "blank", **pace})
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
    for number, (stamp, place) in enumerate(seen):
        assert stamp == pytest.approx(start + 0.01 * number, abs=1e-6), "no pose is left out"
        assert place - x == pytest.approx(stamp - start, abs=1e-6)
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


@dataclass(frozen=True)
class Truth:
    """A message of ground truth: its time, and the body's position and velocity."""

    time: float
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]

    def after(self, seconds: float) -> tuple[float, ...]:
        """Returns where the body is later, if nothing but time changes it."""
        return tuple(a + seconds * b for a, b in zip(self.position, self.velocity, strict=True))


def is_near(one: Iterable[float], other: Iterable[float]) -> bool:
    return list(one) == pytest.approx(list(other), abs=1e-5)


class Watcher:
    """Reads all messages of a body's ground truth; checks that none is left out and that the body does not jump.

    It moves without forces: between two messages on a line, unless it was placed. Each placement and reset is expected
    before it is requested. A body that is placed during a physics step stands until the step's end.
    """

    PERIOD = 0.01
    STEP = 0.05
    """The longest physics step [s]."""
    ROUNDING = 1e-6
    """Of sums of times [s]."""

    def __init__(self, client: Client, topic: str) -> None:
        self._connection = client.subscribe("/gazebo", topic)
        self._connection.be_patient()
        self._condition = threading.Condition()
        self._placed: list[Truth] = []
        self._resets = 0
        self._last: Truth | None = None
        self._stands_until = 0.0
        self.count = 0
        self.faults: list[str] = []
        self._thread = threading.Thread(target=self._receive)
        self._thread.start()

    def expect(
        self, position: Iterable[float], velocity: Iterable[float], reset: bool = False
    ) -> None:
        """Expects that the body continues elsewhere, or that time begins again with it there."""
        with self._condition:
            self._placed.append(Truth(0.0, tuple(position), tuple(velocity)))  # type: ignore[arg-type]
            self._resets += reset

    def await_time(self, time: float) -> None:
        """Waits for a message of a later time, after all resets: by then the body was placed as expected."""
        with self._condition:
            assert self._condition.wait_for(
                lambda: not self._resets and self._last and self._last.time > time, PATIENCE
            ), f"no messages after {self._last}; at {time} s"
            self._placed.clear()

    def close(self) -> None:
        self._connection.interrupt()
        self._thread.join()

    def _receive(self) -> None:
        with self._connection, contextlib.suppress(ConnectionError):
            while True:
                message = Odometry().deserialize(self._connection.read_frame())
                point, speed = message.pose.pose.position, message.twist.twist.linear
                now = Truth(
                    message.header.stamp.to_sec(),
                    (point.x, point.y, point.z),
                    (speed.x, speed.y, speed.z),
                )
                with self._condition:
                    self._check(now)
                    self._last = now
                    self.count += 1
                    self._condition.notify_all()

    def _moved(self, before: Truth, now: Truth) -> bool:
        """Returns whether the body has moved with its velocity, for no longer than the time between two messages."""
        moved = [a - b for a, b in zip(now.position, before.position, strict=True)]
        seconds = time_moved(moved, before.velocity)
        return (
            seconds <= self.PERIOD + 1e-6
            and is_near(now.position, before.after(seconds))
            and is_near(now.velocity, before.velocity)
        )

    def _check(self, now: Truth) -> None:
        before = self._last
        if before is None:
            return
        if now.time < before.time:
            self._resets -= 1
            if self._resets < 0 or now.time > self.PERIOD + 1e-6:
                self.faults.append(f"time went from {before} to {now}")
        elif now.time - before.time != pytest.approx(self.PERIOD, abs=1e-6):
            self.faults.append(f"left out between {before} and {now}")
        elif is_near(now.position, before.after(self.PERIOD)) and is_near(
            now.velocity, before.velocity
        ):
            return
        if now.time <= self._stands_until + self.ROUNDING and self._moved(before, now):
            return
        # It was placed since the message before, perhaps more than once.
        for number, placed in enumerate(self._placed):
            if self._moved(placed, now):
                self._stands_until = now.time + self.STEP
                del self._placed[: number + 1]
                return
        self.faults.append(f"jumped from {before} to {now}; placed at {self._placed}")


def time_moved(moved: Sequence[float], velocity: Sequence[float]) -> float:
    """Returns how long a body at this velocity takes to move so far along it; 0 for one that stands."""
    square = sum(part * part for part in velocity)
    along = sum(a * b for a, b in zip(moved, velocity, strict=True))
    return max(0.0, along / square + 1e-9) if square else 0.0


class Services:
    """Random calls of a running simulator's services, with what each must leave."""

    def __init__(self, fleet: Fleet, client: Client, watcher: Watcher, seed: int) -> None:
        self._fleet, self._client, self._watcher = fleet, client, watcher
        self._chance = random.Random(seed)
        self._running = False
        self._models: list[str] = []
        self._count = 0

    def act(self) -> None:
        """Does a random action."""
        chosen = self._chance.choice(
            (self._run, self._run, self._pause, self._step, self._step, self._place, self._place,
             self._spawn, self._delete, self._reset_world, self._reset_simulation, self._configure)
        )  # fmt: skip
        chosen()
        assert not self._watcher.faults, "\n".join(self._watcher.faults)

    def _call(self, name: str, kind: Any, **fields: Any) -> None:
        answer = self._client.call(f"/gazebo/{name}", kind, **fields)
        assert getattr(answer, "success", True), (name, answer)

    def _run(self) -> None:
        self._call("unpause_physics", Empty)
        self._running = True
        now = self._client.call("/gazebo/get_world_properties", srv.GetWorldProperties).sim_time
        self._watcher.await_time(now + self._chance.uniform(0.0, 0.6))

    def _pause(self) -> None:
        self._call("pause_physics", Empty)
        self._running = False

    def _step(self) -> None:
        self._pause()
        for _ in range(self._chance.randrange(1, 9)):
            self._call("step", Trigger)

    def _place(self) -> None:
        """Sets the state of the watched body, or of another model."""
        name = self._chance.choice(["floating", *self._models])
        place = [self._chance.uniform(-3.0, 3.0) for _ in range(3)]
        speed = [self._chance.choice((0.0, 1.0, -0.5)) for _ in range(3)]
        home = START if name == "floating" else self._home(name)
        place = [a + b for a, b in zip(place, home, strict=True)]
        if name == "floating":
            self._watcher.expect(place, speed)
        state = ModelState(
            name,
            Pose(Point(*place), Quaternion(0, 0, 0, 1)),
            Twist(Vector3(*speed), Vector3()),
            "world",
        )
        self._call("set_model_state", srv.SetModelState, model_state=state)

    def _spawn(self) -> None:
        if len(self._models) > 4:
            return
        self._count += 1
        name = f"m{self._count}"
        text = FLOATING.replace("/truth", f"/{name}/truth").replace('"floating"', f'"{name}"')
        place = Pose(Point(*self._home(name)), Quaternion(0, 0, 0, 1))
        fields = {"model_name": name, "model_xml": text, "initial_pose": place}
        self._call("spawn_sdf_model", srv.SpawnModel, **fields)
        self._models.append(name)

    @staticmethod
    def _home(name: str) -> tuple[float, float, float]:
        """Returns the middle of the space that a model has for itself."""
        return 20.0 * int(name.removeprefix("m")), 0.0, 10.0

    def _delete(self) -> None:
        if self._models:
            name = self._models.pop(self._chance.randrange(len(self._models)))
            self._call("delete_model", srv.DeleteModel, model_name=name)

    def clear(self) -> None:
        """Deletes the models that are left."""
        while self._models:
            self._delete()

    def _reset_world(self) -> None:
        self._watcher.expect(START, STANDING)
        self._call("reset_world", Empty)

    def _reset_simulation(self) -> None:
        self._watcher.expect(START, STANDING, reset=True)
        self._call("reset_simulation", Empty)
        self._run()

    def _configure(self) -> None:
        """Sets another physics step, which moves nothing; gravity stays off."""
        self._call(
            "set_physics_properties",
            srv.SetPhysicsProperties,
            **physics(self._client, self._chance),
        )


def physics(client: Client, chance: random.Random | None = None) -> dict[str, Any]:
    """Returns settings without gravity, and another step if there is a ``chance`` to draw it from."""
    now = client.call("/gazebo/get_physics_properties", srv.GetPhysicsProperties)
    step = now.time_step if chance is None else chance.choice((1 / 600, 0.01, 0.02, 0.05))
    factor = now.max_update_rate * now.time_step
    return {"time_step": step, "max_update_rate": factor / step, "ode_config": now.ode_config}


START, STANDING = (0.0, 0.0, 50.0), (0.0, 0.0, 0.0)


@pytest.mark.parametrize("fleet", [("", "abort"), ("a b", "abort")], indirect=True)
def test_random_calls_of_services_lose_no_message_and_let_nothing_jump(
    fleet: Fleet, record_property: Callable[..., None]
) -> None:
    """With and without lockstep: pause, step, reset, spawn, delete, set state, another physics step."""
    in_lockstep = bool(fleet.rings)
    if in_lockstep:
        for name in ("one", "two", "three"):
            fleet.start(name)
        wait_until(lambda: len(fleet.times("three")) > 10, "ten periods", PATIENCE)
    client = Client(fleet.master.uri, "/test")
    wait_until(lambda: has_service(client, "/gazebo/step"), "the simulator", PATIENCE)
    client.call("/gazebo/pause_physics", Empty)
    client.call("/gazebo/set_physics_properties", srv.SetPhysicsProperties, **physics(client))
    answer = client.call(
        "/gazebo/spawn_sdf_model",
        srv.SpawnModel,
        model_name="floating",
        model_xml=FLOATING,
        initial_pose=Pose(Point(*START), Quaternion(0, 0, 0, 1)),
    )
    assert answer.success, answer.status_message
    watcher = Watcher(client, "/truth")
    end = time.monotonic() + MINUTES * 60.0
    seed = FIRST
    try:
        while seed == FIRST or time.monotonic() < end:
            services = Services(fleet, client, watcher, seed)
            try:
                for _ in range(ACTIONS):
                    services.act()
            except AssertionError as error:
                raise AssertionError(f"seed {seed}: {error}") from error
            services.clear()
            seed += 1
        client.call("/gazebo/pause_physics", Empty)
    finally:
        watcher.close()
    assert watcher.faults == []
    assert watcher.count > 100
    record_property("sequences", seed - FIRST)
    record_property("messages", watcher.count)
    if in_lockstep:
        assert_every_period_is_complete(fleet)


def has_service(client: Client, name: str) -> bool:
    try:
        client.ask_master("lookupService", name)
    except ClientError:
        return False
    return True


def assert_every_period_is_complete(fleet: Fleet) -> None:
    """Checks that between two resets each member acted in each period, on the messages of the period before."""
    said: dict[str, list[tuple[float, set[str]]]] = {}
    for line in fleet.lines():
        stamp, name, *words = line.split()
        said.setdefault(name, []).append((float(stamp), set(",".join(words).split(","))))
    assert set(said) == {"one", "two", "three"}
    for name, entries in said.items():
        # Of a reset's first two periods the one before may be of the former time.
        for number in range(2, len(entries)):
            (first, _), (then, _), (now, heard) = entries[number - 2 : number + 1]
            if not first < then < now:
                continue
            assert now - then == pytest.approx(0.05, abs=1e-6), f"{name} left a period out"
            before = {f"{other}@{then:.2f}" for other in said}
            if name == "two":
                before = before - {f"one@{then:.2f}"} | {f"one@{now:.2f}"}
            assert heard == before, f"{name} at {now:.2f}"
