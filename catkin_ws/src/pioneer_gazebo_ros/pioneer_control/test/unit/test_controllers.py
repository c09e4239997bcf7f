"""The controllers' configuration uses ros_control's names, the fleet's rate, and joints that the robot has."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import rospkg
import yaml

PACKAGE = Path(__file__).parents[2]
CONTROLLERS = yaml.safe_load((PACKAGE / "config" / "pioneer_control.yaml").read_text())
LAUNCH = ElementTree.parse(PACKAGE / "launch" / "pioneer_control.launch").getroot()


def test_the_spawner_starts_what_is_configured_under_ros_controls_names():
    (spawner,) = LAUNCH.iter("node")
    assert (spawner.get("pkg"), spawner.get("type")) == ("controller_manager", "spawner")
    assert spawner.get("args").split() == list(CONTROLLERS)
    assert (
        CONTROLLERS["joint_state_controller"]["type"]
        == "joint_state_controller/JointStateController"
    )
    assert CONTROLLERS["joint_state_controller"]["publish_rate"] == 50


def test_the_wheels_controllers_have_the_joints_that_the_simulator_drives():
    joints = {values["joint"] for values in CONTROLLERS.values() if "joint" in values}
    urdf = Path(rospkg.RosPack().get_path("pioneer_description")) / "urdf" / "pioneer3dx.xacro"
    assert joints == set(re.findall(r"<(?:left|right)Joint>(\w+)</", urdf.read_text()))
