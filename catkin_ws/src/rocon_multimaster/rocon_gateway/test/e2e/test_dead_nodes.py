"""Killed gateways and nodes leave registrations on their master: these bar nothing, and ours are removed."""

import os
import signal
import sys
from pathlib import Path

import pytest
from gateway_msgs import srv

from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

PROBE = Path(__file__).with_name("probe.py")
SERVER = Path(__file__).parents[3] / "rocon_relay/test/node/server.py"


def test_a_restarted_gateway_removes_the_proxies_of_its_killed_predecessor(fleet, pair) -> None:
    base, robot = pair
    robot.talk("/chatter")
    serve(fleet, robot)
    assert base.flip("robot", "subscriber", "/chatter") == 0
    assert robot.flip("base", "service", "/echo") == 0
    wait_until(lambda: base.publishers("/chatter") == ["/robot/talker"], "the proxy", 10)
    wait_until(lambda: served_by(base) == ["/robot/server"], "the service", 10)
    os.kill(base.pid, signal.SIGKILL)
    wait_until(lambda: not fleet.group.is_running("base"), "its end", 10)
    robot.stop()
    base.start()
    assert base.publishers("/chatter") == []
    assert served_by(base) == []
    assert "removed proxies of a killed gateway of our name" in base.log.read_text()


def test_a_dead_node_bars_no_import_and_a_frozen_one_does(fleet, pair) -> None:
    base, robot = pair
    serve(fleet, robot)
    local = serve(fleet, base)
    robot.talk("/chatter")
    environment = {**base.master.environment, "ROS_NAMESPACE": "robot"}
    argv = [sys.executable, str(PROBE), "talk", "talker", "/other"]
    namesake = fleet.group.start(
        "namesake", argv, environment, fleet.folder / "namesake.log", may_end=True
    )
    wait_until(lambda: base.publishers("/other") == ["/robot/talker"], "the namesake", START)
    assert robot.flip("base", "service", "/echo") == 0
    assert base.flip("robot", "subscriber", "/chatter") == 0
    barred = {"flip /chatter": "refused: a node /robot/talker is here already"}
    wait_until(lambda: base.states() == barred, "refused", 10)
    wait_until(
        lambda: robot.states()["flip /echo"].endswith("is served by /server here already"),
        "refused, too",
        10,
    )
    os.kill(namesake, signal.SIGSTOP)
    os.kill(local, signal.SIGKILL)
    wait_until(lambda: served_by(base) == ["/robot/server"], "the far server", 15)
    assert base.states() == barred
    os.kill(namesake, signal.SIGKILL)
    wait_until(lambda: base.publishers("/chatter") == ["/robot/talker"], "the far talker", 15)
    base.hear("/chatter").first_after(0.0)
    wait_until(lambda: base.states()["flip /chatter"] == "active", "active", 10)
    assert robot.publishers("/chatter") == ["/talker"], "the proxy is not taken for a local node"
    assert base.publishers("/other") == []
    log = base.log.read_text()
    for node in ("/server", "/robot/talker"):
        assert log.count(f"{node} is registered on this master, but nothing listens") == 1


def test_a_killed_gateway_never_counts_as_available_again(fleet) -> None:
    """The hub keeps its record for a while, longer than the time at which it was lost."""
    fleet.start_hub(gateway_gone_timeout=2.0, watcher_thread_rate=0.1)
    base = fleet.site("base").start().connected()
    robot = fleet.site("robot").start().connected()
    wait_until(lambda: available(base) == [True], "the robot", 10)
    os.kill(robot.pid, signal.SIGKILL)
    wait_until(lambda: available(base) == [False], "its silence", 10)
    seen = []
    wait_until(lambda: seen.append(available(base)) or seen[-1] == [], "its removal", 20)
    assert [True] not in seen


def available(site) -> list[bool]:
    """Returns whether each other gateway on the hub is available."""
    answer = site.call("remote_gateway_info", srv.RemoteGatewayInfo)
    return [one.conn_stats.gateway_available for one in answer.gateways]


def serve(fleet, site) -> int:
    """Starts a server of /echo; returns its PID."""
    name = f"{site.name} server"
    argv = [sys.executable, str(SERVER)]
    log = fleet.folder / f"{name}.log"
    pid = fleet.group.start(name, argv, site.master.environment, log, may_end=True)
    wait_until(lambda: served_by(site), "the server", START)
    return pid


def served_by(site) -> list[str]:
    return site.master.system_state()[2].get("/echo", [])
