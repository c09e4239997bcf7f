"""The slam_gmapping node: SLAM with the interface of ROS Noetic's gmapping."""

import threading
from collections import Counter

import numpy as np
import rospy
from nav_msgs.msg import MapMetaData
from nav_msgs.srv import GetMapRequest
from std_msgs.msg import Float64

from nav_bundle.base.clock import ClockWatch, Jump
from nav_bundle.base.conversions import ScanMessage, scan_from_message
from nav_bundle.base.error import NavigationError, ObservationError
from nav_bundle.base.pose import Pose
from nav_bundle.base.topics import TransformBroadcaster, TransformListener, robot_frame
from nav_bundle.base.transform import TransformError
from nav_bundle.mapping.config import GmappingConfig
from nav_bundle.mapping.slam import Slam
from nav_bundle.maps.conversions import (
    GetMapArray,
    GetMapArrayResponse,
    GridMessage,
    message_from_grid,
)
from pioneer_node.core.count import counted
from pioneer_node.core.frame import stripped
from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes import entry
from pioneer_node.nodes.standing_warning import StandingWarning

WARNING_PERIOD = 5.0
"""Minimum time [s] between two equal warnings."""


class SlamGmappingNode:
    """Builds a map from laser scans and odometry, and localises the robot in it.

    Subscribes: ``scan`` (sensor_msgs/LaserScan), /tf, /tf_static.

    Publishes: ``map`` (nav_msgs/OccupancyGrid), ``map_metadata`` (nav_msgs/MapMetaData), ``~entropy``
    (std_msgs/Float64), all latched; /tf (map to odom), every ~transform_publish_period, stamped ~tf_delay ahead.

    Services: ``dynamic_map`` (nav_msgs/GetMap): the last map published.

    Parameters: ``GmappingConfig``. ``tf_prefix`` applies to the robot's frames, not to the map's.

    Threads: the callback stores the newest scan; ``spin`` does all the work. A separate thread publishes tf, even while
    a scan is matched (the kernels release the GIL). During a match only the newest scan is kept; no transform is lost.

    On error: scans without transforms are dropped with a warning that names what is missing; an invalid parameter ends
    the node. When simulated time starts again, so does mapping, with an empty map; a clock that is set
    back changes nothing.
    """

    def __init__(self) -> None:
        self._config = config = config_from_mapping(
            GmappingConfig, entry.parameters(), "slam_gmapping"
        )
        self._map_frame = stripped(config.map_frame)
        self._odom_frame, self._base_frame = (
            robot_frame(config.odom_frame),
            robot_frame(config.base_frame),
        )
        self._arrived = threading.Condition()
        self._newest: dict[str, ScanMessage] = {}  # the newest scan of each laser, by its frame
        self._scans = Counter[str]()  #: number of scans so far, by frame
        self._dropping = StandingWarning("scans are used now")
        self._map: GridMessage | None = None
        self._clock = ClockWatch(simulated=not rospy.rostime.is_wallclock())
        self._slam = Slam(config, np.random.default_rng(config.seed))
        self._map_from_odom: Pose | None = None
        self._next_map = -np.inf
        self._listener = TransformListener(future_limit=config.transform_future_limit)
        self._listener.listen(self._odom_frame, self._base_frame)
        self._broadcaster = TransformBroadcaster()
        self._map_publisher = rospy.Publisher("map", GridMessage, queue_size=1, latch=True)
        self._metadata_publisher = rospy.Publisher(
            "map_metadata", MapMetaData, queue_size=1, latch=True
        )
        self._entropy_publisher = rospy.Publisher("~entropy", Float64, queue_size=1, latch=True)
        rospy.Service("dynamic_map", GetMapArray, self._on_dynamic_map)
        if config.transform_publish_period > 0.0:
            period = rospy.Duration.from_sec(config.transform_publish_period)
            rospy.Timer(period, self._broadcast, reset=True)
        self._subscriber = rospy.Subscriber(
            "scan", ScanMessage, self._on_scan, queue_size=5, tcp_nodelay=True
        )
        entry.on_shutdown(self._wake)

    def _on_scan(self, message: ScanMessage) -> None:
        with self._arrived:
            frame = message.header.frame_id
            number = self._scans[frame]
            self._scans[frame] += 1
            if number % self._config.throttle_scans == 0:
                self._newest[frame] = message
                self._arrived.notify()

    def _on_dynamic_map(self, _: GetMapRequest) -> GetMapArrayResponse:
        if self._map is None:
            raise rospy.ServiceException("no map yet: no scan has been used")
        return GetMapArrayResponse(self._map)

    def _wake(self) -> None:
        with self._arrived:
            self._arrived.notify()

    def spin(self) -> None:
        """Processes scans until shutdown."""
        while not rospy.is_shutdown():
            with self._arrived:
                self._arrived.wait_for(lambda: self._newest or rospy.is_shutdown())
                scans = sorted(self._newest.values(), key=lambda scan: scan.header.stamp)
                self._newest.clear()
            for scan in scans:
                self._try(scan)

    def _try(self, scan: ScanMessage) -> None:
        try:
            self._use(scan)
            self._dropping.end()
        except (TransformError, ObservationError) as error:
            if not rospy.is_shutdown():
                self._dropping.warn(f"scans are dropped: {error}")

    def _use(self, message: ScanMessage) -> None:
        self._read_clock()
        stamp = message.header.stamp
        laser, odom = self._listener.place_of_scan(
            message.header, self._odom_frame, self._base_frame
        )
        scan = scan_from_message(message, laser)
        if not self._slam.observe(odom, scan, stamp.to_sec(), message.header.frame_id):
            return
        self._map_from_odom = self._slam.map_from_odom
        if count := self._slam.unmatched:
            rospy.logwarn_throttle(
                WARNING_PERIOD,
                f"{counted(count, 'particle')} found no match for the scan: only odometry moves them",
            )
        if stamp.to_sec() >= self._next_map:
            self._next_map = stamp.to_sec() + self._config.map_update_interval
            self._publish_map(stamp)

    def _read_clock(self) -> None:
        """Reads the clock; when simulated time starts again, so does mapping."""
        jump = self._clock.read(rospy.get_time())
        if jump is not Jump.NONE:
            self._next_map = -np.inf
        if jump is Jump.RESET:
            rospy.logwarn("time jumped back: mapping restarts with an empty map")
            self._slam = Slam(self._config, np.random.default_rng(self._config.seed))
            self._map_from_odom = None

    def _publish_map(self, stamp: rospy.Time) -> None:
        self._map = message_from_grid(self._slam.grid(), self._map_frame, stamp)
        self._map_publisher.publish(self._map)
        self._metadata_publisher.publish(self._map.info)
        self._entropy_publisher.publish(Float64(self._slam.entropy()))

    def _broadcast(self, _: rospy.timer.TimerEvent) -> None:
        """Sends the newest map_from_odom, stamped slightly ahead; the identity until the first scan, as in gmapping."""
        config = self._config
        delay = config.tf_delay if config.tf_delay >= 0.0 else config.transform_publish_period
        pose = self._map_from_odom or Pose()
        ahead = rospy.Time.now() + rospy.Duration.from_sec(delay)
        self._broadcaster.send(self._map_frame, self._odom_frame, ahead, pose)


def main() -> int:
    """Runs the node; returns the exit status."""
    return entry.run("slam_gmapping", SlamGmappingNode, expected=(NavigationError,))
