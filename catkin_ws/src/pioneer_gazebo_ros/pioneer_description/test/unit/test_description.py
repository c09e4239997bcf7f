"""The robot's model matches its interface, and the simulator's URDF reader understands all of it."""

import subprocess
from pathlib import Path

import pytest
import yaml

from pioneer_gazebo.world.robot import Camera
from pioneer_gazebo.world.urdf import robot_from_urdf

PACKAGE = Path(__file__).parents[2]
LINKS = {
    "base_link", "chassis", "top_plate", "front_sonar", "back_sonar", "swivel", "center_wheel", "center_hubcap",
    "left_wheel", "right_wheel", "left_hub", "right_hub", "camera_link", "laser",
}  # fmt: skip
MOVING_JOINTS = {
    "base_left_wheel_joint",
    "base_right_wheel_joint",
    "base_swivel_joint",
    "swivel_hubcap_joint",
}


def expanded(*arguments):
    command = ["xacro", PACKAGE / "urdf" / "pioneer3dx.xacro", *arguments]
    return robot_from_urdf(
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
    )


@pytest.fixture(scope="module")
def robot():
    return expanded()


def test_links_and_moving_joints_are_those_of_the_interface(robot):
    assert {link.name for link in robot.links} == LINKS
    assert {joint.name for joint in robot.joints if joint.kind != "fixed"} == MOVING_JOINTS
    assert robot.warnings == ()


def test_robot_weighs_nine_kilograms(robot):
    assert sum(link.mass for link in robot.links) == pytest.approx(9.0)


def test_drive_is_set_to_the_modelled_wheels(robot):
    (drive,) = robot.drives
    left, right = (robot.link(name).pose.position for name in ("left_wheel", "right_wheel"))
    assert drive.wheelSeparation == pytest.approx(left[1] - right[1])
    assert drive.wheelDiameter == pytest.approx(2 * left[2])
    assert drive.wheelDiameter == pytest.approx(
        2 * robot.link("left_wheel").collisions[0].shape.radius
    )
    assert drive.commandTopic == "pioneer/cmd_vel"


def test_caster_touches_the_floor(robot):
    wheel = robot.link("center_wheel")
    assert wheel.pose.position[2] == pytest.approx(wheel.collisions[0].shape.radius)


def test_body_stays_inside_the_footprint_that_navigation_plans_with(robot):
    for link in robot.links:
        for collision in link.collisions:
            pose = link.pose.compose(collision.pose)
            size = getattr(collision.shape, "size", (0.075, 0.04, 0.075))
            if link.name in ("left_wheel", "right_wheel"):
                size = (0.195, 0.04, 0.195)
            assert pose.position[0] - size[0] / 2 >= -0.30
            assert pose.position[0] + size[0] / 2 <= 0.20
            assert abs(pose.position[1]) + size[1] / 2 <= 0.20


def test_laser_settings_are_arguments():
    robot = expanded("laser_samples:=720", "laser_rate:=40", "camera:=true", "sonar:=true")
    (laser,) = robot.lasers
    assert (laser.samples, laser.update_rate, laser.frame, laser.topic) == (
        720,
        40.0,
        "laser",
        "base_scan",
    )
    assert (laser.min_range, laser.max_range, laser.noise_stddev) == (0.10, 30.0, 0.01)
    assert len(robot.of(Camera)) == 1
    assert len(robot.sonars) == 16


def test_frames_have_no_leading_slash(robot):
    frames = [laser.frame for laser in robot.lasers] + [
        drive.odometryFrame for drive in robot.drives
    ]
    assert not any(frame.startswith("/") for frame in frames)


def test_initial_poses_are_those_of_the_interface():
    poses = yaml.safe_load((PACKAGE / "config" / "pioneer_poses.yaml").read_text())
    given = [
        (-2, -10, 1.57), (-2, 18, -1.57), (5, 1, 0), (21, -11, 3.15), (2.5, -11, 1.57),
        (-3.5, 9.5, 0), (2.5, 19.5, -1.57), (18, -6.5, 0), (18, -0.5, -1.57), (18, 7.5, 1.57),
    ]  # fmt: skip
    for number, pose in enumerate(given, 1):
        assert tuple(poses[f"pioneer{number}"][key] for key in "xya") == pose


@pytest.mark.parametrize("config", ["multi_pioneer.rviz", "pioneer.rviz"])
def test_rviz_configurations_name_frames_without_a_slash(config):
    content = yaml.safe_load((PACKAGE / "rviz" / config).read_text())
    assert content["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"


def test_multi_robot_view_shows_six_things_of_five_robots():
    content = yaml.safe_load((PACKAGE / "rviz" / "multi_pioneer.rviz").read_text())
    groups = {
        d["Name"]: d
        for d in content["Visualization Manager"]["Displays"]
        if d["Class"] == "rviz/Group"
    }
    assert sorted(groups) == [f"pioneer{i}" for i in range(1, 6)]
    for name, group in groups.items():
        assert len(group["Displays"]) == 6
        assert all(d["Topic"].startswith(f"/{name}/") for d in group["Displays"] if "Topic" in d)
