"""map_server, amcl and move_base on a map of 4000² cells: how soon they are ready, and the memory they hold."""

import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.srv import GetPlan
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from nav_bundle.adapters.map_file import write_map
from nav_bundle.core.grid import Grid
from nav_bundle.core.pose import Pose
from pioneer_bench.core.room_map import RESOLUTION, room_cells
from pioneer_bench.core.row import Row
from pioneer_harness.masters import Master
from pioneer_harness.proc import process_state
from pioneer_harness.process import ProcessGroup
from pioneer_harness.wait import wait_until

_SIDE = 4000
_PATIENCE = 60.0
_FOOTPRINT = [[0.20, 0.20], [0.20, -0.20], [-0.30, -0.20], [-0.30, 0.20]]
_LASER = {
    "footprint": _FOOTPRINT,
    "transform_tolerance": 2.0,
    "observation_sources": "laser",
    "laser": {"topic": "base_scan", "marking": True, "clearing": True},
    "cost_scaling_factor": 5.0,
}
_AMCL = {
    "use_map_topic": True,
    "min_particles": 500,
    "max_particles": 2000,
    "initial_pose_x": 2.5,
    "initial_pose_y": 2.5,
}
_MOVE_BASE = {
    "global_costmap": {**_LASER, "global_frame": "map", "static_map": True, "inflation_radius": 1.5},
    "local_costmap": {
        **_LASER, "global_frame": "odom", "rolling_window": True, "width": 3.0, "height": 3.0, "inflation_radius": 2.0
    },
}  # fmt: skip


class Robot:
    """Stands at (2.5, 2.5) in a room of the map, and publishes that pose ten times a second."""

    def __init__(self) -> None:
        self.places_odometry = True
        """Says where odometry lies in the map, until amcl does."""
        self._tf = rospy.Publisher("/tf", TFMessage, queue_size=1)
        self._scan = rospy.Publisher("base_scan", LaserScan, queue_size=1)
        self._odom = rospy.Publisher("odom", Odometry, queue_size=1)
        self._timer = rospy.Timer(rospy.Duration(0.1), self._tell)

    def _tell(self, _event: object) -> None:
        now = rospy.Time.now()
        edges = [_edge("odom", "base_link", now), _edge("base_link", "laser", now)]
        if self.places_odometry:
            edges.append(_edge("map", "odom", now, 2.5))
        self._tf.publish(edges)
        odometry = Odometry()
        odometry.header.stamp, odometry.header.frame_id = now, "odom"
        self._odom.publish(odometry)
        bearings = np.linspace(-math.pi, math.pi, 180, endpoint=False)
        wall = 2.475 / np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
        scan = LaserScan(angle_min=-math.pi, angle_max=math.pi, angle_increment=math.tau / 180, range_max=30.0)
        scan.header.stamp, scan.header.frame_id, scan.ranges = now, "laser", wall.tolist()
        self._scan.publish(scan)


def _edge(parent: str, child: str, stamp: rospy.Time, place: float = 0.0) -> TransformStamped:
    edge = TransformStamped(child_frame_id=child)
    edge.header.stamp, edge.header.frame_id = stamp, parent
    edge.transform.translation.x = edge.transform.translation.y = place
    edge.transform.rotation.w = 1.0
    return edge


def _pose(x: float, y: float) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = x, y, 1.0
    return pose


def _megabytes(pid: int) -> float:
    state = process_state(pid)
    return state.rss / 1e6 if state else math.nan


def _cpu(pid: int) -> float:
    state = process_state(pid)
    return state.cpu if state else math.nan


def measured(folder: Path, master: Master, group: ProcessGroup, robot: Robot) -> list[Row]:
    """Starts the three nodes one after the other and returns their rows."""

    def start(name: str, *arguments: str) -> int:
        return group.start(name, ["rosrun", "nav_bundle", name, *arguments], master.environment, folder / name)

    write_map(Grid(RESOLUTION, Pose(), room_cells(_SIDE)), folder / "rooms")
    begun = time.monotonic()
    server = start("map_server", str(folder / "rooms.yaml"))
    rospy.wait_for_message("map", OccupancyGrid, _PATIENCE)
    rows = [
        Row("map_server 4000², start to map received", "s", (time.monotonic() - begun,), 2.0),
        Row("map_server 4000², until then", "CPU s", (_cpu(server),)),
    ]
    master.set_param("/amcl", _AMCL)
    amcl = start("amcl", "scan:=base_scan")
    rospy.wait_for_message("amcl_pose", PoseWithCovarianceStamped, _PATIENCE)
    robot.places_odometry = False
    master.set_param("/move_base", _MOVE_BASE)
    move_base = start("move_base")
    rospy.wait_for_service("move_base/make_plan", _PATIENCE)
    rows.append(Row("move_base 4000², start to ready", "CPU s", (_cpu(move_base),)))
    plan = rospy.ServiceProxy("move_base/make_plan", GetPlan)
    for x, y in ((27.5, 22.5), (120.5, 112.5)):
        path = plan(_pose(2.5, 2.5), _pose(x, y), 0.5).plan.poses
        wait_until(lambda p=path: len(p) > 10, f"a plan to {x}, {y}", _PATIENCE)
    rows.append(Row("map_server 4000²", "MB", (_megabytes(server),)))
    rows.append(Row("amcl 4000²", "MB", (_megabytes(amcl),), 430.0, remark="C++"))
    rows.append(
        Row("move_base 4000², after plans of 35 and 160 m", "MB", (_megabytes(move_base),), 460.0, remark="C++")
    )
    return rows


def main() -> int:
    """Prints the rows, as JSON after ``--json``."""
    with tempfile.TemporaryDirectory(prefix="pioneer-bench-") as folder, Master() as master, ProcessGroup() as group:
        os.environ.update(ROS_MASTER_URI=master.uri, ROS_IP="127.0.0.1", ROS_LOG_DIR=str(Path(folder) / "log"))
        rospy.init_node("big_map", disable_signals=True)
        rows = measured(Path(folder), master, group, Robot())
        rospy.signal_shutdown("done")
    if "--json" in sys.argv:
        print(json.dumps([row.as_dict() for row in rows]))
    else:
        for row in rows:
            goal = "" if row.goal is None else f" (to reach: {row.goal:g})"
            print(f"{row.what}: {row.median:.3g} {row.unit}{goal}")
    return 0 if all(row.holds is not False for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
