"""Start-up checks: mismatched worlds and start poses outside free space are rejected before anything drives."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import START, wait_until

NAVIGATION = (
    "rosrun",
    "pioneer_gazebo",
    "run-pioneer-nav-local",
    "robot_name:=pioneer1",
    "gateway:=false",
)


@pytest.fixture
def master() -> Iterator[Master]:
    with Master() as one:
        yield one


def ended(master: Master, *command: str) -> tuple[int, str]:
    done = subprocess.run(
        command, env=master.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=START,
        check=False,
    )  # fmt: skip
    return done.returncode, done.stdout


def test_navigation_for_another_world_than_the_base_stations_is_refused(master: Master) -> None:
    master.set_param("/world_name", "closed_maze")
    status, text = ended(master, *NAVIGATION, "world_name:=utm_0")
    assert status == 1
    assert "the base station simulates closed_maze, but this computer was started for utm_0" in text


def test_navigation_takes_world_and_initial_pose_from_the_base_station(
    master: Master, tmp_path: Path
) -> None:
    with ProcessGroup() as group:
        group.start("navigation", NAVIGATION, {**master.environment, "WORLD": ""}, tmp_path / "log")
        awaited = "waiting for the base station's world (step 3)"
        wait_until(lambda: awaited in (tmp_path / "log").read_text(), awaited, START)
        master.set_param("/world_name", "small_world")

        def amcl() -> dict[str, float]:
            parameters = master.get_param("/")
            return parameters.get("pioneer1", {}).get("amcl", {})

        wait_until(lambda: "initial_pose_x" in amcl(), "amcl's initial pose", START)
        assert (amcl()["initial_pose_x"], amcl()["initial_pose_y"]) == (-4.5, 3.5)


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("{x: 0.0, y: 9.0, a: 0.0}", "outside its map"),
        ("{x: -5.4, y: 0.0, a: 0.0}", "inside a wall"),
    ],
)
def test_an_initial_pose_where_no_robot_can_start_is_refused_by_both_steps(
    master: Master, tmp_path: Path, place: str, why: str
) -> None:
    poses = tmp_path / "poses.yaml"
    poses.write_text(f"pioneer1: {place}\n")
    both = ("world_name:=small_world", f"poses:={poses}", "gateway:=false")
    simulation = ("rosrun", "pioneer_gazebo", "run-multi-pioneer-gazebo-master", "robots:=1")
    for command in (NAVIGATION[:-1], simulation):
        status, text = ended(master, *command, *both)
        assert status == 1
        assert "pioneer1 cannot start at (" in text
        assert f"in the world small_world: that is {why}" in text


def test_a_robot_is_not_spawned_outside_the_walls(master: Master, tmp_path: Path) -> None:
    model = tmp_path / "robot.urdf"
    model.write_text("<robot name='r'><link name='base_link'/></robot>")
    spawn = (
        "rosrun",
        "pioneer_gazebo",
        "spawn_model",
        "-urdf",
        "-file",
        str(model),
        "-model",
        "pioneer",
    )
    status, text = ended(master, *spawn, "-world", "small_world", "-x", "-2", "-y", "-10")
    assert status == 1
    assert "pioneer cannot start at (-2, -10) in the world small_world" in text
