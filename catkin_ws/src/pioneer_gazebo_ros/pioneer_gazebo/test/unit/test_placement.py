"""Where a robot can start, and the error for a place where it cannot."""

from pathlib import Path

import pytest

from pioneer_gazebo.fleet.drawn_map import read_map
from pioneer_gazebo.fleet.fleet import DrawnMap, PlacementError, check_place, initial_pose
from pioneer_gazebo.fleet.pose_file import poses_of_world, read_poses

MAPS = Path(__file__).parents[2] / "map"

ROOM = """
??????????
?########?
?#......#?
?#......#?
?#......#?
?########?
??????????
"""


def room() -> DrawnMap:
    rows = ROOM.split()
    values = {"?": 205, "#": 0, ".": 254}
    pixels = bytes(values[cell] for row in rows for cell in row)
    return DrawnMap(-1.0, -2.0, 0.2, len(rows), len(rows[0]), pixels, free=206, occupied=89)


def test_a_robot_can_start_in_free_space() -> None:
    check_place(room(), "pioneer1", 0.0, -1.3, "room")


@pytest.mark.parametrize(
    ("x", "y", "why"),
    [
        (5.0, -1.3, "outside its map, which spans x from -1 to 1 and y from -2 to -0.6 m"),
        (0.0, -0.7, "outside its walls, in unknown space|inside a wall"),
        (-0.5, -1.3, "inside a wall, or less than 0.2 m from one"),
        (-0.7, -1.3, "inside a wall"),
    ],
)
def test_a_place_where_it_cannot_is_named_with_world_and_reason(
    x: float, y: float, why: str
) -> None:
    with pytest.raises(
        PlacementError,
        match=rf"pioneer1 cannot start at \({x:g}, {y:g}\) in the world room: .*({why})",
    ):
        check_place(room(), "pioneer1", x, y, "room")


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_pose_is_one_where_a_robot_can_start(path: Path) -> None:
    drawn = read_map(path)
    assert drawn is not None
    poses = poses_of_world(path.stem)
    content = read_poses(poses)
    if poses.stem == "pioneer_poses" and path.stem not in ("closed_maze", "utm_0", "blank"):
        pytest.fail(f"{path.stem} has no poses of its own")
    for robot in content:
        pose = initial_pose(content, robot, str(poses))
        check_place(drawn, robot, pose.x, pose.y, path.stem)


@pytest.mark.parametrize("path", sorted(MAPS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_readmes_example_goal_is_in_free_space(path: Path) -> None:
    drawn = read_map(path)
    assert drawn is not None
    check_place(drawn, "pioneer1", 1.0, 1.0, path.stem)


def test_the_place_of_pioneer1_in_utm_0_is_outside_small_world() -> None:
    """pioneer_world.launch used to spawn the robot there, outside the walls, without an error."""
    drawn = read_map(MAPS / "small_world.yaml")
    assert drawn is not None
    with pytest.raises(PlacementError, match="small_world"):
        check_place(drawn, "pioneer", -2.0, -10.0, "small_world")
