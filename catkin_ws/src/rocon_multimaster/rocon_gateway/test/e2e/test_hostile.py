"""Unauthenticated clients and excessive load do not harm a gateway beyond its resource limits."""

import itertools
import json
import os
import signal
import socket
import time
from pathlib import Path

import nonsense
import pytest
import redis
from gateway_msgs import msg, srv
from hypothesis import strategies as st
from measure import MB, checked, memory, open_files
from nonsense import drawn

from pioneer_harness.wait import START, wait_until
from rocon_hub_protocol.key import GATEWAYS_KEY, alive_key, record_key, requests_key

# rosmaster runs in this process and leaves its connections to nodes to the garbage collector.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


@pytest.fixture
def flow(standing, standing_fleet, request):
    """A flipped stream of numbered messages from robot to base; returns the log of the `check` probe."""
    base, robot = standing
    robot.probe("load", "flow_source", "/flow", 64, 50)
    log = standing_fleet.folder / f"{request.node.name}.log"
    base.probe("check", "flow_sink", "/flow", log=log)
    assert base.flip("robot", "subscriber", "/flow") == 0
    wait_until(lambda: checked(log), "the flow", START)
    return log


def assert_unbroken(log: Path) -> None:
    """Asserts that every message arrived once, in order and intact, and that the stream is still flowing."""
    asked = time.monotonic()
    wait_until(lambda: checked(log)[-1][0] > asked, "the flow continues", 5)
    rows = checked(log)
    numbers = [number for _, number, _ in rows]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert all(good for *_, good in rows)


def sent_since(log: Path, moment: float) -> int:
    """Returns how many messages were sent since `moment`, including lost ones, from the range of received numbers."""
    numbers = [number for one, number, _ in checked(log) if one > moment]
    return numbers[-1] - numbers[0] + 1 if numbers else 0


def assert_none_doubled(log: Path) -> None:
    """Asserts that messages are intact and in order; short pauses are allowed, as a client may overwrite requests."""
    began = time.monotonic()
    wait_until(lambda: checked(log)[-1][0] > began, "the flow continues", 5)
    rows = checked(log)
    assert all(good for *_, good in rows)
    assert all(
        late[1] > early[1] and late[0] - early[0] < 2.0 for early, late in itertools.pairwise(rows)
    )


def test_garbage_in_redis_values_does_no_harm(standing_fleet, standing, flow) -> None:
    base, robot = standing
    client = redis.Redis(port=standing_fleet.hub_port)
    own = client.get(record_key("robot"))
    records = [
        own.replace(b'"127.0.0.1"', b'"\\u0000"'),
        own.replace(b"false", b"0"),
        *drawn(nonsense.records, 40),
    ]
    strange = json.loads(own)
    for number, odd in enumerate((" ", "/../", "\ud800", "x" * 3000, "ghost*?[", "robot\n")):
        strange |= {"name": odd, "host": odd, "port": 10**9 - number}
        strange["advertisements"] = [["publisher", odd, odd, odd]]
        records.append(json.dumps(strange).encode())
    base.flip(".*", "subscriber", "/ghost")
    base.pull(".*", "publisher", ".*")
    requests = [b"[" * 100_000, b'{"offers":NaN}', *drawn(nonsense.requests, 60), *records]
    suffixes = drawn(st.binary(max_size=3), len(requests))
    for number, (request, suffix) in enumerate(
        zip(requests, itertools.cycle(suffixes), strict=False)
    ):
        ghost = f"ghost{number}".encode() + suffix
        client.hset(requests_key("base"), ghost, request)
        client.set(record_key("").encode() + ghost, records[number % len(records)])
        client.set(alive_key("").encode() + ghost, b"\xff", px=1500)
        client.sadd(GATEWAYS_KEY, ghost)
        client.publish(
            GATEWAYS_KEY, (request, b'{"gateway": 3, "event": "joined"}', b"[]")[number % 3]
        )
        client.publish(
            GATEWAYS_KEY, b'{"gateway": "' + f"ghost{number}".encode() + b'", "event": "joined"}'
        )
        client.publish(requests_key("base"), ghost)
        client.publish(record_key("robot"), request)
    for key in (requests_key("base"), requests_key("robot")):
        client.set(key, b"not a hash")
        client.publish(key, b"robot")
    began = time.monotonic()
    wait_until(lambda: time.monotonic() - began > 3.0, "ghosts expire", 5)
    client.close()
    for site in (base, robot):
        site.connected()
    robot.talk("/ghost", "honest")
    wait_until(lambda: base.publishers("/ghost") == ["/robot/honest"], "rules still work", 10)
    assert_none_doubled(flow)


def test_a_wrong_type_under_every_key_of_the_hub_is_overcome(
    standing_fleet, standing, flow
) -> None:
    base, robot = standing
    client = redis.Redis(port=standing_fleet.hub_port)
    for key in (GATEWAYS_KEY, record_key("base"), alive_key("base"), "rocon:lost:base"):
        # In one transaction: otherwise the owner could write the key again in between.
        client.pipeline().delete(key).hset(key, "x", "x").execute()
    client.set(requests_key("base"), "x")
    client.close()
    robot.talk("/after", "honest")
    wait_until(lambda: base.info().connected and robot.info().connected, "both on the hub", 10)
    assert base.flip("robot", "subscriber", "/after") == 0
    wait_until(lambda: base.publishers("/after") == ["/robot/honest"], "rules still work", 15)
    assert_none_doubled(flow)


def test_a_member_that_advertises_a_name_of_1_mb_stalls_nobody(
    standing_fleet, standing, flow
) -> None:
    """Every gateway with a pattern that begins with `.*` once spent hours matching it against that name."""
    base, robot = standing
    assert base.pull(".*", "publisher", ".*/move_base/.*") == 0
    assert robot.pull(".*", "publisher", r"/(\w+/?)+/odom") == 0
    record = json.loads(redis.Redis(port=standing_fleet.hub_port).get(record_key("robot")))
    names = ["/" + "a/" * 500_000, "/" + "a/" * 120]
    record |= {
        "name": "ghost",
        "advertisements": [["publisher", one, "std_msgs/String", "/ghost"] for one in names],
    }
    with redis.Redis(port=standing_fleet.hub_port) as client:
        client.set(record_key("ghost"), json.dumps(record))
        client.set(alive_key("ghost"), "1", px=5000)
        client.sadd(GATEWAYS_KEY, "ghost")
        client.publish(GATEWAYS_KEY, json.dumps({"gateway": "ghost", "event": "joined"}))
    wait_until(lambda: "ghost" in known(base), "the ghost is known", 5)
    robot.talk("/pioneer1/move_base/plan", "honest")
    robot.advertise("/pioneer1/move_base/plan")
    wait_until(
        lambda: base.publishers("/pioneer1/move_base/plan") == ["/robot/honest"],
        "rules still work",
        10,
    )
    assert_unbroken(flow)


def known(site) -> list[str]:
    """Returns the names of the gateways that a site knows."""
    answer = site.call("remote_gateway_info", srv.RemoteGatewayInfo, gateways=[])
    return [one.name for one in answer.gateways]


def test_half_handshakes_and_garbage_on_the_relay_port_harm_nobody(
    standing_fleet, standing, flow
) -> None:
    _base, robot = standing
    port = robot.relay_port()
    before = open_files(robot.pid)
    clients = []
    for head in (b"\xff\xff\xff\xff", *drawn(nonsense.heads, 80)):
        client = socket.create_connection(("127.0.0.1", port), 5)
        client.sendall(head)
        clients.append(client)
    assert_unbroken(flow)
    wait_until(
        lambda: open_files(robot.pid) <= before, "the clients are disconnected, silent ones too", 10
    )
    for client in clients:
        client.close()
    assert robot.log.read_text().count("Traceback") == 0
    assert_unbroken(flow)


def test_thousands_of_rules_are_taken_kept_and_cancelled(standing, flow, report) -> None:
    base, robot = standing
    names = [f"/many/topic{number}" for number in range(3000)]
    remotes = [msg.RemoteRule("robot", msg.Rule("subscriber", name, "")) for name in names]
    asked = time.monotonic()
    assert base.call("flip", srv.Remote, remotes=remotes, cancel=False).result == 0
    assert base.advertise(*names).result == 0
    wait_until(lambda: len(base.states()) == 6001, "all have a state", 20)
    report("6000 rules taken", time.monotonic() - asked)
    wait_until(
        lambda: base.states()["flip /many/topic2999"].startswith("no such topic"),
        "they are answered",
        20,
    )
    report("6000 rules answered", time.monotonic() - asked)
    robot.talk("/many/topic1234")
    born = time.monotonic()
    wait_until(
        lambda: base.publishers("/many/topic1234") == ["/robot/talker"], "one of them acts", 10
    )
    report("one of 6000 acts", time.monotonic() - born)
    assert base.call("flip", srv.Remote, remotes=remotes, cancel=True).result == 0
    assert base.advertise(*names, cancel=True).result == 0
    wait_until(lambda: len(base.states()) == 1, "all are cancelled", 20)
    assert_unbroken(flow)


def test_a_subscriber_that_never_reads_costs_bounded_memory_and_slows_nobody(
    standing, standing_fleet, flow
) -> None:
    base, robot = standing
    robot.probe("load", "big_source", "/big", MB, 20)
    log = standing_fleet.folder / "never-reads.log"
    base.probe("check", "big_sink", "/big", log=log)
    assert base.flip("robot", "subscriber", "/big") == 0
    wait_until(lambda: checked(log), "the big flow", START)
    with base.subscription("/robot/big_source", "/big"):
        before, began = memory(base.pid), time.monotonic()
        # More data than may be buffered, over a time long enough to expose a blocked reader.
        wait_until(
            lambda: sent_since(log, began) > 80 and time.monotonic() - began > 4.0,
            "a reader beside it",
            30,
        )
        assert memory(base.pid) - before < 40 * MB
    came = len([one for one, *_ in checked(log) if one > began])
    assert came > sent_since(log, began) / 2
    assert all(good for *_, good in checked(log))
    assert_unbroken(flow)


def test_messages_of_50_mb_pass_whole_beside_small_ones_and_leave_no_memory_behind(
    standing, standing_fleet, flow
) -> None:
    base, robot = standing
    log = standing_fleet.folder / "huge.log"
    base.probe("check", "huge_sink", "/huge", log=log)
    assert base.flip("robot", "subscriber", "/huge") == 0
    pid = robot.probe("load", "huge_source", "/huge", 50 * MB, 1)
    peak, before = 0, {site: memory(site.pid) for site in standing}

    def three_are_there() -> bool:
        nonlocal peak
        peak = max(peak, memory(base.pid), memory(robot.pid))
        return len(checked(log)) >= 3

    wait_until(three_are_there, "three of them", START)
    assert all(good for *_, good in checked(log))
    os.kill(pid, signal.SIGINT)
    # One message may be queued whatever its size, and another may be in transit.
    assert peak < max(before.values()) + 3 * 50 * MB
    wait_until(lambda: base.publishers("/huge") == [], "the publisher's end", 10)
    for site, least in before.items():
        wait_until(lambda s=site, m=least: memory(s.pid) < m + 40 * MB, "memory is given back", 10)
    assert_unbroken(flow)
