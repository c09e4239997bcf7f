"""One value that cannot be shown costs that value."""

import json
import math

import pytest

from pioneer_fleet.monitor.conversions import MessageError, mount_of
from pioneer_web.state.robot import Robot
from pioneer_web.state.station import Station
from pioneer_web.state.stream import Stream

CIRCLE = """<robot name="r"><joint name="a"><parent link="laser"/><child link="base"/></joint>
<joint name="b"><parent link="base"/><child link="laser"/></joint></robot>"""


def test_a_value_that_json_cannot_hold_is_null_and_named_once() -> None:
    faults: list[str] = []
    stream = Stream(lambda name, _: faults.append(name))
    for time in (1, 2):
        values = {"time": time, "huge": 10**300, "nan": math.nan, "name": "\udc80"}
        stream.update(values)
        assert json.loads(stream.whole()) == {"time": time, "huge": None, "nan": None, "name": None}
    assert faults == ["huge", "name"]


def test_rules_and_links_with_odd_fields_are_shown_as_far_as_they_can() -> None:
    station = Station()
    station.robots = [Robot(name="pioneer1", gateway="aadi1_gateway")]
    station.set_rules(
        [{"action": "flip"}, {}, {"action": "flip", "gateway": "aadi1_gateway", "state": "active"}]
    )
    for number in ("nan", "inf", "1e300", "x", ""):
        values = {"rate [Hz]": number, "throughput [byte/s]": "8"}
        station.add_links([("gateway: to aadi1_gateway /tf", values)])
        network = station.values(1.0)["network"]["aadi1_gateway"]
        assert (network["rules"], network["active"], network["rate"], network["bytes"]) == (
            1,
            1,
            0,
            8,
        )


def test_names_of_links_and_models_are_bounded() -> None:
    station = Station()
    values = {"rate [Hz]": "1", "throughput [byte/s]": "8", "dropped": "0"}
    station.add_links((f"gateway: to ghost{number} /tf", values) for number in range(3000))
    assert len(station.links) <= 1000
    station.set_models((f"box{number}", 0.0, 0.0) for number in range(9000))
    station.set_models((f"ball{number}", 0.0, 0.0) for number in range(9000))
    assert len(station.values(1.0)["actors"]) <= 5000


def test_a_robot_description_that_is_a_circle_or_no_xml_ends() -> None:
    assert mount_of(CIRCLE, "laser").x == 0.0
    with pytest.raises(MessageError, match="not XML"):
        mount_of("<robot", "laser")


def test_a_description_with_entities_is_refused():
    """Any client of the master may set it, and nested entities cost CPU time and memory."""
    bomb = '<!DOCTYPE r [<!ENTITY a "x"><!ENTITY b "&a;&a;">]><robot name="&b;"/>'
    with pytest.raises(MessageError, match="document type"):
        mount_of(bomb, "laser")


def test_what_does_not_cross_to_ros_2_is_listed_with_the_rules() -> None:
    station = Station()
    station.set_door([("/a to ROS 2", "it does not cross: no definition"), ("door", "it starts")])
    rows = [(row["gateway"], row["state"], row["reason"]) for row in station.values(1.0)["rules"]]
    assert rows == [
        ("ROS 2", "it does not cross", "no definition"),
        ("ROS 2", "it starts", ""),
    ]
    station.set_door([])
    assert station.values(1.0)["rules"] == []


def test_a_rule_in_small_segments_is_listed_with_its_reason_and_counts_as_active() -> None:
    station = Station()
    station.robots = [Robot(name="pioneer1", gateway="aadi1_gateway")]
    rule = {"action": "flip", "gateway": "aadi1_gateway", "name": "/tf"}
    station.set_rules(
        [{**rule, "state": "mtu", "reason": "set the MTU"}, {**rule, "state": "active"}]
    )
    shown = station.values(1.0)
    assert [(row["state"], row["reason"]) for row in shown["rules"]] == [("mtu", "set the MTU")]
    assert shown["network"]["aadi1_gateway"]["active"] == 2
    assert "set the MTU" not in station.robot_faults(1.0)["pioneer1"]
