"""The door between a ROS 1 master and a real ROS 2: rclpy with Fast DDS, and a reader of Cyclone DDS for transforms."""

import json
import os
import random
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

from pioneer_harness.masters import Master, MasterProcess
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until

HERE = Path(__file__).parent
ROOT = Path(__file__).resolve().parents[5]
PEER = ROOT / ".setup" / "ros2-peer" / "bin" / "python3"
CROSSES = 20.0
"""Time within which something crosses once both sides run: discovery takes a second or two [s]."""
LEASE = 20.0
"""Time after which Fast DDS counts a participant as gone [s]."""
SEED, KILLS = 43, 60.0
"""Of the order in which parts are killed, and for how long [s]."""

pytestmark = [
    # Other tests remove network interfaces, after which nodes of ROS 2 that were started before get nothing any more.
    pytest.mark.alone,
    pytest.mark.skipif(
        not PEER.exists(), reason="no ROS 2 for the tests (PyPI has it for Python 3.11)"
    ),
]


class Program:
    """A program that prints JSON lines; keeps the newest values of each topic."""

    def __init__(self, command: list[str], environment: dict[str, str], log: Path) -> None:
        self.newest: dict[str, list[Any]] = {}
        self._log = log.open("ab")
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            start_new_session=True,
        )
        self._reading = threading.Thread(target=self._read)
        self._reading.start()

    def _read(self) -> None:
        assert self.process.stdout
        for line in self.process.stdout:
            if line.startswith("{"):
                message = json.loads(line)
                self.newest[message["topic"]] = message["values"]

    def waits_for(self, topic: str, values: list[Any]) -> None:
        wait_until(
            lambda: self.newest.get(topic) == values or self.process.poll() is not None,
            f"{values} on {topic}",
            CROSSES,
        )
        assert self.newest.get(topic) == values, "the program has ended"

    def end(self, number: int = signal.SIGINT) -> None:
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            self.process.wait(START)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self._reading.join()
            self._log.close()
            if self.process.stdout:
                self.process.stdout.close()


@pytest.fixture(scope="module")
def domain() -> str:
    """Returns the first of five domains, 2 to 36, which no other file of tests uses.

    Above 100, their ports are among those that the kernel gives to anybody.
    """
    return str(2 + 5 * (os.getpid() % 7))


Start = Callable[..., Program]


@pytest.fixture(scope="module")
def start(domain: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Start]:
    """Yields a function that starts programs beside a master; ends them all."""
    folder = tmp_path_factory.mktemp("door")
    programs: list[Program] = []
    with Master() as master:
        environment = {**master.environment, "ROS_DOMAIN_ID": domain}
        for name in (
            "ROS_AUTOMATIC_DISCOVERY_RANGE",
            "ROS_LOCALHOST_ONLY",
            "ROS_STATIC_PEERS",
            "CYCLONEDDS_URI",
        ):
            environment.pop(name, None)
        alone = {name: value for name, value in environment.items() if name != "PYTHONPATH"}

        def begin(*command: str, plain: bool = False) -> Program:
            program = Program(
                list(command), alone if plain else environment, folder / f"{len(programs)}.log"
            )
            programs.append(program)
            return program

        try:
            yield begin
        finally:
            for program in reversed(programs):
                program.end()


@pytest.fixture(scope="module")
def robot(start: Start) -> Program:
    """Returns ROS 1's side, with the door beside it."""
    program = start("python3", str(HERE / "robot.py"))
    start("rosrun", "pioneer_ros2", "ros2_door")
    return program


@pytest.fixture(scope="module")
def peer(robot: Program, start: Start) -> Program:
    """Returns ROS 2's side."""
    return start(str(PEER), str(HERE / "peer.py"), plain=True)


@pytest.mark.parametrize(
    ("topic", "values"),
    [
        ("/clock", [12, 500]),
        ("/map", [0, 100, -1]),
        ("/pioneer1/base_scan", [1.25, 2.5, "pioneer1/laser"]),
        ("/pioneer2/base_scan", [2.25, 2.5, "pioneer2/laser"]),
        ("/pioneer1/scan", [1.25, 2.5, "laser"]),
        ("/pioneer1/odom", [1.5, "pioneer1/base_link"]),
        ("/pioneer2/odom", [2.5, "pioneer2/base_link"]),
    ],
)
def test_rclpy_receives_what_ros_1_publishes(peer: Program, topic: str, values: list[Any]) -> None:
    peer.waits_for(topic, values)


def test_late_nodes_of_ros_2_get_the_map_however_many_there_are(
    peer: Program, start: Start
) -> None:
    """The third participant of Fast DDS was refused: Cyclone had taken its types as invalid."""
    peer.waits_for("/map", [0, 100, -1])
    for _ in range(2):
        late = start(str(PEER), str(HERE / "peer.py"), plain=True)
        late.waits_for("/map", [0, 100, -1])
        late.end()


def test_velocities_and_goals_of_rclpy_reach_ros_1_under_its_names(
    peer: Program, robot: Program
) -> None:
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])
    robot.waits_for("/pioneer2/map_goal_pose", [3.0, 4.0])


def test_ros_2_lists_the_door_s_node_and_the_types_of_its_topics(peer: Program) -> None:
    peer.waits_for("nodes", ["peer", "pioneer_fleet"])
    peer.waits_for("types", ["tf2_msgs/msg/TFMessage"])


@pytest.mark.parametrize(
    ("topic", "qos", "frames"),
    [
        ("/tf", "reliable", {("map", "pioneer1/odom", 1.0), ("map", "pioneer2/odom", 2.0)}),
        ("/pioneer2/tf", "reliable", {("map", "odom", 2.0)}),
        (
            "/tf_static",
            "latched",
            {
                ("pioneer1/base_link", "pioneer1/laser", 0.1),
                ("pioneer2/base_link", "pioneer2/laser", 0.1),
            },
        ),
        ("/pioneer1/tf_static", "latched", {("base_link", "laser", 0.1)}),
    ],
)
def test_a_reader_of_cyclone_dds_gets_transforms_with_and_without_prefix(
    robot: Program, domain: str, topic: str, qos: str, frames: set[tuple[str, str, float]]
) -> None:
    # A process of its own: Cyclone reads its configuration once a process.
    command = ["python3", str(HERE / "frames.py"), domain, topic, qos]
    done = subprocess.run(command, capture_output=True, text=True, timeout=START, check=False)
    assert done.returncode == 0, done.stderr
    assert {tuple(frame) for frame in json.loads(done.stdout)} == frames


def test_after_a_peer_is_killed_another_one_with_stamped_velocities_is_served(
    peer: Program, robot: Program, start: Start
) -> None:
    peer.end(signal.SIGKILL)
    robot.newest.clear()
    other = start(str(PEER), str(HERE / "peer.py"), "stamped", plain=True)
    other.waits_for("/map", [0, 100, -1])
    other.waits_for("/pioneer1/base_scan", [1.25, 2.5, "pioneer1/laser"])
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])


def test_an_emergency_stop_of_ros_2_holds_a_robot_until_it_is_released(
    robot: Program, start: Start
) -> None:
    start(str(PEER), str(HERE / "peer.py"), plain=True)
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])
    stop = start(str(PEER), str(HERE / "stop.py"), "/pioneer1/estop", "true", plain=True)
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.0, 0.0])
    wait_until(lambda: "/pioneer1/cancelled" in robot.newest, "cancelled goals", CROSSES)
    assert "/pioneer2/cancelled" not in robot.newest
    # The sender may go: only a release lets the robot drive.
    stop.end()
    robot.newest.clear()
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.0, 0.0])
    start(str(PEER), str(HERE / "stop.py"), "/pioneer1/estop", "false", plain=True)
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])


def faults(robot: Program) -> list[str]:
    """Returns the texts of all states that were not in order so far."""
    return [str(values[0]) for name, values in robot.newest.items() if name.startswith("ros2_door")]


def test_other_types_in_ros_2_are_named_and_the_right_ones_go_on(
    robot: Program, start: Start
) -> None:
    right = start(str(PEER), str(HERE / "peer.py"), plain=True)
    odd = start(str(PEER), str(HERE / "odd_peer.py"), "types", plain=True)
    written = "ROS 2 sends std_msgs/String, which does not become geometry_msgs/Twist"
    read = "ROS 2 reads it as std_msgs/String, but it is nav_msgs/Odometry"
    for says in (written, read):
        wait_until(lambda says=says: any(says in one for one in faults(robot)), says, CROSSES)
    robot.newest.clear()
    right.newest.clear()
    robot.waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])
    right.waits_for("/pioneer1/odom", [1.5, "pioneer1/base_link"])
    odd.end()
    right.end()


def test_any_quality_of_service_is_served_or_its_refusal_is_named(
    robot: Program, start: Start
) -> None:
    odd = start(str(PEER), str(HERE / "odd_peer.py"), "qos", plain=True)
    odd.waits_for("/pioneer1/odom", [1.5])
    robot.waits_for("/pioneer1/map_goal_pose", [7.0, 0.0])
    says = "a reader in ROS 2 was refused: it requests another deadline"
    wait_until(lambda: any(says in one for one in faults(robot)), says, CROSSES)
    odd.end()


def test_a_flood_from_ros_2_is_named_and_keeps_no_other_topic_waiting(
    robot: Program, start: Start
) -> None:
    odd = start(str(PEER), str(HERE / "odd_peer.py"), "flood", plain=True)
    robot.waits_for("/pioneer2/pioneer/cmd_vel", [0.125, 0.0])
    says = "messages are dropped"
    wait_until(lambda: any(says in one for one in faults(robot)), says, CROSSES)
    right = start(str(PEER), str(HERE / "peer.py"), plain=True)
    right.waits_for("/map", [0, 100, -1])
    right.waits_for("/pioneer1/base_scan", [1.25, 2.5, "pioneer1/laser"])
    odd.end()
    right.end()


def test_a_domain_that_cannot_be_joined_is_a_state_and_the_door_keeps_trying(
    tmp_path: Path,
) -> None:
    interface = '<Interfaces><NetworkInterface name="nowhere0"/></Interfaces>'
    config = f"<CycloneDDS><Domain><General>{interface}</General></Domain></CycloneDDS>"
    with Master() as master:
        environment = {**master.environment, "CYCLONEDDS_URI": config}
        log = tmp_path / "door.log"
        door = Program(["rosrun", "pioneer_ros2", "ros2_door"], environment, log)
        says = "cannot join the ROS 2 domain"
        try:
            wait_until(lambda: says in log.read_text(), says, CROSSES)
            assert door.process.poll() is None
        finally:
            door.end()
    assert "Traceback" not in log.read_text()


class Site:
    """A master, a robot, the door and a node of ROS 2, each of which can be killed and started again."""

    def __init__(self, group: ProcessGroup, port: int, folder: Path, domain: str) -> None:
        self.master = MasterProcess(group, port, folder)
        self._folder = folder
        self._environment = {**self.master.environment, "ROS_DOMAIN_ID": domain}
        self._programs: dict[str, Program] = {}
        for name in ("robot", "door", "peer"):
            self.start(name)

    def start(self, name: str) -> None:
        """Starts a program; its log is continued."""
        environment = self._environment
        if name == "peer":
            names = environment.keys() - {"PYTHONPATH"}
            environment = {each: environment[each] for each in names}
        commands = {
            "robot": ["python3", str(HERE / "robot.py")],
            "door": ["rosrun", "pioneer_ros2", "ros2_door"],
            "peer": [str(PEER), str(HERE / "peer.py")],
        }
        log = self._folder / f"{name}.log"
        self._programs[name] = Program(commands[name], environment, log)

    def restart(self, name: str) -> None:
        """Kills a program and starts it again. A robot of rospy does not notice a new master: it goes with it."""
        if name == "master":
            self.master.restart()
            name = "robot"
        self._programs[name].end(signal.SIGKILL)
        self.start(name)

    def check(self) -> None:
        """Waits until everything crosses both ways."""
        for program in self._programs.values():
            program.newest.clear()
        peer = self._programs["peer"]
        peer.waits_for("/pioneer1/base_scan", [1.25, 2.5, "pioneer1/laser"])
        self._programs["robot"].waits_for("/pioneer1/pioneer/cmd_vel", [0.25, -0.5])

    def late_node_gets_the_map(self) -> None:
        """Starts the node of ROS 2 again and waits for the latched map."""
        self.restart("peer")
        self._programs["peer"].waits_for("/map", [0, 100, -1])

    def end(self) -> None:
        """Ends everything but the master."""
        for program in reversed(self._programs.values()):
            program.end()
        self.master.stop()


def test_after_a_minute_of_kills_and_restarts_everything_crosses(
    domain: str, tmp_path: Path
) -> None:
    source = random.Random(SEED)
    with ProcessGroup() as group, PortReservation() as ports:
        site = Site(group, ports.take(15311), tmp_path, str(int(domain) + 1))
        try:
            site.check()
            ends = time.monotonic() + KILLS
            while time.monotonic() < ends:
                site.restart(source.choice(("master", "robot", "door", "peer")))
                site.check()
            site.late_node_gets_the_map()
        finally:
            site.end()
    assert "Traceback" not in (tmp_path / "door.log").read_text()


def readers_of(master: Master, topic: str) -> set[str]:
    """Returns the nodes that subscribe to a topic in ROS 1."""
    return set(master.system_state()[1].get(topic, []))


def test_a_topic_is_subscribed_in_ros_1_only_while_ros_2_reads_it(
    domain: str, tmp_path: Path
) -> None:
    topic = "/pioneer1/odom"
    with Master() as master:
        environment = {**master.environment, "ROS_DOMAIN_ID": str(int(domain) + 2)}
        alone = {name: environment[name] for name in environment.keys() - {"PYTHONPATH"}}
        programs = [
            Program(["python3", str(HERE / "robot.py")], environment, tmp_path / "robot.log")
        ]
        try:
            door = Program(
                ["rosrun", "pioneer_ros2", "ros2_door"], environment, tmp_path / "door.log"
            )
            programs.append(door)
            # Latched topics are always read: then the door has looked at the others, too.
            wait_until(lambda: "/ros2_door" in readers_of(master, "/map"), "the map", START)
            assert "/ros2_door" not in readers_of(master, topic)
            peer = Program([str(PEER), str(HERE / "peer.py")], alone, tmp_path / "peer.log")
            programs.append(peer)
            peer.waits_for(topic, [1.5, "pioneer1/base_link"])
            assert "/ros2_door" in readers_of(master, topic)
            peer.end()
            programs.remove(peer)
            wait_until(lambda: "/ros2_door" not in readers_of(master, topic), "its end", START)
        finally:
            for program in reversed(programs):
                program.end()


def test_the_door_ends_at_once_although_a_reader_was_killed(domain: str, tmp_path: Path) -> None:
    """Its writers waited for the reader's answers until the reader's lease had expired, 20 s."""
    with Master() as master:
        environment = {**master.environment, "ROS_DOMAIN_ID": str(int(domain) + 4)}
        alone = {name: environment[name] for name in environment.keys() - {"PYTHONPATH"}}
        robot = Program(["python3", str(HERE / "robot.py")], environment, tmp_path / "robot.log")
        door = Program(["rosrun", "pioneer_ros2", "ros2_door"], environment, tmp_path / "door.log")
        peer = Program([str(PEER), str(HERE / "peer.py")], alone, tmp_path / "peer.log")
        try:
            peer.waits_for("/pioneer1/odom", [1.5, "pioneer1/base_link"])
            peer.end(signal.SIGKILL)
            # More than its writers keep without an answer.
            crossed = time.monotonic() + 2.0
            wait_until(lambda: time.monotonic() > crossed, "messages without an answer", CROSSES)
            began = time.monotonic()
            door.end()
            assert time.monotonic() - began < LEASE / 2
        finally:
            for program in (peer, door, robot):
                program.end()


def test_a_custom_type_crosses_by_the_definition_that_its_publisher_sends(
    domain: str, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text("out: [{topic: /walker/leg}]")
    number = str(int(domain) + 3)
    with Master() as master:
        environment = {**master.environment, "ROS_DOMAIN_ID": number}
        door = ["rosrun", "pioneer_ros2", "ros2_door", f"_rules:={rules}"]
        programs = [
            Program(["python3", str(HERE / "walker.py")], environment, tmp_path / "walker.log"),
            Program(door, environment, tmp_path / "door.log"),
        ]
        try:
            command = ["python3", str(HERE / "leg.py"), number, "/walker/leg"]
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=START, check=False
            )
        finally:
            for program in reversed(programs):
                program.end()
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == ["left", [0.5, -0.25], [1, 2, 3]]


@pytest.mark.parametrize(
    ("environment", "parameters", "says"),
    [
        ({"ROS_DOMAIN_ID": "many"}, [], "ROS_DOMAIN_ID must be a number from 0 to 232, not 'many'"),
        ({}, ["_rules:=/nowhere.yaml"], "cannot read the rules /nowhere.yaml"),
    ],
)
def test_what_the_door_cannot_use_ends_it_with_one_line(
    environment: dict[str, str], parameters: list[str], says: str
) -> None:
    with Master() as master:
        command = ["rosrun", "pioneer_ros2", "ros2_door", *parameters]
        everything = {**master.environment, **environment}
        done = subprocess.run(
            command, env=everything, capture_output=True, text=True, timeout=START, check=False
        )
    assert done.returncode == 1
    assert says in done.stderr
    assert "Traceback" not in done.stderr
