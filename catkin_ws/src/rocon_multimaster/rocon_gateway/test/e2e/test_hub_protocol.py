"""What a gateway writes to and reads from a real hub, according to the keys in docs/gateway.md."""

import json
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hub_seat import REQUEST, Bench, Seat
from tcp_proxy import TcpProxy

from pioneer_harness.wait import wait_until
from rocon_hub.registry import Registry
from rocon_hub_protocol.key import GATEWAYS_KEY, NAME_KEY, alive_key, record_key, requests_key
from rocon_hub_protocol.record import NO_REQUEST, Record, text_from_record, text_from_request


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.close()


def told(bench: Bench) -> tuple[Seat, Seat]:
    """Returns a base and a robot, once the base has received the robot's request."""
    base, robot = bench.seat("base"), bench.seat("robot")
    robot.tell(base=REQUEST)
    wait_until(lambda: base.hears("robot") == REQUEST, "the request", 5)
    return base, robot


def test_a_rule_cancelled_while_off_the_hub_is_withdrawn_on_reconnection(bench: Bench) -> None:
    base, robot = told(bench)
    robot.lose()
    robot.tell()
    robot.find()
    wait_until(lambda: base.hears("robot") == NO_REQUEST, "the withdrawal", 5)
    assert not bench.client.exists(requests_key("base"))


def test_what_a_killed_gateway_had_told_is_withdrawn_by_its_next_instance(bench: Bench) -> None:
    base, robot = told(bench)
    robot.lose()
    bench.seat("robot", "2")
    wait_until(lambda: base.hears("robot") == NO_REQUEST, "the withdrawal", 5)


def test_a_gateway_that_lost_its_name_writes_nothing_over_its_successor(bench: Bench) -> None:
    """A gateway learns of the loss only at its next heartbeat; what it wrote until then once stayed forever."""
    base, robot = told(bench)
    bench.client.set(alive_key("robot"), "2")
    robot.session.write(Record("robot", "1", "127.0.0.1", 9), {})
    robot.session.leave()
    assert bench.client.hexists(requests_key("base"), "robot")
    assert bench.client.exists(record_key("robot"))
    assert base.hears("robot") == REQUEST


def test_a_request_withdrawn_while_the_receiver_was_away_is_dropped(bench: Bench) -> None:
    base, robot = told(bench)
    base.lose()
    robot.tell()
    wait_until(lambda: not bench.client.exists(requests_key("base")), "the withdrawal", 5)
    base.find()
    assert base.hears("robot") == NO_REQUEST


def test_requests_survive_an_emptied_hub_until_their_senders_can_write(bench: Bench) -> None:
    base, robot = told(bench)
    base.lose()
    robot.lose()
    bench.client.flushall()
    bench.registry.open("Test Hub")
    base.find()
    assert base.hears("robot") == REQUEST
    robot.find()
    wait_until(
        lambda: bench.client.hexists(requests_key("base"), "robot"), "the request on the hub", 5
    )
    assert base.hears("robot") == REQUEST


def test_a_thousand_who_join_at_once_are_read_together_and_cost_no_sign_of_life(
    bench: Bench,
) -> None:
    """Each joiner once cost a request to the hub, with no heartbeat in between: a slow gateway was declared lost."""
    proxy = TcpProxy("127.0.0.1", bench.port)
    proxy.delay = 0.005
    base = bench.seat("base", "1", proxy.port)
    asked = questions(bench)
    names = [f"robot{number}" for number in range(1000)]
    with bench.client.pipeline() as pipe:
        pipe.sadd(GATEWAYS_KEY, *names)
        for name in names:
            pipe.set(record_key(name), text_from_record(Record(name, "1", "127.0.0.1", 9)))
            pipe.set(alive_key(name), "1")
            pipe.hset(requests_key("base"), name, text_from_request(REQUEST))
            pipe.publish(GATEWAYS_KEY, json.dumps({"gateway": name, "event": "joined"}))
        pipe.execute()
    lost: set[str] = set()
    # The last name's record is not always read last.

    def all_are_heard() -> bool:
        lost.update(bench.registry.look(time.monotonic()))
        return all(map(base.hears, names))

    wait_until(all_are_heard, "all requests", 60)
    assert lost == set()
    assert [base.hears(name) for name in names] == [REQUEST] * len(names)
    assert questions(bench) - asked < 50
    base.leave()
    proxy.close()


def questions(bench: Bench, command: str = "hmget") -> int:
    """Returns how often the hub received a command; the default reads the requests of single senders."""
    return int(bench.client.info("commandstats").get(f"cmdstat_{command}", {"calls": 0})["calls"])


def test_who_is_gone_is_struck_from_each_receivers_requests_by_one_command(bench: Bench) -> None:
    gone, left = (
        [f"gone{number}" for number in range(50)],
        [f"robot{number}" for number in range(20)],
    )
    bench.client.sadd(GATEWAYS_KEY, *gone, *left)
    for name in left:
        bench.client.set(alive_key(name), "1")
        bench.client.hset(requests_key(name), mapping=dict.fromkeys([*gone, "robot0"], "{}"))
    registry = Registry(bench.client, 0.0)
    assert set(registry.look(time.monotonic())) == set(gone)
    assert registry.clear(time.monotonic()) == set(gone)
    assert bench.client.smembers(GATEWAYS_KEY) == set(left)
    assert [bench.client.hkeys(requests_key(name)) for name in left] == [["robot0"]] * len(left)
    assert questions(bench, "hdel") == len(gone) + len(left)


def test_a_starting_hub_without_a_name_is_accepted_unless_it_stays_so(bench: Bench) -> None:
    """The hub's Redis answers shortly before the hub has written its name; gateways once logged a line about it."""
    base = bench.seat("base")

    def name_at_the_second_try() -> None:
        if base.tries == 2:
            bench.registry.open("Test Hub")

    base.before_try = name_at_the_second_try
    for _ in range(2):
        base.lose()
        bench.client.delete(NAME_KEY)
        base.tries = 0
        base.find()
        assert (base.tries, base.complaints) == (2, [])
    base.before_try = list
    base.lose()
    bench.client.delete(NAME_KEY)
    base.tries, base.is_barred = 0, False
    wait_until(lambda: base.complaints, "what is said of it", 5)
    assert base.complaints == [
        (2, f"the Redis at http://127.0.0.1:{bench.port} is not a hub: it has no name")
    ]


def test_requests_to_who_takes_its_leave_go_with_it(bench: Bench) -> None:
    """A sender that is offline at that time cannot withdraw its request, and would not when the receiver returns."""
    base = bench.seat("base")
    bench.client.hset(requests_key("base"), "robot", text_from_request(REQUEST))
    base.leave()
    assert not bench.client.exists(requests_key("base"))


def test_forged_requests_keep_no_gateway_off_the_hub(bench: Bench) -> None:
    bench.client.sadd(GATEWAYS_KEY, "ghost")
    bench.client.set(requests_key("ghost"), "not a hash")
    bench.seat("robot")
