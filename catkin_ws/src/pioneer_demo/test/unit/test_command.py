"""The commands that are started, where they run, and on which ports."""

import dataclasses
from pathlib import Path

from pioneer_demo.processes.command import Ports, commands
from pioneer_demo.scenario.option import DemoConfig

TUTORIAL = Ports(6380, 11311, 11312, (11313, 11314))


def started(config=None, ports=TUTORIAL):
    return {command.name: command for command in commands(config or DemoConfig(), ports)}


def test_each_robot_has_a_gateway_and_navigation_on_a_master_of_its_own():
    found = started()
    assert list(found)[:3] == ["hub", "Hub_Gateway", "simulator"]
    assert found["aadi2_gateway"].environment["ROS_MASTER_URI"] == "http://127.0.0.1:11314"
    assert found["navigation of pioneer2"].environment["ROS_MASTER_URI"] == "http://127.0.0.1:11314"
    assert found["navigation of pioneer2"].environment["ROBOT_NAME"] == "pioneer2"


def test_gateways_take_their_names_from_hostname_as_in_the_tutorial():
    found = started()
    assert found["aadi1_gateway"].environment["HOSTNAME"] == "aadi1"
    assert not any("gateway_name" in word for word in found["aadi1_gateway"].argv)
    assert "gateway_name:=Hub_Gateway" in found["Hub_Gateway"].argv


def test_every_gateway_gets_this_demos_hub_and_looks_for_no_other():
    ports = dataclasses.replace(TUTORIAL, hub=7380)
    for name in ("Hub_Gateway", "aadi1_gateway"):
        command = started(ports=ports)[name]
        assert command.environment["GATEWAY_HUB_URI"] == "http://127.0.0.1:7380"
        assert "gateway_disable_zeroconf:=true" in command.argv


def test_the_simulator_gets_world_robots_speed_and_seed():
    words = started(DemoConfig(robots=2, world="utm_0", seed=9, real_time_factor=0.0))[
        "simulator"
    ].argv
    assert {"world_name:=utm_0", "robots:=2", "real_time_factor:=0", "seed:=9"} <= set(words)


def test_lockstep_is_asked_of_the_simulator_and_of_each_robot():
    config = DemoConfig(real_time_factor=0.0, lockstep=True)
    found = {command.name: command.argv for command in commands(config, TUTORIAL)}
    rings = "lockstep_rings:=fleet_observer pioneer1 pioneer2"
    assert {"real_time_factor:=lockstep", rings} <= set(found["simulator"])
    assert "real_time_factor:=lockstep" in found["navigation of pioneer2"]
    assert not any("lockstep" in word for command in started().values() for word in command.argv)


def test_the_recorder_gets_the_masters_and_what_it_records():
    config = DemoConfig(record=Path("run.mcap"), record_topics=("/clock", "/tf*"), record_split=9)
    words = started(config)["recorder"].argv
    assert {"hub=http://127.0.0.1:11311", "aadi2=http://127.0.0.1:11314"} <= set(words)
    assert words[-3:] == ("--topics=/clock", "--topics=/tf*", "--split=9")


def test_the_tutorials_ports_are_known_as_such():
    assert TUTORIAL.are_the_tutorials
    assert not dataclasses.replace(TUTORIAL, hub_master=12311).are_the_tutorials
    assert str(TUTORIAL) == "hub 6380, masters: hub 11311, Hub_Gateway 11312, robots 11313, 11314"


def test_the_page_runs_on_the_base_station_and_its_secret_in_no_command_line():
    assert "fleet page" not in started()
    page = started(
        DemoConfig(web=True, token="secret-of-the-page"), dataclasses.replace(TUTORIAL, page=9090)
    )["fleet page"]
    assert page.environment["ROS_MASTER_URI"] == "http://127.0.0.1:11312"
    assert page.environment["PIONEER_WEB_TOKEN"] == "secret-of-the-page"
    assert "_port:=9090" in page.argv
    assert not any("secret" in word for word in page.argv)


def test_the_door_to_ros_2_runs_on_the_base_station_for_the_fleets_robots():
    assert "door to ROS 2" not in started()
    door = started(DemoConfig(ros2=True))["door to ROS 2"]
    assert door.environment["ROS_MASTER_URI"] == "http://127.0.0.1:11312"
    assert door.argv[-3:] == ("pioneer_ros2", "ros2_fleet.launch", "robots:=pioneer1 pioneer2")
