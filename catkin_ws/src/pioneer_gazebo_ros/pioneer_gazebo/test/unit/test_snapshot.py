"""The top-down picture shows walls, robots and beam endpoints, each in its place."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import LaserScan

from pioneer_gazebo.commands.plan_image import PAPER, SOLID, WALL, PlanImage, Shown, closed_lines
from pioneer_gazebo.commands.snapshot import ends
from pioneer_gazebo.physics.bullet import BulletEngine
from pioneer_gazebo.physics.engine import EngineError
from pioneer_gazebo.world.pose import Pose
from pioneer_gazebo.world.section import EMPTY, Section


def test_beams_that_met_something_end_there_and_others_nowhere() -> None:
    scan = LaserScan(
        angle_min=-math.pi / 2, angle_increment=math.pi / 2, ranges=[1.0, math.inf, 2.0]
    )
    found = ends(scan, Pose.from_rpy(5.0, 1.0, 0.3, yaw=math.pi / 2))
    np.testing.assert_allclose(found, [[6.0, 1.0], [3.0, 1.0]], atol=1e-9)


def test_walls_and_hits_are_drawn_where_they_are() -> None:
    walls = Section(np.array([[-5.0, -5.0, 10.0, 0.0], [-5.0, 5.0, 10.0, 0.0]]), EMPTY.circles)
    robot = Shown("r", 0.0, 0.0, 0.0, np.empty((0, 4)), np.array([[3.0, 2.0]]), (0.0, 0.0))
    image = PlanImage([walls], [robot], 1101).image
    assert image.size == (1001, 1101) or image.size == (1101, 1101)
    scale = (image.size[1] - 1) / 11.0

    def pixel(x: float, y: float) -> tuple[int, ...]:
        return image.getpixel(
            (round((x + 5.5) * scale), round(image.size[1] - 1 - (y + 5.5) * scale))
        )

    assert pixel(2.0, 5.0) == WALL
    assert pixel(2.0, -5.0) == WALL
    assert pixel(3.0, 2.0) not in (PAPER, WALL)
    assert pixel(-3.0, -2.0) == PAPER


def test_solids_are_filled_and_open_lines_are_not() -> None:
    box = np.array(
        [
            [-3.0, -3.0, 6.0, 0.0],
            [3.0, -3.0, 0.0, 6.0],
            [3.0, 3.0, -6.0, 0.0],
            [-3.0, 3.0, 0.0, -6.0],
        ]
    )
    image = PlanImage(
        [Section(box, EMPTY.circles), Section(EMPTY.segments, np.array([[8.0, 0.0, 1.0]]))], [], 600
    ).image
    scale = (image.size[0] - 1) / 13.0
    for x in (0.0, 8.0):
        assert image.getpixel((round((x + 3.5) * scale), round(image.size[1] / 2))) == SOLID
    assert [len(corners) for corners in closed_lines(box)] == [4]
    assert list(closed_lines(box[:3])) == []


def test_an_empty_world_has_a_picture_too() -> None:
    assert PlanImage([EMPTY], [], 200).image.size == (200, 200)


@pytest.mark.parametrize("display", ["", ":987", "nonsense", ":x"])
def test_a_window_without_a_display_is_refused_in_one_line(
    display: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", display)
    with pytest.raises(EngineError, match="a window needs a display"):
        BulletEngine(window=True)
