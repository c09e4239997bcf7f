"""The tutorial's commands, adapted to run in parallel on one machine."""

import dataclasses
import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pioneer_demo.scenario.option import FleetConfig
from pioneer_fleet.recording.disk import free_name
from pioneer_node.core.fleet_file import RobotEntry

HUB_MASTER, HUB_GATEWAY_MASTER, FIRST_ROBOT_MASTER, HUB = 11311, 11312, 11313, 6380
HUB_COMMAND, HUB_GATEWAY_COMMAND = "hub", "Hub_Gateway"
PAGE_COMMAND, RECORDER_COMMAND, DOOR_COMMAND = "fleet page", "recorder", "door to ROS 2"
WATCHERS = (PAGE_COMMAND, RECORDER_COMMAND, DOOR_COMMAND)
"""Commands that the robots need not: they drive on without them."""
PAGE = 8090
_LOOPBACK = "127.0.0.1"
FLEET, ROBOT_PARAMETERS, SIMULATOR_PARAMETERS = (
    "fleet.yaml",
    "robot_parameters.yaml",
    "simulator_parameters.yaml",
)


@dataclasses.dataclass(frozen=True)
class Ports:
    """TCP ports of a fleet: the hub's Redis and master, the hub gateway's master, one master per robot, the page."""

    hub: int
    hub_master: int
    hub_gateway_master: int
    robot_masters: tuple[int, ...]
    page: int = PAGE

    @classmethod
    def taken(cls, robots: int, take: Callable[[int], int]) -> "Ports":
        """Returns the ports of a fleet; ``take`` returns a port for each of the tutorial's."""
        masters = range(FIRST_ROBOT_MASTER, FIRST_ROBOT_MASTER + robots)
        return cls(
            take(HUB),
            take(HUB_MASTER),
            take(HUB_GATEWAY_MASTER),
            tuple(map(take, masters)),
            take(PAGE),
        )

    @property
    def are_the_tutorials(self) -> bool:
        """Whether all ports, but for the page's, are those of the tutorial."""
        return dataclasses.replace(self, page=PAGE) == Ports.taken(len(self.robot_masters), int)

    def __str__(self) -> str:
        robots = ", ".join(map(str, self.robot_masters))
        return f"hub {self.hub}, masters: hub {self.hub_master}, Hub_Gateway {self.hub_gateway_master}, robots {robots}"


@dataclasses.dataclass(frozen=True)
class Command:
    """A process to start: its name in messages, its command line, and its additional environment variables."""

    name: str
    argv: tuple[str, ...]
    environment: Mapping[str, str]


def commands(config: FleetConfig, ports: Ports) -> list[Command]:
    """Returns all commands of a fleet: of the hub, the hub gateway, and each robot's computer."""
    shared = {
        "ROS_IP": _LOOPBACK,
        "ROBOTS": str(config.robots),
        "FLEET": str(config.fleet or ""),
        "WORLD": config.world,
        "GATEWAY_HUB_URI": f"http://{_LOOPBACK}:{ports.hub}",
    }

    def at(port: int, **own: str) -> dict[str, str]:
        return {**shared, **own, "ROS_MASTER_URI": master_uri(port)}

    base = at(ports.hub_gateway_master)
    quiet = "gateway_disable_zeroconf:=true"
    hub = _launch(ports.hub_master, "pioneer_hub.launch", f"hub_port:={ports.hub}")
    gateway = _launch(
        ports.hub_gateway_master, "pioneer_gateway.launch", "gateway_name:=Hub_Gateway", quiet
    )
    simulator = (
        *("rosrun", "pioneer_gazebo", "run-multi-pioneer-gazebo-master"),
        f"world_name:={config.world}",
        f"robots:={config.robots}",
        f"real_time_factor:={'lockstep' if config.lockstep else f'{config.real_time_factor:g}'}",
        *((f"lockstep_rings:={' '.join(config.rings)}",) if config.rings else ()),
        f"seed:={config.seed}",
        *(() if config.noise == "described" else (f"noise:={config.noise}",)),
        "skip:=false",
        *_parameters(config, SIMULATOR_PARAMETERS),
    )
    found = [
        Command(HUB_COMMAND, hub, at(ports.hub_master)),
        Command(HUB_GATEWAY_COMMAND, gateway, base),
        Command("simulator", simulator, base),
    ]
    if config.web:
        masters = " ".join(named_masters(ports))
        page = (
            "rosrun",
            "pioneer_web",
            "fleet_page",
            f"_port:={ports.page}",
            f"_masters:={masters}",
        )
        found.append(Command(PAGE_COMMAND, page, {**base, "PIONEER_WEB_TOKEN": config.token}))
    if config.ros2:
        robots = f"robots:={' '.join(config.names)}"
        wait = ("rosrun", "rocon_launch", "roslaunch", "--no-summary", "--wait")
        door = (*wait, "pioneer_ros2", "ros2_fleet.launch", robots)
        found.append(Command(DOOR_COMMAND, door, base))
    navigation = (
        *("rosrun", "pioneer_gazebo", "run-pioneer-nav-local"),
        f"traffic:={str(config.traffic).lower()}",
        *(("real_time_factor:=lockstep",) if config.lockstep else ()),
        *_parameters(config, ROBOT_PARAMETERS),
    )
    for number, (name, port) in enumerate(zip(config.names, ports.robot_masters, strict=True), 1):
        kept = config.log.absolute() / "ros"
        # With this file amcl recovers its pose after its computer was killed ...
        files = {"AMCL_CORRECTION_FILE": str(kept / f"{name}-correction.json")}
        if config.restarts_nodes:
            # ... and with this one the waypoint client its waypoints.
            files["WAYPOINT_QUEUE_FILE"] = str(kept / f"{name}-waypoints.json")
        own = at(port, HOSTNAME=f"aadi{number}", ROBOT_NAME=name, **files)
        gateway = _launch(port, "pioneer_gateway.launch", quiet)
        found += [
            Command(gateway_name(number), gateway, own),
            Command(f"navigation of {name}", navigation, own),
        ]
        for index, line in enumerate(config.programs, 1):
            words = tuple(word.replace("{robot}", name) for word in shlex.split(line))
            argv = ("python3", "-m", "pioneer_demo.processes.program", *words)
            found.append(Command(f"program {index} of {name}", argv, own))
    if config.record is not None:
        recorder = (
            "python3",
            "-m",
            "pioneer_fleet.recording.recorder",
            str(config.record.absolute()),
        )
        options = [f"--topics={pattern}" for pattern in config.record_topics]
        if config.record_split:
            options.append(f"--split={config.record_split}")
        argv = (*recorder, *named_masters(ports), *options)
        found.append(Command(RECORDER_COMMAND, argv, {}))
    return found


def named_masters(ports: Ports) -> list[str]:
    """Returns NAME=URI of each master."""
    named = [("hub", ports.hub_master), ("base", ports.hub_gateway_master)]
    named += [(f"aadi{number}", port) for number, port in enumerate(ports.robot_masters, 1)]
    return [f"{name}={master_uri(port)}" for name, port in named]


def started_again(command: Command) -> Command:
    """Returns the command that replaces one that has ended: a recorder writes NAME-2, NAME-3, …; its file stays."""
    if command.name != RECORDER_COMMAND:
        return command
    *words, text = command.argv[:4]
    free = free_name(Path(text))
    return dataclasses.replace(command, argv=(*words, str(free), *command.argv[4:]))


def restarted_together(config: FleetConfig, name: str) -> list[str]:
    """Returns the commands that are started again when one of them ends; empty if its end is the fleet's.

    A robot's computer starts again as a whole: its nodes are registered at a master that has ended with the command.
    """
    if name in WATCHERS:
        return [name]
    if not config.restarts_nodes or config.rings:
        return []
    if name == HUB_COMMAND:
        return [name]
    for robot in config.names:
        together = on_computer(config, robot)
        if name in together:
            return together
    return []


def written_files(config: FleetConfig) -> dict[str, Any]:
    """Returns the contents, by name, of the files in the log folder that the commands read."""
    files = dict[str, Any]()
    if config.entries:
        fields = [field.name for field in dataclasses.fields(RobotEntry)]
        files[FLEET] = {
            "robots": [{name: getattr(one, name) for name in fields} for one in config.entries]
        }
    own = {name: value for name, value in config.parameters.items() if not name.startswith("/")}
    rest = {name: value for name, value in config.parameters.items() if name.startswith("/")}
    return {
        **files,
        **{
            name: said
            for name, said in ((ROBOT_PARAMETERS, own), (SIMULATOR_PARAMETERS, rest))
            if said
        },
    }


def on_computer(config: FleetConfig, robot: str) -> list[str]:
    """Returns the names of the commands that run on a robot's computer."""
    number = config.names.index(robot) + 1
    programs = [f"program {index} of {robot}" for index in range(1, len(config.programs) + 1)]
    return [gateway_name(number), f"navigation of {robot}", *programs]


def _parameters(config: FleetConfig, name: str) -> tuple[str, ...]:
    return (f"parameters:={config.log.absolute() / name}",) if name in written_files(config) else ()


def gateway_name(number: int) -> str:
    """Returns the name of a robot's gateway; ``number`` counts from 1."""
    return f"aadi{number}_gateway"


def master_uri(port: int) -> str:
    """Returns the URI of a ROS master on this machine."""
    return f"http://{_LOOPBACK}:{port}"


def _launch(port: int, *words: str) -> tuple[str, ...]:
    return (
        "rosrun",
        "rocon_launch",
        "roslaunch",
        "--no-summary",
        "-p",
        str(port),
        "pioneer_networking",
        *words,
    )
