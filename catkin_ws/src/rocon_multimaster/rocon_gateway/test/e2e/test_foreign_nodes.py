"""Nodes and tools of other packages and other set-ups across masters."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from pioneer_harness.machine import MachineError
from pioneer_harness.masters import MasterProcess
from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

HERE = Path(__file__).parent
AHEAD = 2.0
"""How far the robot's clock is ahead of the base station's [s]."""


def run(site, *argv: str, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    """Runs a program at a site and waits for it."""
    return subprocess.run(
        argv,
        env=site.master.environment,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )


def test_dynamic_reconfigure_works_across_masters(fleet, pair) -> None:
    base, robot = pair
    argv = [sys.executable, str(HERE / "configured_node.py")]
    log = fleet.folder / "configured.log"
    fleet.group.start("configured", argv, robot.master.environment, log)
    assert robot.flip("base", "service", "/configured/set_parameters") == 0
    assert robot.flip("base", "publisher", "/configured/parameter_.*") == 0
    topics = ["/configured/parameter_descriptions", "/configured/parameter_updates"]
    wait_until(lambda: all(map(base.publishers, topics)), "the node's topics", START)
    wait_until(
        lambda: "/configured/set_parameters" in base.master.system_state()[2], "its service", 10
    )
    dynparam = ("rosrun", "dynamic_reconfigure", "dynparam")
    assert run(base, *dynparam, "list").stdout.split() == ["/configured"]
    done = run(base, *dynparam, "set", "/configured", "int_", "7")
    assert done.returncode == 0, done.stderr
    assert robot.master.proxy().getParam("/configured/int_") == 7
    done = run(robot, *dynparam, "set", "/configured", "str_", "robot")
    assert done.returncode == 0, done.stderr
    found = yaml.safe_load(run(base, *dynparam, "get", "/configured").stdout)
    assert (found["int_"], found["str_"]) == (7, "robot")


def test_roswtf_finds_no_fault_in_a_gateways_proxies(pair) -> None:
    if not shutil.which("roswtf"):
        pytest.skip("roswtf is not installed: apt install python3-roswtf")
    base, robot = pair
    robot.talk("/chatter")
    ear = base.hear("/chatter")
    assert base.flip("robot", "subscriber", "/chatter") == 0
    ear.first_after(0.0)
    report = run(base, "roswtf", timeout=120).stdout
    assert "/robot/talker" not in report, report


def test_a_robot_whose_clock_is_ahead_keeps_its_rules_and_the_doctor_says_so(fleet) -> None:
    if not shutil.which("faketime"):
        pytest.skip("faketime is not installed: apt install faketime")
    fleet.start_hub()
    base = fleet.site("base").start().connected()
    # Only the gateway: with faketime, Python's time.sleep fails, which rospy calls.
    ahead = ("env", "FAKETIME_DONT_FAKE_MONOTONIC=1", "faketime", "-f", f"+{AHEAD}s")
    robot = fleet.site("robot", prefix=ahead).start().connected()
    base.talk("/command")
    assert base.flip("robot", "publisher", "/command") == 0
    wait_until(lambda: base.states()["flip /command"] == "active", "active", 10)
    examined = run(base, "rosrun", "rocon_gateway", "doctor").stdout
    (line,) = [line for line in examined.splitlines() if "that at gateway 'robot'" in line]
    assert "behind that at gateway 'robot'" in line
    assert float(line.split("clock is ")[1].split(" s ")[0]) == pytest.approx(AHEAD, abs=0.3)
    assert "chrony" in examined
    assert (base.info().connected, robot.info().connected) == (True, True)


IPV6_LOOPBACK = f"{1:032x} "
"""::1, as Linux lists it. Docker gives containers none by default, though their kernel has IPv6."""


def test_a_node_with_an_ipv6_address_only_has_a_rule_that_says_why(fleet, pair) -> None:
    addresses = Path("/proc/net/if_inet6")
    if not addresses.exists() or IPV6_LOOPBACK not in addresses.read_text():
        pytest.skip("this machine has no IPv6")
    base, robot = pair
    environment = {**robot.master.environment, "ROS_IPV6": "on", "ROS_IP": "::1"}
    environment.pop("ROS_HOSTNAME", None)
    argv = [sys.executable, str(HERE / "probe.py"), "talk", "six", "/six"]
    fleet.group.start("six", argv, environment, fleet.folder / "six.log", may_end=True)
    wait_until(lambda: robot.publishers("/six") == ["/six"], "the node", START)
    assert base.flip("robot", "subscriber", "/six") == 0
    base.hear("/six")
    wait_until(
        lambda: "::1 has an IPv6 address only" in base.states()["flip /six"], "the reason", 10
    )
    assert base.states()["flip /six"].startswith("no publisher")


NEAR, INSIDE = "10.231.79.1", "10.231.79.2"
"""Addresses of a network behind a router: the router's and a computer's."""

MASTER_PORT = 11311


@pytest.fixture
def inside(machine) -> Iterator[tuple[str, ...]]:
    """A computer behind `machine`, which translates addresses and publishes a port, as Docker does.

    Gives the command prefix that runs a command there.
    """
    name = f"{machine.name}-inside"
    prefix = ("ip", "netns", "exec", name)
    nat = ("iptables", "-t", "nat", "-A")
    published = f"{INSIDE}:{MASTER_PORT}"
    subprocess.run(["ip", "netns", "add", name], check=True)
    try:
        machine.run(
            "ip", "link", "add", "in", "type", "veth", "peer", "name", "eth0", "netns", name
        )
        machine.run("ip", "address", "add", f"{NEAR}/30", "dev", "in")
        machine.run("ip", "link", "set", "in", "up")
        machine.run(*prefix, "ip", "address", "add", f"{INSIDE}/30", "dev", "eth0")
        machine.run(*prefix, "ip", "link", "set", "eth0", "up")
        machine.run(*prefix, "ip", "link", "set", "lo", "up")
        machine.run(*prefix, "ip", "route", "add", "default", "via", NEAR)
        machine.run("sysctl", "-q", "-w", "net.ipv4.ip_forward=1")
        machine.run(*nat, "POSTROUTING", "-s", INSIDE, "-o", "eth0", "-j", "MASQUERADE")
        port = ("-p", "tcp", "--dport", str(MASTER_PORT))
        machine.run(
            *nat, "PREROUTING", "-i", "eth0", *port, "-j", "DNAT", "--to-destination", published
        )
    except MachineError as error:
        pytest.skip(f"NAT is not tested here: {error}")
    else:
        yield prefix
        machine.run("iptables", "-t", "nat", "-F")
    finally:
        # The cable between them goes with it.
        subprocess.run(["ip", "netns", "delete", name], capture_output=True, check=False)


def test_a_gateway_behind_nat_receives_and_says_that_it_cannot_be_reached(
    inside: tuple[str, ...], fleet, machine
) -> None:
    """Connections from inside Docker's NAT, or a router's, work; none gets in to the relay."""
    fleet.hub_uri = f"http://{machine.here}:{fleet.hub_port}"
    fleet.start_hub(insecure=True)
    # Of the computer inside, only the master can be reached: its port is published.
    master = MasterProcess(fleet.group, MASTER_PORT, fleet.folder, machine.there, inside)
    master.environment.update(ROS_IP="127.0.0.1", ROS_MASTER_URI=f"http://127.0.0.1:{MASTER_PORT}/")
    base, robot = fleet.site("base"), fleet.site("robot", master, inside)
    base.start({"ROS_IP": machine.here}, insecure=True).connected()
    robot.start(insecure=True)
    base.talk("/command")
    robot.talk("/sensor")
    assert base.flip("robot", "publisher", "/command") == 0
    assert base.flip("robot", "subscriber", "/sensor") == 0
    robot.hear("/command").first_after(0.0, timeout=START)
    wait_until(lambda: base.states()["flip /command"] == "active", "active", 10)
    wait_until(
        lambda: base.states()["flip /sensor"].startswith(f"unreachable: robot at {INSIDE}"),
        "the rule to be unreachable",
        15,
    )
