"""The options that a robot's gateway sets for its links when it is started as in the tutorial."""

import pytest
import roslaunch.config
import roslaunch.xmlloader
import roslib.packages

from rocon_gateway.node.config import GatewayConfig
from rocon_gateway.rules.option_rule import rule_for


def _parameters(monkeypatch, robot, *arguments, host=""):
    monkeypatch.setenv("ROBOT_NAME", robot)
    monkeypatch.setenv("HOSTNAME", host)
    config = roslaunch.config.ROSLaunchConfig()
    path = f"{roslib.packages.get_pkg_dir('pioneer_networking')}/launch/pioneer_gateway.launch"
    roslaunch.xmlloader.XmlLoader(resolve_anon=False).load(
        path, config, argv=list(arguments), verbose=False
    )
    return {name: one.value for name, one in config.params.items()}


def _rules(monkeypatch, robot, *arguments):
    rows = _parameters(monkeypatch, robot, *arguments).get("/gateway/rule_options", ())
    rules = GatewayConfig(rule_options=rows).options()
    return lambda topic: rule_for(rules, topic, "/gazebo", "Hub_Gateway", "aadi1_gateway")


def _options(monkeypatch, robot, *arguments):
    rules = _rules(monkeypatch, robot, *arguments)
    return lambda topic: rules(topic).options


def test_time_odometry_and_tf_come_at_20_hz_of_simulated_time_and_scans_as_they_are(monkeypatch):
    options = _options(monkeypatch, "pioneer1")
    topics = (
        "/clock",
        "/tf",
        "/pioneer1/odom",
        "/tf_static",
        "/map",
        "/pioneer1/base_scan",
        "/pioneer1/cmd_vel",
    )
    assert [options(topic).stamp_rate for topic in topics] == [20, 20, 20, 0, 0, 0, 0]
    assert not any(options(topic).rate for topic in topics)
    assert [topic for topic in topics if options(topic).compress] == [
        "/tf",
        "/pioneer1/odom",
        "/pioneer1/base_scan",
    ]


def test_of_other_robots_only_poses_come(monkeypatch):
    keeps = _options(monkeypatch, "pioneer1")("/tf").keeps_frame()
    frames = [
        "pioneer1/odom",
        "pioneer1/left_wheel",
        "pioneer2/odom",
        "/pioneer2/base_link",
        "map",
        "pioneer2/swivel",
    ]
    assert [keeps(frame) for frame in frames] == [True] * 5 + [False]


def test_nothing_comes_of_other_robots_state_publishers(monkeypatch):
    rules = _rules(monkeypatch, "pioneer1")
    topics = ("/tf", "/tf_static", "/clock", "/map")
    assert [rules(topic).foreign_nodes for topic in topics] == [False, False, True, True]


def test_every_message_crosses_for_a_computer_of_no_robot_or_if_so_wanted(monkeypatch):
    assert not _options(monkeypatch, "")("/clock").stamp_rate
    assert not _options(monkeypatch, "pioneer1", "gateway_full_rate:=true")("/clock").stamp_rate


@pytest.mark.parametrize(
    ("host", "name", "namespace"),
    [
        ("aadi3", "", "pioneer3"),
        ("aadi12.robots", "", "pioneer12"),
        ("aadi3", "rover", "rover"),
        ("aadiworkstation", "", ""),
        ("laptop", "", ""),
    ],
)
def test_a_gateway_on_host_aadi3_is_pioneer3s_without_being_told(
    monkeypatch, host, name, namespace
):
    """With the tutorial's steps, robots' gateways used to have no namespace: full rates, and no log on the page."""
    assert _parameters(monkeypatch, name, host=host)["/gateway/namespace"] == namespace
