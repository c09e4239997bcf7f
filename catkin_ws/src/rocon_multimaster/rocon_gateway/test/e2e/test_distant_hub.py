"""A hub that another machine announces by mDNS, to gateways with and without a credential."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import redis
from gateway_msgs import msg, srv

from pioneer_harness.machine import FarMachine
from pioneer_harness.masters import MasterProcess
from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

NAME = "Intruder's Hub"


@dataclass
class Intruder:
    """A hub and a gateway on the other machine; the gateway flips `/cmd_vel` to the robot."""

    fleet: Any
    uri: str
    site: Any
    client: redis.Redis  #: of the intruder's hub

    def flip(self) -> None:
        rules = [msg.RemoteRule("robot", msg.Rule("publisher", "/cmd_vel", ""))]
        assert self.site.call("flip", srv.Remote, remotes=rules).result == 0

    def gateways(self) -> set[str]:
        """Returns the gateways on the intruder's hub."""
        return set(self.client.smembers("rocon:gateways"))


@pytest.fixture
def intruder(fleet, machine: FarMachine) -> Iterator[Intruder]:
    port = fleet.ports.take(19380)
    master = MasterProcess(fleet.group, 11311, fleet.folder, machine.there, machine.prefix)
    master.set_param("/hub", {"name": NAME, "port": port, "insecure": True, "zeroconf": True})
    argv = [*machine.prefix, "rosrun", "rocon_hub", "hub"]
    fleet.group.start("intruder hub", argv, master.environment, fleet.folder / "intruder_hub.log")
    uri = f"http://{machine.there}:{port}"
    site = fleet.site("intruder", master, machine.prefix)
    site.start(hub_uri=uri, insecure=True).connected()
    site.talk("/cmd_vel")
    client = redis.Redis(machine.there, port, decode_responses=True)
    yield Intruder(fleet, uri, site, client)
    client.close()


def on_its_own_hub(intruder: Intruder, **parameters: Any) -> Any:
    """Starts the robot's gateway without a credential; waits until it is on the hub of its machine."""
    fleet = intruder.fleet
    fleet.start_hub(zeroconf=True)
    robot = fleet.site("robot")
    robot.start(hub_uri="", **parameters).connected()
    intruder.flip()
    return robot


def sees_the_intruder(robot: Any) -> bool:
    return NAME in robot.log.read_text()


def test_an_announced_hub_of_another_machine_drives_no_robot_without_a_credential(
    intruder: Intruder,
) -> None:
    """Such a hub once flipped velocities into a gateway that was on its own hub on the loopback."""
    robot = on_its_own_hub(intruder, hub_whitelist=[intruder.fleet.hub_name, NAME])
    wait_until(lambda: sees_the_intruder(robot), "the announcement's refusal", 60)
    assert robot.info().hub_names == [intruder.fleet.hub_name]
    assert robot.publishers("/cmd_vel") == []
    assert intruder.gateways() == {"intruder"}
    assert robot.log.read_text().count("is on another machine and is not joined") == 1


@pytest.mark.parametrize("how", ["insecure", "whitelist"])
def test_one_whose_address_is_named_or_where_the_user_insists_is_joined(
    intruder: Intruder, how: str
) -> None:
    """This shows that the attack of the other test would succeed."""
    own = intruder.fleet.hub_name
    parameters: dict[str, Any] = {"hub_whitelist": [own, intruder.uri]}
    if how == "insecure":
        parameters = {"hub_whitelist": [own, NAME], "insecure": True}
    robot = on_its_own_hub(intruder, **parameters)
    wait_until(lambda: len(robot.info().hub_names) == 2, "the announced hub", 60)
    wait_until(lambda: "robot" in intruder.gateways(), "the record there", 10)
    if how == "insecure":
        wait_until(lambda: robot.publishers("/cmd_vel"), "the intruder's flip", START)
