"""`doctor`: checks every link from every gateway and reports each fault with its location and its fix."""

import os
import signal
import subprocess

import pytest
import redis

from pioneer_harness.machine import MachineError
from pioneer_harness.masters import MasterProcess
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.fixture(scope="module")
def three(machine, shared_fleet):
    """Two gateways here and one on another machine, which can reach the hub and whatever the tests allow."""
    fleet = shared_fleet
    fleet.hub_uri = f"http://{machine.here}:{fleet.hub_port}"
    fleet.start_hub(insecure=True)
    master = MasterProcess(fleet.group, 11311, fleet.folder, machine.there, machine.prefix)
    base, second = fleet.site("base"), fleet.site("second")
    far = fleet.site("far", master, machine.prefix)
    for site, environment in (
        (base, {"ROS_IP": machine.here}),
        (second, {"ROS_IP": machine.here}),
        (far, None),
    ):
        site.start(environment, insecure=True).connected()
    return base, second, far


def doctor(site, *argv: str, uri: str = "") -> tuple[int, str]:
    environment = {**site.master.environment, **({"ROS_MASTER_URI": uri} if uri else {})}
    done = subprocess.run(
        ["rosrun", "rocon_gateway", "doctor", *argv],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
    )
    return done.returncode, done.stdout + done.stderr


def row(said: str, name: str) -> list[str]:
    """Returns the cells of a gateway's row in the table."""
    (line,) = [
        one for one in said.splitlines() if one.split()[1:2] == [name] or one.split()[:1] == [name]
    ]
    cells = line.split()
    return cells[cells.index(name) + 1 :]


def test_every_gateway_looks_at_every_link_and_all_is_well(three, machine) -> None:
    base, _, far = three
    status, said = doctor(base)
    assert status == 0, said
    assert row(said, "base") == ["-", "ok", "ok"]
    assert row(said, "far") == ["ok", "-", "ok"]
    assert row(said, "second") == ["ok", "ok", "-"]
    for site in three:
        assert f"2 relays answer at gateway '{site.name}'" in said
        assert f"that at gateway '{site.name}'" in said
        assert (
            f"the machine's name '{machine.there if site is far else machine.here}' means" in said
        )
    assert all("Traceback" not in site.log.read_text() for site in three)


def test_a_relay_port_that_one_gateway_cannot_reach_is_named_and_no_other(three, machine) -> None:
    base, second, _ = three
    port = second.relay_port()
    rule = ("OUTPUT", "-p", "tcp", "--dport", str(port), "-j", "DROP")
    try:
        machine.run("iptables", "-A", *rule)
    except MachineError as error:
        pytest.skip(f"a port cannot be blocked here: {error}")
    try:
        status, said = doctor(base)
    finally:
        machine.run("iptables", "-D", *rule)
    assert status == 1, said
    assert (row(said, "base"), row(said, "far"), row(said, "second")) == (
        ["-", "ok", "ok"],
        ["ok", "-", "NO"],
        ["ok", "ok", "-"],
    )
    faults = [line for line in said.splitlines() if line.startswith("fault")]
    assert faults == [
        f"fault    gateway 'second', seen at gateway 'far', at {machine.here}:{port}: no answer"
    ]
    assert f"→ let TCP port {port} through the firewall of {machine.here}" in said


def test_a_gateway_that_does_not_answer_is_a_finding_and_costs_a_bounded_time(
    three, shared_fleet, machine
) -> None:
    base, second, _ = three
    client = redis.Redis(machine.here, shared_fleet.hub_port)
    silent = shared_fleet.family(second.pid)
    shared_fleet.signal(silent, signal.SIGSTOP)
    try:
        # Simulates a frozen gateway whose heartbeat has not expired yet, by extending the expiry.
        client.set("rocon:alive:second", client.get("rocon:alive:second") or b"x", px=60_000)
        status, said = doctor(base)
    finally:
        shared_fleet.signal(silent, signal.SIGCONT)
        client.close()
    assert status == 1, said
    assert row(said, "second") == ["?", "?", "?"]
    assert "fault    gateway 'second' is on the hub, but does not answer the doctor" in said
    wait_until(lambda: second.info().connected, "the gateway is back", 10)


def test_a_machine_without_a_gateway_looks_from_where_it_is(three, shared_fleet) -> None:
    status, said = doctor(
        shared_fleet.sites[0], "--hub", shared_fleet.hub_uri, uri="http://127.0.0.1:9"
    )
    assert status == 1
    assert "the ROS master at 127.0.0.1:9: Connection refused" in said
    assert row(said, "(here)") == ["ok", "ok", "ok"]
    assert row(said, "far") == ["ok", "-", "ok"]


def test_nonsense_on_the_doctors_channels_harms_nobody(three, shared_fleet, machine) -> None:
    client = redis.Redis(machine.here, shared_fleet.hub_port)
    for nonsense in (b"", b"\xff", b"rocon:examine", b"[" * 10_000, b"0" * 33, os.urandom(100)):
        client.publish("rocon:examine", nonsense)
    client.close()
    assert doctor(three[0])[0] == 0
    assert all("Traceback" not in site.log.read_text() and site.info().connected for site in three)
