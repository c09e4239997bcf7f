"""Gateways without a configured hub address."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from gateway_msgs import srv

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.mark.parametrize("insecure", [False, True], ids=["own machine", "network"])
def test_a_gateway_finds_its_hub_by_itself_in_either_order(fleet, report, insecure) -> None:
    early = fleet.site("early").start(hub_uri="", hub_whitelist=[fleet.hub_name])
    assert early.log.read_text().count("looking for a hub by mDNS") == 1
    assert early.info().discover_hubs_by_zeroconf
    fleet.start_hub(zeroconf=True, insecure=insecure)
    early.connected()
    assert early.info().hub_uris == [fleet.hub_uri]
    began = time.monotonic()
    late = fleet.site("late").start(hub_uri="", hub_whitelist=[fleet.hub_name]).connected()
    report("start to hub found", time.monotonic() - began)
    assert late.info().hub_names == [fleet.hub_name]


def test_a_hub_that_moves_is_found_again(fleet) -> None:
    site = fleet.site("base").start(hub_uri="", hub_whitelist=[fleet.hub_name])
    name, hub = fleet.hub_name, fleet.start_hub(zeroconf=True)
    site.connected()
    os.kill(hub, signal.SIGKILL)
    wait_until(lambda: not site.info().connected, "hub lost", 5)
    fleet.hub_port = fleet.ports.take(16390)
    fleet.start_hub(zeroconf=True, name=name)
    site.connected()
    assert site.info().hub_uris == [f"http://127.0.0.1:{fleet.hub_port}"]


def test_a_blacklisted_hub_is_left_alone_and_said_once(fleet) -> None:
    barred = [fleet.hub_uri.replace("127.0.0.1", "localhost")]
    site = fleet.site("base").start(
        hub_uri="", hub_whitelist=[fleet.hub_name], hub_blacklist=barred
    )
    fleet.start_hub(zeroconf=True)
    wait_until(lambda: "is blacklisted" in site.log.read_text(), "the refusal", 60)
    answer = site.call("connect_hub", srv.ConnectHub, uri=fleet.hub_uri)
    assert (answer.result, site.info().connected) == (13, False)
    assert site.log.read_text().count(f"'{fleet.hub_name}' at") == 1


def test_without_mdns_a_gateway_waits_for_connect_hub(fleet) -> None:
    site = fleet.site("base").start(hub_uri="", disable_zeroconf=True)
    assert "waiting for a call of ~connect_hub" in site.log.read_text()
    fleet.start_hub(zeroconf=True)
    assert wait_until(
        lambda: site.call("connect_hub", srv.ConnectHub, uri=fleet.hub_uri).result == 0,
        "the hub",
        60,
    )
    site.connected()


def test_nobody_pays_for_mdns_who_does_not_use_it() -> None:
    program = "import sys, rocon_gateway.node.gateway; raise SystemExit('zeroconf' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


QUIET_NETWORK = 'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'


def test_a_flood_of_announced_hubs_costs_few_threads_and_hides_no_true_one() -> None:
    """Each announced hub once had a thread that retried forever; one without an address delayed the others by 3 s."""
    alone = ["unshare", "--net", "--", "sh", "-c", QUIET_NETWORK, "sh"]
    if subprocess.run([*alone, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no network namespaces here")
    command = [*alone, sys.executable, str(Path(__file__).with_name("announcer.py")), "100", "30"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.startswith("threads "), done.stdout + done.stderr
    assert int(done.stdout.split()[1]) < 40, done.stdout
