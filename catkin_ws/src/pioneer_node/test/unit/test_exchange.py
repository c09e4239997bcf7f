"""How a member of a ring handles tokens."""

import threading
from types import SimpleNamespace
from typing import Any

import pytest
from pioneer_msgs.msg import LockstepMessage, LockstepToken
from std_msgs.msg import String

from pioneer_node.adapters.exchange import Exchange, Place, is_connected
from pioneer_node.core.ring import membership, ring_topic

MEMBERS = ["amcl", "move_base", "pioneer_ros"]


def token(
    period: int, *messages: LockstepMessage, kind: int = LockstepToken.PERIOD
) -> LockstepToken:
    return LockstepToken(kind, period, period, [], [], list(messages))


def place(name: str = "move_base") -> Place:
    made = Place(
        Exchange(f"/robot/{name}"), "robot", MEMBERS, name, lambda stamp: times.append(stamp)
    )
    times: list[Any] = []
    made.times = times  # type: ignore[attr-defined]
    return made


def joined(name: str = "move_base") -> Place:
    made = place(name)
    assert made.take(token(3, kind=LockstepToken.JOIN)) is not None
    return made


@pytest.mark.parametrize(
    ("name", "inlet", "outlet"),
    [
        ("amcl", "period", "after_amcl"),
        ("move_base", "after_amcl", "after_move_base"),
        ("pioneer_ros", "after_move_base", "done"),
    ],
)
def test_tokens_come_from_the_member_before_and_go_to_the_one_behind(
    name: str, inlet: str, outlet: str
) -> None:
    made = place(name)
    assert (made.inlet, made.outlet) == (f"/robot/lockstep/{inlet}", f"/robot/lockstep/{outlet}")
    assert made.answers == "/robot/lockstep/done"
    assert ring_topic("", "done") == "/lockstep/done"


def test_membership_is_by_the_name_below_the_namespace() -> None:
    environ = {"LOCKSTEP_MEMBERS": " ".join(MEMBERS)}
    assert membership("/robot/amcl", "/robot/", environ) == ("robot", MEMBERS, "amcl")
    assert membership("/robot/other", "/robot/", environ)[1] == []
    assert membership("/amcl", "/", {})[1] == []


def test_a_member_joins_once_it_is_ready_and_adds_its_name_and_topics() -> None:
    made = place()
    made.ready = lambda: False
    made.exchange.listen("/scan", lambda _: None)
    assert made.take(token(2, kind=LockstepToken.JOIN)) is None
    assert made.take(token(2)) is None, "it has not joined"
    made.ready = lambda: True
    answer = made.take(token(2, kind=LockstepToken.JOIN))
    assert answer is not None
    assert (answer.members, answer.wants) == (["/robot/move_base"], ["/scan"])


def test_a_period_sets_time_delivers_works_and_replaces_the_members_messages() -> None:
    made, seen = joined(), []
    exchange = made.exchange
    exchange.listen("/scan", lambda message: seen.append(bytes(message.data)))

    def step() -> None:
        seen.append(b"step")
        exchange.publish("/cmd", b"new")

    exchange.set_wanted(["/cmd"])
    made.step = step
    before = [
        LockstepMessage("/gazebo", "/scan", b"scan"),
        LockstepMessage("/robot/move_base", "/cmd", b"old"),
    ]
    passed_on = made.take(token(4, *before))
    assert passed_on is not None
    assert seen == [b"scan", b"step"]
    assert made.times[-1] == 4  # type: ignore[attr-defined]
    assert [(one.sender, one.data) for one in passed_on.messages] == [
        ("/gazebo", b"scan"),
        ("/robot/move_base", b"new"),
    ]
    assert made.take(token(4)) is passed_on, "sent again, it is passed on as it was"
    assert made.take(token(3)) is None, "one of before"
    assert seen == [b"scan", b"step"]


def test_an_answer_names_the_period_and_whether_it_is_at_work() -> None:
    made, probe = joined(), token(0, kind=LockstepToken.PROBE)
    found: list[int] = []
    made.step = lambda: found.append(made.answer(probe).kind)
    made.take(token(7))
    assert found == [LockstepToken.WORKING]
    answer = made.answer(probe)
    assert (answer.kind, answer.period, answer.members) == (
        LockstepToken.FINISHED,
        7,
        ["/robot/move_base"],
    )


def test_a_latched_message_reaches_a_topic_that_is_wanted_later_once_a_publisher() -> None:
    exchange = Exchange("/a")
    exchange.publish("/map", b"one", latched_by=1)
    exchange.publish("/map", b"two", latched_by=2)
    exchange.publish("/gone", b"three", latched_by=1)
    exchange.forget("/gone", 1)
    exchange.set_wanted(["/map", "/gone"])
    assert [one.data for one in exchange.take()] == [b"one", b"two"]
    exchange.set_wanted(["/map"])
    assert exchange.take() == []


def test_a_latched_message_of_the_moment_its_topic_is_taken_up_is_sent_exactly_once() -> None:
    """It was lost if the publisher had looked before the topic was taken up, and kept the message after."""
    for _ in range(300):
        exchange, begin = Exchange("/a"), threading.Barrier(2)

        def publish(exchange: Exchange = exchange, begin: threading.Barrier = begin) -> None:
            begin.wait()
            exchange.publish("/map", b"one", latched_by=1)

        publisher = threading.Thread(target=publish)
        publisher.start()
        begin.wait()
        exchange.set_wanted(["/map"])
        publisher.join()
        assert [one.data for one in exchange.take()] == [b"one"]


def test_of_partners_and_of_streams_connections_bring_nothing() -> None:
    exchange = Exchange("/robot/amcl")
    exchange.partners = ("/robot/move_base",)
    assert not exchange.accepts("/goal", "/robot/move_base", False, bytes)
    assert exchange.accepts("/goal", "/other/robot/move_base", False, bytes), "the same ending"
    assert exchange.accepts("/goal", "/rviz", False, bytes)
    assert [exchange.accepts("/map", "/rviz", True, lambda: b"same") for _ in range(2)] == [
        True,
        False,
    ]
    scan = SimpleNamespace(_type="sensor_msgs/LaserScan")
    assert [
        is_connected(kind, topic) for kind, topic in ((String, "/a"), (String, "/tf"), (scan, "/a"))
    ] == [
        True,
        False,
        False,
    ]


def test_samples_are_the_newest_of_each_part_and_come_before_what_was_published() -> None:
    exchange = Exchange("/gazebo")
    exchange.set_wanted(["/said"])
    exchange.publish("/said", b"word")
    for data, part in ((b"old", b""), (b"new", b""), (b"x1", b"x"), (b"y1", b"y"), (b"x2", b"x")):
        exchange.sample("/tf" if part else "/clock", data, part)
    found = [(one.topic, one.data) for one in exchange.take(lambda parts: b"+".join(sorted(parts)))]
    assert found == [("/clock", b"new"), ("/tf", b"x2+y1"), ("/said", b"word")]
