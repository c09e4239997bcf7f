"""Deaths of nodes are reported as JSON lines, each once, with and without the patches of ROS."""

import sys
from pathlib import Path

import pytest

from pioneer_harness.masters import Master
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until
from pioneer_launch.door import REPORT, NodeDeath, deaths_in

# rosmaster runs in this process and leaves connections to nodes that have ended.
pytestmark = pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <socket:pytest.PytestUnraisableExceptionWarning"
)
# A node with a launch-prefix is what that makes of it: these end at once, or stay.
LAUNCH = f"""
<launch>
  <group ns="robot">
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="fails"
          launch-prefix="{sys.executable} -c 'raise SystemExit(3)'"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="again" respawn="true" respawn_delay="0.5"
          launch-prefix="{sys.executable} -c 'import os; os.kill(os.getpid(), 9)'"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="done"
          launch-prefix="{sys.executable} -c 'pass'"/>
    <node pkg="pioneer_ros" type="pioneer_pid_controller" name="stays"/>
  </group>
</launch>
"""


@pytest.mark.parametrize("switch", ["0", "1"])
def test_each_death_is_reported_once_from_the_first_node_on(tmp_path: Path, switch: str) -> None:
    report, file = tmp_path / "deaths.jsonl", tmp_path / "nodes.launch"
    file.write_text(LAUNCH)
    command = ["rosrun", "rocon_launch", "roslaunch", "--no-summary", str(file)]

    def deaths() -> list[NodeDeath]:
        group.check()
        return list(deaths_in(report.read_text())) if report.exists() else []

    with Master() as master, ProcessGroup() as group:
        environment = {**master.environment, REPORT: str(report), "PIONEER_FORK": switch}
        group.start("roslaunch", command, environment, tmp_path / "log")
        wait_until(
            lambda: len([one for one in deaths() if one.name == "robot/again"]) >= 2,
            "the second death of the node that is started again",
            60.0,
        )
        found = deaths()
    failed = [one for one in found if one.name == "robot/fails"]
    again = [one for one in found if one.name == "robot/again"]
    assert [(one.status, one.respawns) for one in failed] == [(3, False)]
    assert {(one.status, one.respawns) for one in again} == {(-9, True)}
    assert len({one.pid for one in again}) == len(again)
    assert {one.name for one in found} == {"robot/fails", "robot/again"}
    assert failed[0].log.endswith("/robot-fails-1*.log")
