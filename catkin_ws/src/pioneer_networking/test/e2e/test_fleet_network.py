"""The tutorial's network, started by its commands: hub, Hub_Gateway, a robot, and the rules of rocon_flip."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rosgraph

from pioneer_harness.masters import Master
from pioneer_harness.port import PortReservation
from pioneer_harness.proc import arguments
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from rocon_launch.concert import SHORT_LIFE

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

PATIENCE = 90.0
"""Longest wait for anything [s]; on a busy machine a roslaunch alone takes 20 s."""

# A typical client: users of a gateway rely on these imports and request objects.
CLIENT = """
import rospy
import gateway_msgs.msg as gateway_msgs
import gateway_msgs.srv as gateway_srvs
import rocon_gateway
rospy.init_node("client")
rospy.wait_for_service("/gateway/pull")
request = gateway_srvs.RemoteRequest()
request.cancel = False
request.remotes = []
rule = gateway_msgs.Rule()
rule.name = "/chatter"
rule.type = gateway_msgs.ConnectionType.PUBLISHER
request.remotes.append(gateway_msgs.RemoteRule("Hub_Gateway", rule))
answer = rospy.ServiceProxy("/gateway/pull", gateway_srvs.Remote)(request)
raise SystemExit(answer.result)
"""


class Network:
    def __init__(self, folder: Path) -> None:
        self.folder, self.group, self.ports, self.robot = (
            folder,
            ProcessGroup(),
            PortReservation(),
            Master(),
        )
        self.hub_port, hub_master, gateway_master = (
            self.ports.take(port) for port in (18380, 18311, 18312)
        )
        self.base = f"http://127.0.0.1:{gateway_master}"
        self.environment = {**os.environ, "ROS_IP": "127.0.0.1", "ROS_HOME": str(folder / "home")}
        # Differs from every other hub that is currently announced on this machine.
        self.hub_name = f"Pioneer Hub {self.hub_port}"
        arguments = (
            f"hub_name:={self.hub_name}",
            f"hub_port:={self.hub_port}",
            f"hub_master_port:={hub_master}",
            f"gateway_master_port:={gateway_master}",
        )
        self.pid = self.start(
            "hub", ["rosrun", "pioneer_networking", "run-pioneer-hub", *arguments]
        )

    def start(self, name: str, argv: list[str], may_end: bool = False, **environment: str) -> int:
        return self.group.start(
            name,
            argv,
            {**self.environment, **environment},
            self.folder / f"{name}.log",
            may_end=may_end,
        )

    def start_robot(self) -> None:
        argv = ["rosrun", "rocon_gateway", "gateway"]
        parameters = {"name": "aadi1_gateway", "disable_uuids": True, "firewall": False}
        self.robot.set_param(
            "/gateway", {**parameters, "hub_uri": f"http://127.0.0.1:{self.hub_port}"}
        )
        self.start("robot", argv, **self.at_robot)

    @property
    def at_robot(self) -> dict[str, str]:
        return {"ROS_MASTER_URI": self.robot.uri, "ROBOT_NAME": "pioneer1"}

    @property
    def at_base(self) -> dict[str, str]:
        return {"ROS_MASTER_URI": self.base}

    def run(self, name: str, argv: list[str], **environment: str) -> str:
        """Runs a command to its end and returns its output; a failure counts as a death in the group."""
        self.start(name, argv, True, **environment)
        wait_until(lambda: not self.group.is_running(name), f"{name}'s end", PATIENCE)
        self.group.check()
        return (self.folder / f"{name}.log").read_text()

    def published_at_base(self) -> list[str]:
        try:
            return [
                topic
                for topic, _ in rosgraph.Master("/test", master_uri=self.base).getSystemState()[0]
            ]
        except OSError:
            return []

    def pid_of(self, node: str) -> int | None:
        """Returns the PID of a base station node, or None if it is not running."""
        alive = [one.pid for one in self.group.states().values() if one.alive]
        found = [pid for pid in alive if f"__name:={node}" in arguments(pid)]
        return found[0] if found else None

    def close(self) -> None:
        self.group.stop()
        self.robot.stop()
        self.ports.release()


@pytest.fixture
def network(tmp_path: Path) -> Iterator[Network]:
    made = Network(tmp_path)
    yield made
    made.close()


def test_the_scripts_connect_the_fleet_in_any_order_and_twice(network: Network) -> None:
    network.start("flip", ["rosrun", "rocon_flip", "flip-from-remote"], True, **network.at_robot)
    network.start(
        "advertise", ["rosrun", "rocon_flip", "advertise-from-hub"], True, **network.at_base
    )
    network.start_robot()
    network.run("pull", ["rosrun", "rocon_flip", "pull-from-hub"], **network.at_robot)
    wait_until(
        lambda: not any(map(network.group.is_running, ("flip", "advertise"))),
        "both scripts' end",
        PATIENCE,
    )
    network.group.check()
    again = network.run("again", ["rosrun", "rocon_flip", "flip-from-remote"], **network.at_robot)
    assert again.count("already exists and stays active") == 3

    clock = ["rostopic", "pub", "-r", "20", "/clock", "rosgraph_msgs/Clock", "{}"]
    network.start("clock", clock, **network.at_base)
    command = [
        "rostopic",
        "pub",
        "-r",
        "20",
        "/pioneer1/pioneer/cmd_vel",
        "geometry_msgs/Twist",
        "{}",
    ]
    network.start("command", command, **network.at_robot)
    wait_until(
        lambda: "/pioneer1/pioneer/cmd_vel" in network.published_at_base(),
        "cmd_vel at the base",
        PATIENCE,
    )
    wait_until(lambda: "/clock" in network.robot.system_state()[0], "/clock at the robot", PATIENCE)


def test_the_tutorials_second_step_needs_nothing_but_the_hosts_name(network: Network) -> None:
    gateway = ["roslaunch", "pioneer_networking", "pioneer_gateway.launch"]
    # Only the name distinguishes the test's hub from others that run on this machine.
    gateway.append(f"gateway_hub_whitelist:=['{network.hub_name}']")
    network.start("gateway", gateway, **network.at_robot, HOSTNAME="aadi1", GATEWAY_HUB_URI="")
    log = network.folder / "gateway.log"
    wait_until(
        lambda: f"on hub '{network.hub_name}'" in log.read_text(),
        "the robot's gateway on the hub",
        PATIENCE,
    )
    assert "as 'aadi1_gateway'" in log.read_text()


def test_the_handshake_pair_proves_both_ways(network: Network) -> None:
    network.start_robot()
    network.start("receiver", ["roslaunch", "rocon_flip", "receiver.launch"], **network.at_base)
    said = network.run("sender", ["roslaunch", "rocon_flip", "sender.launch"], **network.at_robot)
    assert "handshake with Hub_Gateway: 10 messages there and back" in said
    assert "Cancel Flip" in said


def test_a_client_written_for_rocon_works(network: Network) -> None:
    network.start_robot()
    network.run("wait", ["rosrun", "rocon_flip", "pull-from-hub"], **network.at_robot)
    network.run("client", ["python3", "-c", CLIENT], **network.at_robot)


def test_interrupting_the_concert_ends_all_of_it(network: Network) -> None:
    wait_until(
        lambda: "/gateway/gateway_info" in network.published_at_base(), "Hub_Gateway", PATIENCE
    )
    os.kill(network.pid, signal.SIGINT)
    wait_until(
        lambda: not [one for one in network.group.states().values() if one.alive],
        "everything's end",
        PATIENCE,
    )


def test_a_hub_that_is_killed_comes_back_and_its_gateway_stays(network: Network) -> None:
    log = network.folder / "hub.log"
    wait_until(
        lambda: f"on hub '{network.hub_name}'" in log.read_text(),
        "Hub_Gateway on its hub",
        PATIENCE,
    )
    hub, gateway = network.pid_of("hub"), network.pid_of("gateway")
    born = time.monotonic()
    wait_until(
        lambda: time.monotonic() - born > SHORT_LIFE,
        "a hub that has stayed a while",
        2 * SHORT_LIFE,
    )
    os.kill(hub, signal.SIGKILL)
    wait_until(
        lambda: log.read_text().count(f"on hub '{network.hub_name}'") == 2,
        "Hub_Gateway on the next",
        PATIENCE,
    )
    assert "starting it again" in log.read_text()
    assert network.pid_of("hub") != hub
    assert network.pid_of("gateway") == gateway


def test_with_its_gateway_the_concert_ends(network: Network) -> None:
    gateway = wait_until(lambda: network.pid_of("gateway"), "Hub_Gateway", PATIENCE)
    os.kill(gateway, signal.SIGKILL)
    wait_until(
        lambda: not [one for one in network.group.states().values() if one.alive],
        "everything's end",
        PATIENCE,
    )
    assert "everything ends with it" in (network.folder / "hub.log").read_text()
    # The ended process may not have been reaped yet.
    (death,) = wait_until(
        lambda: network.group.deaths, "the report of the process that ended", PATIENCE
    )
    assert "ended, status 1" in str(death)
