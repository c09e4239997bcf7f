"""The forwarded topics match the tutorial's; the robot's name is an argument, a variable or the host name."""

import pytest

from rocon_flip.rule_set import (
    RuleSetError,
    Wish,
    advertised_by_hub,
    flipped_by_tools,
    flipped_for_ros2,
    flipped_from_hub,
    flipped_from_robot,
    flipped_topic,
    handshake,
    pulled_from_hub,
    robot_name,
    robot_names,
    topic_in,
)


def test_the_hub_advertises_what_the_robots_pull() -> None:
    assert [wish.name for wish in advertised_by_hub()] == [
        "/clock",
        "/map",
        "/tf",
        "/tf_static",
        "/world_name",
    ]
    assert [(wish.name, wish.gateway) for wish in pulled_from_hub()] == [
        (wish.name, "Hub_Gateway") for wish in advertised_by_hub()
    ]


def test_the_handshake_goes_there_and_back() -> None:
    there, back = handshake("aadi1_gateway")
    assert (there.kind, back.kind, there.gateway, back.gateway) == (
        "publisher",
        "subscriber",
        "aadi1_gateway",
        "aadi1_gateway",
    )
    assert there.name != back.name


def test_a_robot_flips_its_sensors_here_and_its_commands_there() -> None:
    assert flipped_from_robot("pioneer3") == [
        Wish("subscriber", "/pioneer3/base_scan", "", "Hub_Gateway"),
        Wish("subscriber", "/pioneer3/odom", "", "Hub_Gateway"),
        Wish("publisher", "/pioneer3/pioneer/cmd_vel", "", "Hub_Gateway"),
    ]


def test_the_hub_flips_six_topics_a_robot_to_every_node_or_one() -> None:
    wishes = flipped_from_hub(["pioneer1", "pioneer2"])
    assert len(wishes) == 12
    assert {(wish.kind, wish.node) for wish in wishes} == {("subscriber", "")}
    assert Wish("subscriber", "/pioneer2/move_base/NavfnROS/plan", "", "aadi2_gateway") in wishes
    assert Wish("subscriber", "/tf", "", "aadi1_gateway") in wishes
    assert Wish("subscriber", "/tf", "/rviz", "aadi1_gateway") in flipped_from_hub(
        ["pioneer1"], "/rviz"
    )


def test_rvizs_tools_reach_the_robots() -> None:
    assert flipped_by_tools(["pioneer1"]) == [
        Wish("publisher", "/pioneer1/map_goal_pose", "/rviz.*", "aadi1_gateway"),
        Wish("publisher", "/pioneer1/initialpose", "/rviz.*", "aadi1_gateway"),
    ]


def test_a_topic_and_a_gateway_are_enough_for_a_flip() -> None:
    assert flipped_topic("publisher", "map_goal", "aadi1_gateway") == Wish(
        "publisher", "/map_goal", "", "aadi1_gateway"
    )
    assert flipped_topic("publisher", "/map_goal", "aadi1").gateway == "aadi1_gateway"
    assert flipped_topic("subscriber", "odom", "Hub_Gateway").gateway == "Hub_Gateway"


def test_the_number_of_robots_is_an_argument_or_a_variable_or_fifteen() -> None:
    assert robot_names(["3"], {"ROBOTS": "5"}) == ["pioneer1", "pioneer2", "pioneer3"]
    assert len(robot_names([], {"ROBOTS": "5"})) == 5
    assert len(robot_names([], {})) == 15
    for text in ("0", "-1", "3x"):
        with pytest.raises(RuleSetError):
            robot_names([text], {})


def test_robots_of_other_names_and_lasers_have_their_rules() -> None:
    robots = robot_names(["pioneer1", "rover"], {})
    assert Wish(
        "subscriber", "/rover/move_base/NavfnROS/plan", "", "aadi2_gateway"
    ) in flipped_from_hub(robots)
    assert Wish("subscriber", "/rover/scan", "", "Hub_Gateway") in flipped_from_robot(
        "rover", "scan"
    )


def test_the_robots_name_is_an_argument_or_a_variable_or_the_hosts() -> None:
    assert robot_name(["pioneer9"], {"ROBOT_NAME": "pioneer2"}, "aadi1") == "pioneer9"
    assert robot_name([], {"ROBOT_NAME": "pioneer2"}, "aadi1") == "pioneer2"
    assert robot_name([], {}, "aadi12") == "pioneer12"
    assert robot_name([], {"HOSTNAME": "aadi4"}, "laptop") == "pioneer4"
    with pytest.raises(RuleSetError, match="set ROBOT_NAME"):
        robot_name([], {}, "laptop")


def test_a_topic_is_under_its_namespace_unless_it_is_absolute() -> None:
    assert topic_in("pioneer1", "odom") == topic_in("/pioneer1/", "odom") == "/pioneer1/odom"
    assert topic_in("pioneer1", "/tf") == "/tf"
    assert topic_in("", "clock") == "/clock"


def test_the_door_to_ros_2_reads_and_commands_each_robot_at_its_own_gateway() -> None:
    wishes = flipped_for_ros2(["alice", "bob"])
    door = "/ros2_door.*"
    assert Wish("subscriber", "/bob/amcl_pose", door, "aadi2_gateway") in wishes
    assert Wish("publisher", "/alice/map_goal_pose", door, "aadi1_gateway") in wishes
    assert {wish.node for wish in wishes} == {door}
    for wish in wishes:
        robot = {"aadi1_gateway": "alice", "aadi2_gateway": "bob"}[wish.gateway]
        assert wish.name == "/tf" or wish.name.startswith(f"/{robot}/")
