"""``gui:=true``: pybullet's viewer on a screen, and the simulator that keeps running behind it."""

from pathlib import Path

import numpy as np
import pytest

from pioneer_description.adapters.hidden_rviz import hidden_screen, picture_of
from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

# rosmaster runs in this process and leaves connections to exited nodes open.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)


def test_the_viewer_shows_the_walls_and_time_goes(tmp_path: Path) -> None:
    log = tmp_path / "launch.log"
    (folder := tmp_path / "screen").mkdir()
    with Master() as master, hidden_screen((1024, 768), folder) as screen, ProcessGroup() as group:
        empty = picture_of(screen)
        argv = ["roslaunch", "pioneer_gazebo", "small_world.launch", "gui:=true"]
        group.start("roslaunch", argv, {**master.environment, **screen}, log)

        def drawn() -> bool:
            group.check()
            picture = picture_of(screen)
            changed = (picture != empty).any(axis=2).mean()
            return changed > 0.2 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 50

        wait_until(drawn, "a picture of the world", 90)
        wait_until(
            lambda: "/gazebo/step" in master.system_state()[2], "the simulator's services", 30
        )
        group.check()
