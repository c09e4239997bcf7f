"""Faults in hub, Redis, gateways, masters, clocks and names: rules persist, and data flow continues or resumes."""

import itertools
import os
import signal
import time

import pytest
from measure import checked, longest_gap

from pioneer_harness.masters import MasterProcess
from pioneer_harness.port import PortReservation
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until
from tcpros.client import ClientError

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.fixture
def flow(standing):
    """A flipped topic with a talker and a listener."""
    base, robot = standing
    robot.talk("/flow")
    ear = base.hear("/flow")
    asked = time.monotonic()
    assert base.flip("robot", "subscriber", "/flow") == 0
    ear.first_after(asked)
    return ear


def test_a_frozen_hub_stops_no_data_and_its_thaw_restores_everything(
    standing_fleet, standing, flow, report
) -> None:
    base, robot = standing
    redis, began = standing_fleet.redis_pid(), time.monotonic()
    os.kill(redis, signal.SIGSTOP)
    try:
        wait_until(lambda: not base.info().connected and not robot.info().connected, "hub lost", 8)
        assert base.flip("robot", "subscriber", "/meanwhile") == 0
        flow.first_after(time.monotonic())
    finally:
        os.kill(redis, signal.SIGCONT)
    back = time.monotonic()
    wait_until(lambda: base.states()["flip /flow"] == "active", "active", 5)
    wait_until(
        lambda: base.states().get("flip /meanwhile", "").startswith("no such topic"),
        "the new rule's answer",
        8,
    )
    report("rules answered after the thaw", time.monotonic() - back)
    wait_until(
        lambda: time.monotonic() - back > 7, "what expired meanwhile would be gone by now", 10
    )
    assert longest_gap(flow.times(), began) < 1.0


def test_a_killed_redis_comes_back_and_no_data_stops(
    standing_fleet, standing, flow, report
) -> None:
    base, robot = standing
    old, began = standing_fleet.redis_pid(), time.monotonic()
    os.kill(old, signal.SIGKILL)
    wait_until(lambda: standing_fleet.redis_pid() not in (0, old), "another Redis", 5)
    base.flip("robot", "subscriber", "/meanwhile")
    wait_until(
        lambda: base.states().get("flip /meanwhile", "").startswith("no such topic"),
        "the new rule's answer",
        8,
    )
    report("Redis killed: rules answered", time.monotonic() - began)
    wait_until(lambda: base.states()["flip /flow"] == "active", "active", 5)
    flow.first_after(time.monotonic())
    assert longest_gap(flow.times(), began) < 1.0
    assert (base.info().connected, robot.info().connected) == (True, True)


def test_a_frozen_gateway_is_noticed_and_welcomed_back(
    standing_fleet, standing, flow, report
) -> None:
    base, robot = standing
    frozen = standing_fleet.family(robot.pid)
    began = time.monotonic()
    for pid in frozen:
        os.kill(pid, signal.SIGSTOP)
    try:
        wait_until(lambda: base.publishers("/flow") == [], "the far side is unregistered", 12)
        took = time.monotonic() - began
        wait_until(lambda: base.states()["flip /flow"] != "active", "the rule's state to change", 2)
    finally:
        for pid in frozen:
            os.kill(pid, signal.SIGCONT)
    report("gateway frozen, noticed", took)
    assert took <= 10.0
    flow.first_after(time.monotonic())
    wait_until(lambda: base.states()["flip /flow"] == "active", "active", 5)


def test_the_newer_of_two_gateways_of_one_name_wins_and_the_older_returns_after_it(
    standing_fleet, standing
) -> None:
    _, robot = standing
    twin = standing_fleet.site("twin").start(name="robot").connected()
    wait_until(lambda: not robot.info().connected, "the older withdraws", 5)
    assert "another gateway took our name 'robot'" in robot.log.read_text()
    assert twin.info().connected
    twin.stop()
    robot.connected()


def test_a_jump_of_simulated_time_changes_nothing(standing_fleet, standing) -> None:
    _, robot = standing
    site = standing_fleet.site("simulated")
    site.master.set_param("/use_sim_time", True)
    clock = site.probe("clock", "clock", "/clock", 50)
    wait_until(
        lambda: site.publishers("/clock"),
        "the clock, which signals would end before it is there",
        START,
    )
    site.start().connected()
    robot.talk("/before")
    ear = site.hear("/before")
    for number, topic in ((signal.SIGUSR1, "/before"), (signal.SIGUSR2, "/after")):
        os.kill(clock, number)
        asked = time.monotonic()
        assert site.flip("robot", "subscriber", topic) == 0
        assert ear.first_after(asked) < 2.0
    wait_until(lambda: site.states()["flip /before"] == "active", "active", 5)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 3.0, "longer than signs of life last", 5)
    assert longest_gap(ear.times(), began) < 1.0
    assert site.info().connected


def test_a_master_that_is_restarted_under_its_gateway_learns_everything_again(
    standing_fleet, standing, tmp_path
) -> None:
    _base, robot = standing
    robot.talk("/kept")
    with ProcessGroup() as group, PortReservation() as ports:
        master = MasterProcess(group, ports.take(15311), tmp_path)
        site = standing_fleet.site("phoenix", master)
        site.start().connected()
        assert site.flip("robot", "subscriber", "/kept") == 0
        wait_until(lambda: site.publishers("/kept") == ["/robot/talker"], "the proxy", 5)
        master.restart()
        wait_until(
            lambda: site.publishers("/kept") == ["/robot/talker"], "the proxy on the new master", 10
        )
        wait_until(
            lambda: site.states() == {"flip /kept": "active"},
            "the gateway's own topics and services",
            10,
        )
        site.hear("/kept").first_after(0.0)
        assert site.flip("robot", "subscriber", "/other") == 0
        assert site.log.read_text().count("restarted; registered again") == 1
        site.stop()


def test_in_a_ring_of_three_that_flips_everything_each_message_comes_once(
    standing_fleet, standing
) -> None:
    base, robot = standing
    third = standing_fleet.site("third").start().connected()
    ring = (base, robot, third)
    ears = {}
    for site in ring:
        site.probe("load", "source", "/ring", 16, 20)
        log = standing_fleet.folder / f"{site.name}-ring.log"
        site.probe("check", "sink", "/ring", log=log)
        ears[site] = log
    for site, onward in itertools.pairwise((*ring, base)):
        assert site.flip(onward.name, "publisher", ".*") == 0
        assert site.flip(onward.name, "subscriber", ".*") == 0
    for site in ring:
        all_of_them = sorted(
            ["/source", *(f"/{other.name}/source" for other in ring if other is not site)]
        )
        wait_until(
            lambda s=site, o=all_of_them: s.publishers("/ring") == o, "each of the others once", 15
        )
        wait_until(lambda s=site: checked(ears[s]), f"messages at {site.name}", START)
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 1.0, "some time for echoes", 3)
    for site in ring:
        assert site.publishers("/ring").count("/source") == 1
        numbers = [number for _, number, _ in checked(ears[site])]
        # Three sources count from 0, so a number may arrive three times; a fourth time would be an echo.
        assert max(numbers.count(one) for one in set(numbers)) <= 3


def test_a_publisher_that_returns_with_another_type_is_carried_past_old_subscribers(
    standing, report
) -> None:
    """The set of publishers does not change in this case, and a subscriber keeps the old type on its master."""
    base, robot = standing
    first = robot.talk("/fickle")
    ear = base.hear("/fickle")
    assert base.flip("robot", "subscriber", "/fickle") == 0
    ear.first_after(0.0)
    os.kill(first, signal.SIGKILL)
    robot.probe("count", "talker", "/fickle")
    began = time.monotonic()
    wait_until(
        lambda: published_type(base, "/robot/talker", "/fickle") == "std_msgs/Int32",
        "the new type, beside a subscriber of the old one",
        10,
    )
    report("publisher back with another type: carried", time.monotonic() - began)
    wait_until(
        lambda: (
            "type mismatch: /listener gets no /fickle of /robot/talker: the type here is "
            "std_msgs/Int32, asked for was std_msgs/String" in base.log.read_text()
        ),
        "a line that names the subscriber",
        10,
    )
    wait_until(lambda: base.states()["flip /fickle"] == "active", "an active rule", 10)


def published_type(site, node: str, topic: str) -> str:
    """Returns the topic type in the header of a node on this site's master; "" while the node publishes nothing."""
    try:
        with site.subscription(node, topic) as connection:
            connection.read_frame()
            return connection.header["type"]
    except (OSError, ClientError):
        return ""
