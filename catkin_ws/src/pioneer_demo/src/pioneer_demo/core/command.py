"""The tutorial's commands, as one machine runs them side by side."""

import dataclasses
from collections.abc import Mapping, Sequence

from pioneer_demo.core.option import FleetConfig

HUB_MASTER, HUB_GATEWAY_MASTER, FIRST_ROBOT_MASTER, HUB = 11311, 11312, 11313, 6380
_LOOPBACK = "127.0.0.1"


@dataclasses.dataclass(frozen=True)
class Ports:
    """Where everything listens: the hub's redis and master, the hub gateway's master, one master a robot."""

    hub: int
    hub_master: int
    hub_gateway_master: int
    robot_masters: Sequence[int]

    @property
    def are_the_tutorials(self) -> bool:
        """Whether all are those of the tutorial."""
        robots = range(FIRST_ROBOT_MASTER, FIRST_ROBOT_MASTER + len(self.robot_masters))
        wanted = Ports(HUB, HUB_MASTER, HUB_GATEWAY_MASTER, tuple(robots))
        return dataclasses.replace(self, robot_masters=tuple(self.robot_masters)) == wanted

    def __str__(self) -> str:
        robots = ", ".join(map(str, self.robot_masters))
        return f"hub {self.hub}, masters: hub {self.hub_master}, Hub_Gateway {self.hub_gateway_master}, robots {robots}"


@dataclasses.dataclass(frozen=True)
class Command:
    """A process to start: its name in messages, its command line, and what its environment has more than ours."""

    name: str
    argv: tuple[str, ...]
    environment: Mapping[str, str]


def commands(config: FleetConfig, ports: Ports) -> list[Command]:
    """Returns what runs on the hub computer, in the hub gateway's terminal, and on each robot computer."""
    shared = {
        "ROS_IP": _LOOPBACK,
        "ROBOTS": str(config.robots),
        "FLEET": str(config.fleet or ""),
        "WORLD": config.world,
        "GATEWAY_HUB_URI": f"http://{_LOOPBACK}:{ports.hub}",
    }
    found = [
        _launch("hub", ports.hub_master, ("pioneer_hub.launch", f"hub_port:={ports.hub}"), shared),
        _launch(
            "Hub_Gateway",
            ports.hub_gateway_master,
            ("pioneer_gateway.launch", "gateway_name:=Hub_Gateway", "gateway_disable_zeroconf:=true"),
            shared,
        ),
        _run(
            "simulator",
            ports.hub_gateway_master,
            (
                "run-multi-pioneer-gazebo-master",
                f"world_name:={config.world}",
                f"robots:={config.robots}",
                f"real_time_factor:={config.real_time_factor:g}",
                f"seed:={config.seed}",
                "skip:=false",
            ),
            shared,
        ),
    ]
    for number, (name, port) in enumerate(zip(config.names, ports.robot_masters, strict=True), 1):
        own = {**shared, "HOSTNAME": f"aadi{number}", "ROBOT_NAME": name}
        gateway = ("pioneer_gateway.launch", "gateway_disable_zeroconf:=true")
        found += [
            _launch(gateway_name(number), port, gateway, own),
            _run(
                f"navigation of {name}", port, ("run-pioneer-nav-local", f"traffic:={str(config.traffic).lower()}"), own
            ),
        ]
    return found


def gateway_name(number: int) -> str:
    """Returns the name of a robot's gateway, counted from 1."""
    return f"aadi{number}_gateway"


def master_uri(port: int) -> str:
    """Returns the address of a ROS master of this machine."""
    return f"http://{_LOOPBACK}:{port}"


def _launch(name: str, port: int, words: tuple[str, ...], environment: Mapping[str, str]) -> Command:
    argv = ("roslaunch", "--no-summary", "-p", str(port), "pioneer_networking", *words)
    return Command(name, argv, {**environment, "ROS_MASTER_URI": master_uri(port)})


def _run(name: str, port: int, words: tuple[str, ...], environment: Mapping[str, str]) -> Command:
    argv = ("rosrun", "pioneer_gazebo", *words)
    return Command(name, argv, {**environment, "ROS_MASTER_URI": master_uri(port)})
