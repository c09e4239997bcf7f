"""Each shipped world starts from its own launch file; pioneer_world.launch starts a robot without a namespace."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import rospkg
import yaml

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves connections to exited nodes open.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)

PACKAGE = Path(rospkg.RosPack().get_path("pioneer_gazebo"))
PATIENCE = 90.0
"""Timeout [s]: a dozen processes start, possibly on a busy machine."""
WORLDS = sorted(path.stem for path in (PACKAGE / "worlds").glob("*.world"))


class Launched:
    """A launch file that runs on its own ROS master."""

    def __init__(self, master: Master, group: ProcessGroup, folder: Path) -> None:
        self.master, self.group, self.log = master, group, folder / "launch.log"

    def start(self, *words: str) -> None:
        self.group.start(
            "roslaunch", ["roslaunch", "pioneer_gazebo", *words], self.master.environment, self.log
        )

    def run(self, *words: str) -> str:
        return subprocess.run(
            words,
            env=self.master.environment,
            check=True,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        ).stdout

    def offers(self, service: str) -> bool:
        self.group.check()
        return service in self.master.system_state()[2]


@pytest.fixture
def launched(tmp_path: Path) -> Iterator[Launched]:
    with Master() as master, ProcessGroup() as group:
        yield Launched(master, group, tmp_path)


def test_each_world_has_a_launch_file() -> None:
    assert {f"{world}.launch" for world in WORLDS} <= {
        path.name for path in (PACKAGE / "launch").iterdir()
    }
    assert {"closed_maze", "utm_0", "small_world", "willow_office", "blank"} <= set(WORLDS)


@pytest.mark.parametrize("world", WORLDS)
def test_a_world_comes_up_by_its_launch_file_and_time_goes(launched: Launched, world: str) -> None:
    launched.start(f"{world}.launch", "real_time_factor:=0")
    wait_until(lambda: launched.offers("/gazebo/get_world_properties"), "the simulator", PATIENCE)

    def properties() -> dict:
        return yaml.safe_load(launched.run("rosservice", "call", "/gazebo/get_world_properties"))

    found = wait_until(
        lambda: (now := properties())["sim_time"] > 0 and now, "running time", PATIENCE
    )
    assert "ground_plane" in found["model_names"]
    assert (len(found["model_names"]) > 1) == (world != "blank")
    assert f"world {world}:" in launched.log.read_text()


def test_a_robot_without_a_namespace_has_its_topics_at_the_root(launched: Launched) -> None:
    launched.start(
        "pioneer_world.launch", "world_name:=small_world", "x:=-1", "y:=-2", "odometry_scale:=1.5"
    )
    topics = {"/odom", "/base_scan", "/joint_states", "/base_pose_ground_truth"}
    wait_until(
        lambda: topics <= launched.master.system_state()[0].keys(), "the robot's topics", PATIENCE
    )
    wait_until(
        lambda: "/pioneer/cmd_vel" in launched.master.system_state()[1], "the robot's ear", PATIENCE
    )
    assert launched.master.get_param("/gazebo/odometry_scale") == 1.5
    scan = launched.run("rostopic", "echo", "-n1", "--noarr", "/base_scan")
    assert 'frame_id: "laser"' in scan
