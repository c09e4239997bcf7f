"""A gateway shuts down quickly and without log noise, whatever ended before it."""

import os
import signal
import time
from pathlib import Path

import pytest

from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def interrupted(site, fleet) -> float:
    """Interrupts the site's gateway; returns how long its shutdown took [s]."""
    os.kill(site.pid, signal.SIGINT)
    asked = time.monotonic()
    wait_until(lambda: not fleet.group.is_running(site.name), "the gateway's end", 10)
    return time.monotonic() - asked


def later_lines(site, before: str) -> list[str]:
    """Returns what the gateway has logged since its log was `before`."""
    return [line for line in site.log.read_text().removeprefix(before).splitlines() if line.strip()]


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_gateway_whose_hub_is_gone_ends_at_once(fleet, pair, report, how) -> None:
    base, robot = pair
    robot.talk("/a")
    base.flip("robot", "subscriber", "/a")
    wait_until(lambda: base.publishers("/a"), "the proxy", 10)
    before = base.log.read_text()
    # If only Redis is killed, it is restarted before every gateway has noticed.
    hubs = fleet.family(fleet.hub_pid) if how == signal.SIGKILL else {fleet.redis_pid()}
    for pid in hubs:
        os.kill(pid, how)
    wait_until(lambda: not base.info().connected, "hub lost", 8)
    took = interrupted(base, fleet)
    for pid in hubs if how == signal.SIGSTOP else ():
        os.kill(pid, signal.SIGCONT)
    report(f"end without a hub ({how.name})", took)
    assert took < 3.0
    assert len([line for line in later_lines(base, before) if "lost" in line]) == 1
    assert base.publishers("/a") == []
    # The gateway once mistook its own unregistration for a restart of the master and re-registered everything.
    assert "restarted" not in base.log.read_text()


def test_a_gateway_whose_master_is_gone_reports_it_once_and_ends(fleet, tmp_path, report) -> None:
    group, ports = ProcessGroup(), PortReservation()
    port = ports.take(15311)
    uri = f"http://127.0.0.1:{port}"
    environment = {
        **os.environ,
        "ROS_MASTER_URI": uri,
        "ROS_IP": "127.0.0.1",
        "ROS_HOME": str(tmp_path / "home"),
    }
    log = tmp_path / "orphan.log"
    try:
        master = group.start(
            "master",
            ["rosmaster", "--core", "-p", str(port)],
            environment,
            tmp_path / "m.log",
            True,
        )
        fleet.start_hub()
        argv = ["rosrun", "rocon_gateway", "gateway", "_name:=orphan", f"_hub_uri:={fleet.hub_uri}"]
        gateway = group.start("gateway", argv, environment, log, True)
        wait_until(
            lambda: "relay on port" in _text(log) and "on hub" in _text(log),
            "the gateway on its hub",
            60,
        )
        os.kill(master, signal.SIGKILL)
        wait_until(lambda: "does not answer" in _text(log), "the loss", 10)
        before = _text(log)
        os.kill(gateway, signal.SIGINT)
        asked = time.monotonic()
        wait_until(lambda: not group.is_running("gateway"), "the gateway's end", 10)
        took = time.monotonic() - asked
        report("end without a master", took)
        assert took < 3.0
        assert _text(log).count("does not answer") == 1
        assert (
            len([line for line in _text(log).removeprefix(before).splitlines() if line.strip()])
            <= 1
        ), _text(log)
    finally:
        group.stop()
        ports.release()


def _text(path: Path) -> str:
    return path.read_text() if path.exists() else ""
