"""Finds the fleet's robots, their true positions, and the extent of the world's map."""

import time
from collections.abc import Callable, Sequence

import rosgraph
import rospy
from gazebo_msgs.msg import ModelStates
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg
from visualization_msgs.msg import Marker, MarkerArray

from pioneer_description.core.fleet_view import NAMES_TOPIC, Bounds, RobotView, known_bounds
from pioneer_description.core.scene import NAME_COLOUR, Point

ROBOT_NAMES = "/robot_names"
"""Parameter set by step 3: the fleet's robots, in the order of their computers."""
LOOK_EVERY = 0.5
"""Polling interval [s]; a picture costs as much as a frame of RViz."""
REPORT_EVERY = 5.0
"""Interval between progress lines [s]."""
_NAME_PIXELS = 15.0
_NAME_HEIGHT = 0.9
"""Height of a name label above the floor [m]."""


class FleetWatch:
    """Finds the fleet of a master.

    Subscribes: ``/gazebo/model_states``, ``/map``.
    Publishes: ``/robot_names/markers`` once, latched: each robot's name, above it.
    Threads: rospy's.
    """

    def __init__(self) -> None:
        self._states = ModelStates()
        self._bounds: Bounds | None = None
        self._master = rosgraph.Master(rospy.get_name())
        self._names = rospy.Publisher(NAMES_TOPIC, MarkerArray, queue_size=1, latch=True)
        rospy.Subscriber("/gazebo/model_states", ModelStates, self._on_states, queue_size=1)
        self._map = rospy.Subscriber("/map", numpy_msg(OccupancyGrid), self._on_map, queue_size=1)

    def _on_states(self, states: ModelStates) -> None:
        self._states = states

    def _on_map(self, grid: OccupancyGrid) -> None:
        cells, corner = (
            grid.data.reshape(grid.info.height, grid.info.width),
            grid.info.origin.position,
        )
        self._bounds = known_bounds(cells, grid.info.resolution, corner.x, corner.y)
        self._map.unregister()

    def positions(self) -> dict[str, Point]:
        """Returns the newest position of each model in the world [m]."""
        states = self._states
        return {
            name: (pose.position.x, pose.position.y)
            for name, pose in zip(states.name, states.pose, strict=True)
        }

    def names(self) -> list[str]:
        """Returns the fleet's robots, whether already spawned or not."""
        if rospy.has_param(ROBOT_NAMES):
            return list(map(str, rospy.get_param(ROBOT_NAMES)))
        prefixes = [
            name.split("/")[1] for name in rospy.get_param_names() if name.endswith("/tf_prefix")
        ]
        return sorted(prefixes, key=lambda name: (len(name), name))

    def lacking(self, wanted: Sequence[str] = ()) -> str:
        """Describes what is still missing before RViz can show the fleet; empty if nothing is.

        Args:
            wanted: robots that must be in the world; by default the fleet's robots.
        """
        names = wanted or self.names()
        if not names:
            return f"robots at {self._master.master_uri} (step 3; ROS_MASTER_URI must be Hub_Gateway's)"
        absent = [name for name in names if name not in self.positions()]
        if absent:
            return f"{', '.join(absent)} in the world (step 3)"
        return "" if self._bounds else "a map on /map (step 3)"

    def wait(self, wanted: Sequence[str], deadline: float, say: Callable[[str], None]) -> str:
        """Waits until nothing is missing, shutdown is requested, or ``deadline`` (monotonic [s]) has passed.

        Reports what is missing through ``say`` when it changes, at most every few seconds.

        Returns:
            What is still missing; empty for nothing.
        """
        told, before = time.monotonic(), ""
        while (
            (lacking := self.lacking(wanted))
            and time.monotonic() < deadline
            and not rospy.is_shutdown()
        ):
            if lacking != before and time.monotonic() > told + REPORT_EVERY:
                told, before = time.monotonic(), lacking
                say(f"waiting for {lacking}")
            rospy.rostime.wallsleep(LOOK_EVERY)
        return lacking

    def robots(self, wanted: Sequence[str] = ()) -> list[RobotView]:
        """Returns the views of the wanted robots (default: all), with their topics and model parameters."""
        scans = [
            topic for topic, kind in rospy.get_published_topics() if kind == "sensor_msgs/LaserScan"
        ]
        return [self._view(name, scans) for name in wanted or self.names()]

    def _view(self, name: str, scans: Sequence[str]) -> RobotView:
        own = [topic for topic in sorted(scans) if topic.startswith(f"/{name}/")]
        laser = own[0] if own else f"/{name}/base_scan"
        model = f"{name}/robot_description"
        return (
            RobotView(name, laser, model)
            if rospy.has_param(f"/{model}")
            else RobotView(name, laser)
        )

    @property
    def bounds(self) -> Bounds:
        """The extent of the world's map; valid after ``wait`` returned an empty string."""
        assert self._bounds is not None, "only after wait"
        return self._bounds

    def name_robots(self, robots: Sequence[RobotView], scale: float) -> None:
        """Labels each robot with its name, at the height of a line of text at ``scale`` [pixels/m]."""
        self._names.publish(
            MarkerArray([_name(number, robot.name, scale) for number, robot in enumerate(robots)])
        )


def _name(number: int, name: str, scale: float) -> Marker:
    marker = Marker(
        ns="names", id=number, type=Marker.TEXT_VIEW_FACING, action=Marker.ADD, frame_locked=True
    )
    marker.header.frame_id = f"{name}/base_link"
    # The empty lines below keep the label above the robot on the screen from any viewpoint.
    marker.text = f"{name}\n \n "
    marker.pose.position.z, marker.pose.orientation.w = _NAME_HEIGHT, 1.0
    marker.scale.z = _NAME_PIXELS / scale
    marker.color.r, marker.color.g, marker.color.b = (part / 255 for part in NAME_COLOUR)
    marker.color.a = 1.0
    return marker
