"""Rules that end while their gateway is off the hub end everywhere."""

import os
import signal

import pytest

from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_a_flip_that_is_cancelled_while_the_hub_is_frozen_is_gone_after_its_thaw(
    standing_fleet, standing
) -> None:
    base, robot = standing
    robot.talk("/flow")
    assert robot.flip("base", "publisher", "/flow") == 0
    wait_until(lambda: base.publishers("/flow") == ["/robot/talker"], "the proxy", 10)
    redis = standing_fleet.redis_pid()
    os.kill(redis, signal.SIGSTOP)
    try:
        wait_until(lambda: not base.info().connected and not robot.info().connected, "hub lost", 8)
        assert robot.flip("base", "publisher", "/flow", cancel=True) == 0
    finally:
        os.kill(redis, signal.SIGCONT)
    base.connected()
    robot.connected()
    wait_until(lambda: base.info().flipped_in_connections == [], "nothing flipped in", 5)
    wait_until(lambda: base.publishers("/flow") == [], "no proxy", 5)


def test_a_killed_gateway_that_comes_back_without_its_rule_flips_nothing(
    standing_fleet, standing
) -> None:
    base, _ = standing
    site = standing_fleet.site("third").start().connected()
    site.talk("/flow")
    assert site.flip("base", "publisher", "/flow") == 0
    wait_until(lambda: base.publishers("/flow") == ["/third/talker"], "the proxy", 10)
    for pid in standing_fleet.family(site.pid):
        os.kill(pid, signal.SIGKILL)
    site.start().connected()
    wait_until(lambda: base.info().flipped_in_connections == [], "nothing flipped in", 5)
    wait_until(lambda: base.publishers("/flow") == [], "no proxy", 5)
