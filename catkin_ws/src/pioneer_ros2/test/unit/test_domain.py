"""Names in DDS, and ROS 2's variables of discovery."""

import pytest

pytest.importorskip("cyclonedds", reason="the door to ROS 2 is not installed")

from pioneer_ros2.dds import configuration
from pioneer_ros2.naming import dds_topic, dds_type, topic_of, type_of


def test_topics_and_types_are_named_as_ros_2_names_them() -> None:
    assert dds_topic("/p1/scan") == "rt/p1/scan"
    assert dds_type("sensor_msgs/LaserScan") == "sensor_msgs::msg::dds_::LaserScan_"
    assert topic_of("rt/p1/scan") == "/p1/scan"
    assert type_of("sensor_msgs::msg::dds_::LaserScan_") == "sensor_msgs/LaserScan"


@pytest.mark.parametrize(
    "name", ["rr/p/describe_parametersReply", "ros_discovery_info", "DCPSParticipant", "rt"]
)
def test_what_is_no_topic_of_ros_has_no_name(name: str) -> None:
    assert topic_of(name) is None


@pytest.mark.parametrize("name", ["a::srv::dds_::B_Request_", "HelloWorld", "a::msg::dds_::B"])
def test_what_is_no_message_of_ros_has_no_type(name: str) -> None:
    assert type_of(name) is None


def test_without_a_variable_only_this_machine_is_reached() -> None:
    assert 'NetworkInterface address="127.0.0.1"' in (configuration({}) or "")
    assert configuration({"ROS_LOCALHOST_ONLY": "1"}) == configuration({})


@pytest.mark.parametrize(
    "environment",
    [
        {"ROS_LOCALHOST_ONLY": "0"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "subnet"},
        {"CYCLONEDDS_URI": "file:///x.xml"},
    ],
)
def test_a_wider_reach_is_cyclone_s_own(environment: dict[str, str]) -> None:
    assert configuration(environment) is None


def test_static_peers_are_listed() -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    assert "<Peers></Peers>" in (configuration(environment) or "")
    peers = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": "192.168.2.5;robot"}
    assert '<Peer address="192.168.2.5"/><Peer address="robot"/>' in (configuration(peers) or "")
