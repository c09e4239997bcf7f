"""A gateway on several hubs at the same time."""

import itertools
import os
import signal

import pytest
from gateway_msgs import srv

from pioneer_harness.masters import is_running
from pioneer_harness.wait import START, wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def hubs_of(site) -> list[str]:
    return sorted(site.info().hub_uris)


def test_connect_hub_adds_a_hub_and_losing_one_leaves_the_other_alone(fleet, pair) -> None:
    base, robot = pair
    second, uri = fleet.start_second_hub()
    wait_until(lambda: is_running(uri), "the second hub's port", START)
    both = sorted([fleet.hub_uri, uri])
    for site in pair:
        assert wait_until(
            lambda s=site: s.call("connect_hub", srv.ConnectHub, uri=uri).result == 0, "joined", 10
        )
        wait_until(lambda s=site: hubs_of(s) == both, "both in gateway_info", 2)
    again = base.call("connect_hub", srv.ConnectHub, uri=uri.replace("127.0.0.1", "localhost"))
    assert (again.result, "already" in again.error_message) == (11, True)
    (described,) = base.call("remote_gateway_info", srv.RemoteGatewayInfo).gateways
    assert described.name == "robot"

    robot.talk("/a")
    ear = base.hear("/a")
    assert base.flip("robot", "subscriber", "/a") == 0
    ear.first_after(0.0)
    assert base.publishers("/a") == ["/robot/talker"]

    before = base.log.read_text()
    os.kill(fleet.hub_pid, signal.SIGKILL)
    wait_until(lambda: all(hubs_of(site) == [uri] for site in pair), "the first hub is missed", 8)
    assert base.info().connected
    robot.talk("/b", "late")
    late = base.hear("/b", "late_listener")
    assert base.flip("robot", "subscriber", "/b") == 0
    late.first_after(0.0)
    assert base.log.read_text().removeprefix(before).count("lost") == 1

    fleet.start_hub()
    wait_until(lambda: all(hubs_of(site) == both for site in pair), "the first hub is back", 10)
    os.kill(second, signal.SIGKILL)
    wait_until(
        lambda: all(hubs_of(site) == [fleet.hub_uri] for site in pair),
        "the second hub is missed",
        8,
    )
    wait_until(
        lambda: base.states() == {"flip /a": "active", "flip /b": "active"}, "both active", 5
    )
    times = ear.times()
    assert max(late - early for early, late in itertools.pairwise(times)) < 1.0
    assert base.pull("nobody", "publisher", "/c") == 0


def test_two_hubs_in_the_parameter_join_gateways_that_share_only_one_each(fleet) -> None:
    fleet.start_hub()
    _, uri = fleet.start_second_hub()
    middle = fleet.site("middle").start(hub_uri=f"{fleet.hub_uri}; {uri}")
    left, right = (
        fleet.site("left").start().connected(),
        fleet.site("right").start(hub_uri=uri).connected(),
    )
    wait_until(lambda: len(hubs_of(middle)) == 2, "both hubs", 10)
    names = {one.name for one in middle.call("remote_gateway_info", srv.RemoteGatewayInfo).gateways}
    assert names == {"left", "right"}
    left.talk("/a")
    right.talk("/b")
    assert middle.flip(".*", "subscriber", "/[ab]") == 0
    middle.hear("/a", "hears_a").first_after(0.0)
    middle.hear("/b", "hears_b").first_after(0.0)
    assert left.flip("right", "subscriber", "/b") == 0
    wait_until(
        lambda: left.states()["flip /b"].startswith("no such gateway"),
        "right is not on left's hub",
        5,
    )
