"""Launch files that refer to the original packages run with the overlay."""

import os
import subprocess
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

OVERLAY = Path(__file__).resolve().parents[4] / "overlay"
LAUNCH = """<launch>
  <arg name="model" default="$(find pioneer_description)/urdf/pioneer3dx.xacro"/>
  <include file="$(find gazebo_ros)/launch/empty_world.launch">
    <arg name="world_name" value="worlds/empty.world"/>
    <arg name="gui" value="false"/>
  </include>
  <param name="robot_description" command="$(find xacro)/xacro.py --inorder '$(arg model)'"/>
  <node pkg="gazebo_ros" type="spawn_model" name="spawn" args="-urdf -param robot_description -model r -z 0.1"/>
  <node pkg="joint_state_publisher" type="joint_state_publisher" name="joint_state_publisher"/>
  <node pkg="robot_state_publisher" type="state_publisher" name="robot_state_publisher"/>
  <node pkg="map_server" type="map_server" name="map_server" args="$(find pioneer_gazebo)/map/small_world.yaml"/>
  <node pkg="amcl" type="amcl" name="amcl"/>
  <node pkg="gmapping" type="slam_gmapping" name="slam_gmapping"/>
  <node pkg="move_base" type="move_base" name="move_base"/>
</launch>
"""
NODES = {
    "gazebo",
    "joint_state_publisher",
    "robot_state_publisher",
    "map_server",
    "amcl",
    "slam_gmapping",
    "move_base",
}


def environment() -> dict[str, str]:
    return {
        **os.environ,
        "ROS_PACKAGE_PATH": f"{OVERLAY}:{os.environ.get('ROS_PACKAGE_PATH', '/usr/share')}",
    }


@pytest.mark.parametrize(
    "package", sorted(path.parent.name for path in OVERLAY.glob("*/package.xml"))
)
def test_a_package_is_found_in_the_overlay_and_only_with_it(package: str) -> None:
    found = subprocess.run(
        ["rospack", "find", package], env=environment(), capture_output=True, text=True, check=False
    )
    assert found.stdout.strip() == str(OVERLAY / package)
    without = subprocess.run(
        ["rospack", "find", package], capture_output=True, text=True, check=False
    )
    assert without.stdout.strip() != str(OVERLAY / package)


def test_a_launch_file_of_the_originals_packages_starts_all_its_nodes(tmp_path: Path) -> None:
    file = tmp_path / "published.launch"
    file.write_text(LAUNCH)
    group, master = ProcessGroup(), Master()
    try:
        variables = {
            **master.environment,
            **environment(),
            "ROS_MASTER_URI": master.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(tmp_path),
        }
        group.start("roslaunch", ["roslaunch", str(file)], variables, tmp_path / "roslaunch.log")

        def missing() -> set[str]:
            published, _, services = master.system_state()
            started = {name for name in NODES if f"/{name}/get_loggers" in services}
            return (
                (NODES | {"spawn"})
                - started
                - ({"spawn"} if any("scan" in one for one in published) else set())
            )

        wait_until(lambda: not missing(), f"all nodes; missing: {missing()}", 60)
    finally:
        group.stop()
        master.stop()
