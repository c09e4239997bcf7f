"""Rules of the door: what they offer and bring in, and what is said of those that make no sense."""

import re

import pytest

from pioneer_ros2.error import RuleError
from pioneer_ros2.rule import Export, Import, Qos, Rules, exports, imports, rules_from_mapping


def rules(**sections: object) -> Rules:
    return rules_from_mapping({name.rstrip("_"): entries for name, entries in sections.items()})


def test_the_first_rule_that_matches_a_topic_counts() -> None:
    both = rules(out=[{"topic": "/p1/scan", "qos": "sensor"}, {"topic": "/.*"}])
    assert exports(both, ["/p1/scan", "/x"]) == [
        Export("/p1/scan", "/p1/scan", Qos.SENSOR, 0.0, ""),
        Export("/x", "/x", Qos.RELIABLE, 0.0, ""),
    ]


def test_a_topic_gets_its_name_in_ros_2_from_the_pattern_s_groups() -> None:
    renamed = rules(out=[{"topic": r"/(\w+)/base_scan", "ros2": r"/\1/scan", "rate": 5}])
    assert exports(renamed, ["/p1/base_scan", "/base_scan"]) == [
        Export("/p1/base_scan", "/p1/scan", Qos.RELIABLE, 5.0, "")
    ]


def test_each_robot_gets_a_topic_beside_the_one_of_all() -> None:
    tf = rules(out=[{"topic": "/tf", "ros2": "/{robot}/tf"}, {"topic": "/tf"}])
    found = exports(tf, ["/tf"], ["p2", "p1"])
    assert [(each.name, each.robot) for each in found] == [
        ("/p1/tf", "p1"),
        ("/p2/tf", "p2"),
        ("/tf", ""),
    ]


def test_a_topic_is_brought_in_only_for_a_subscriber_unless_gateways_carry_it_on() -> None:
    into = [
        {"topic": "/a", "type": "x/A"},
        {"topic": "/b", "type": "x/B", "needs_subscriber": False},
    ]
    both = rules(in_=into)
    assert imports(both, [], ["/a", "/b"]) == [Import("/b", "/b", "x/B", Qos.RELIABLE)]
    assert [each.name for each in imports(both, ["/a"], [])] == ["/a"]


def test_a_topic_is_brought_in_under_its_name_in_ros_1() -> None:
    velocity = rules(
        in_=[
            {
                "topic": r"/(\w+)/cmd_vel",
                "ros1": r"/\1/pioneer/cmd_vel",
                "type": "geometry_msgs/Twist",
            }
        ]
    )
    (found,) = imports(velocity, ["/p1/pioneer/cmd_vel"], ["/p1/cmd_vel", "/p2/cmd_vel"])
    assert (found.name, found.target) == ("/p1/cmd_vel", "/p1/pioneer/cmd_vel")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (3, "must be lists under 'out', 'in' and 'stop'"),
        ({"stop": ["estop"]}, "stop, rule 1: must be a topic such as /estop, not 'estop'"),
        ({"stop": [{"topic": "/estop"}]}, "must be a topic such as /estop"),
        ({"outt": []}, "unknown section 'outt'"),
        ({"out": "x"}, "'out' must be a list"),
        ({"out": ["x"]}, "out, rule 1: must have fields"),
        ({"out": [{"topik": "/a"}]}, "unknown field 'topik'; did you mean 'topic'?"),
        ({"out": [{"qos": "sensor"}]}, "out, rule 1: needs 'topic'"),
        ({"out": [{"topic": "("}]}, "is not a regular expression"),
        ({"out": [{"topic": "/a", "ros2": r"/\1"}]}, "the topic's pattern has 0 groups"),
        ({"out": [{"topic": "/a", "qos": "fast"}]}, "qos must be one of sensor, reliable, latched"),
        ({"out": [{"topic": "/a", "rate": 0}]}, "rate must be above 0 Hz, not 0"),
        ({"in": [{"topic": "/a"}]}, "in, rule 1: needs 'type'"),
        ({"in": [{"topic": "/a", "type": "geometry_msgs/msg/Twist"}]}, "type must be package/Name"),
        (
            {"in": [{"topic": "/a", "type": "a/B", "needs_subscriber": 1}]},
            "must be true or false, not 1",
        ),
        ({"out": [{"topic": "/a", "own_frames": "yes"}]}, "own_frames must be true or false"),
    ],
)
def test_a_rule_that_makes_no_sense_is_named(content: object, says: str) -> None:
    with pytest.raises(RuleError, match=re.escape(says)):
        rules_from_mapping(content)


def test_stop_topics_are_for_every_robot_or_for_each() -> None:
    assert rules(stop=["/estop", "/{robot}/estop"]).stop == ("/estop", "/{robot}/estop")


def test_a_topic_in_the_robot_s_own_frames_is_one_more() -> None:
    both = rules(
        out=[
            {"topic": r"/(\w+)/base_scan", "ros2": r"/\1/scan", "own_frames": True},
            {"topic": r"/\w+/base_scan", "qos": "sensor"},
        ]
    )
    assert exports(both, ["/p1/base_scan"]) == [
        Export("/p1/base_scan", "/p1/scan", Qos.RELIABLE, 0.0, "", own_frames=True),
        Export("/p1/base_scan", "/p1/base_scan", Qos.SENSOR, 0.0, ""),
    ]
