"""The bench of the door to ROS 2: what is carried, and the rows of its results beside their goals."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pioneer_bench.core.row import Row

DOOR, BRIDGE = "door", "rclpy + rospy"
WAYS = (DOOR, BRIDGE)
TRANSFORMS = "tf2_msgs/TFMessage"
UPDATES = "map_msgs/OccupancyGridUpdate"
WITHOUT_RCLPY = (TRANSFORMS, UPDATES)
"""Types for which PyPI has no package of rclpy: the bridge cannot carry them."""
SCAN_GOAL, IMAGE_GOAL = 60.0, 1.0
"""CPU time of the conversion of one message [µs, ms]."""
IDLE_GOAL, FLEET_GOAL = 2.0, 0.08
"""Of the idle door [% of a processor]; with one reader of all topics [CPU-s a second]."""
MEMORY_GOAL = 50.0
"""Private memory [MB]."""
LATENCY_GOAL = 1.0
"""Median latency above that of ROS 1 [ms]."""


@dataclass(frozen=True, slots=True)
class Stream:
    """A topic of ROS 1 and its name in ROS 2."""

    source: str  #: in ROS 1
    target: str  #: in ROS 2
    type_name: str  #: package/Name
    rate: float  #: [Hz]; 0: once, latched
    qos: str = "reliable"  #: reliable, sensor or latched
    own_frames: bool = False  #: whether the robot's prefix is taken off the frames

    @property
    def is_for_rclpy(self) -> bool:
        """Whether rclpy of PyPI has the type."""
        return self.type_name not in WITHOUT_RCLPY


@dataclass(frozen=True, slots=True)
class Received:
    """What one reader in ROS 2 received in one window."""

    messages: float  #: a second
    p50: float  #: median latency [s]
    p99: float  #: 99th percentile of the latency [s]


@dataclass(frozen=True, slots=True)
class Carried(Received):
    """What one reader received, and the cost of carrying it."""

    cost: (
        float  #: CPU time of the carrying process for each message that was published in ROS 1 [s]
    )


@dataclass(frozen=True, slots=True)
class FleetCost:
    """The cost of one carrying process beside a fleet."""

    idle: float  #: without a reader [CPU-s a second]
    read: float  #: with one reader of each topic that both ways carry
    transforms: (
        float | None
    )  #: with transforms and updates of costmaps as well; None: it cannot carry them
    memory: float  #: private, at the end [MB]


def scan_stream() -> Stream:
    """Returns the stream of scans at a rate that loads a processor visibly."""
    return Stream("/robot/base_scan", "/robot/base_scan", "sensor_msgs/LaserScan", 200.0, "sensor")


def image_stream() -> Stream:
    """Returns the stream of images of 1 MB."""
    topic = "/robot/camera/image_raw"
    return Stream(topic, topic, "sensor_msgs/Image", 20.0, "sensor")


def pose_stream() -> Stream:
    """Returns the stream of poses of which the latency is measured."""
    topic = "/robot/move_base/current_goal"
    return Stream(topic, topic, "geometry_msgs/PoseStamped", 50.0)


def fleet_streams(robots: int) -> list[Stream]:
    """Returns the topics of the door's default rules without cameras, at the rates of driving robots."""
    found = [
        Stream("/clock", "/clock", "rosgraph_msgs/Clock", 100.0, "sensor"),
        Stream("/map", "/map", "nav_msgs/OccupancyGrid", 0.0, "latched"),
        Stream("/tf", "/tf", TRANSFORMS, 40.0 * robots),
    ]
    for number in range(1, robots + 1):
        found += _robot_streams(f"/pioneer{number}")
    return found


def _robot_streams(name: str) -> list[Stream]:
    path, grid = "nav_msgs/Path", "nav_msgs/OccupancyGrid"
    base = f"{name}/move_base"
    same = (
        (f"{name}/odom", "nav_msgs/Odometry", 100.0),
        (f"{name}/base_pose_ground_truth", "nav_msgs/Odometry", 20.0),
        (f"{name}/joint_states", "sensor_msgs/JointState", 20.0),
        (f"{name}/amcl_pose", "geometry_msgs/PoseWithCovarianceStamped", 3.0),
        (f"{name}/particlecloud", "geometry_msgs/PoseArray", 3.0),
        (f"{base}/NavfnROS/plan", path, 0.5),
        (f"{base}/TrajectoryPlannerROS/local_plan", path, 20.0),
        (f"{base}/local_costmap/costmap", grid, 5.0),
        (f"{base}/local_costmap/footprint", "geometry_msgs/PolygonStamped", 5.0),
        (f"{base}/global_costmap/costmap_updates", UPDATES, 1.0),
    )
    scan = (f"{name}/base_scan", "sensor_msgs/LaserScan", 10.0)
    return [
        Stream(f"{name}/base_scan", f"{name}/scan", *scan[1:], "sensor", own_frames=True),
        Stream(scan[0], *scan, "sensor"),
        # The transforms of all robots come on one topic.
        Stream("/tf", f"{name}/tf", TRANSFORMS, 40.0),
        *(Stream(topic, topic, type_name, rate) for topic, type_name, rate in same),
    ]


def conversion_rows(what: str, unit: str, scale: float, times: Mapping[str, Sequence[float]],
    goal: float) -> list[Row]:  # fmt: skip
    """Returns the rows of the conversion alone; times in CPU-seconds by way."""
    return [
        Row(
            f"{what}, {way}: conversion alone",
            unit,
            tuple(scale * each for each in times[way]),
            goal if way == DOOR else None,
        )
        for way in WAYS
    ]


def carried_rows(
    what: str, unit: str, scale: float, found: Mapping[str, Sequence[Carried]]
) -> list[Row]:
    """Returns the rows of a stream: what the whole process spends on a message, and how many arrive.

    The goal is the bridge of the same run.
    """
    costs = {way: tuple(scale * each.cost for each in found[way]) for way in WAYS}
    peer = statistics.median(costs[BRIDGE])
    rows = [
        Row(f"{what}, {DOOR}: whole process", unit, costs[DOOR], peer, remark=BRIDGE),
        Row(f"{what}, {BRIDGE}: whole process", unit, costs[BRIDGE]),
    ]
    for way in WAYS:
        arrived = tuple(each.messages for each in found[way])
        rows.append(Row(f"{what}, {way}: arrived", "msg/s", arrived))
    return rows


def fleet_rows(robots: int, found: Mapping[str, Sequence[FleetCost]]) -> list[Row]:
    """Returns the rows of a process beside a fleet."""
    rows = []
    for way in WAYS:
        idle = tuple(100.0 * each.idle for each in found[way])
        goal = IDLE_GOAL if way == DOOR else None
        rows.append(Row(f"{robots} robots, no reader, {way}: CPU", "% of a core", idle, goal))
    for way in WAYS:
        read = tuple(each.read for each in found[way])
        goal = FLEET_GOAL if way == DOOR else None
        rows.append(Row(f"{robots} robots, one reader, {way}: CPU", "CPU-s/s", read, goal))
    every = tuple(each.transforms for each in found[DOOR] if each.transforms is not None)
    what = f"{robots} robots, one reader, transforms too, {DOOR}: CPU"
    rows.append(Row(what, "CPU-s/s", every, FLEET_GOAL))
    for way in WAYS:
        memory = tuple(each.memory for each in found[way])
        goal = MEMORY_GOAL if way == DOOR else None
        rows.append(
            Row(f"{robots} robots, one reader, {way}: memory of its own", "MB", memory, goal)
        )
    return rows


def latency_rows(
    direct: Sequence[Received],
    rclpy: Sequence[Received],
    found: Mapping[str, Sequence[Received]],
    beside: Mapping[str, Sequence[Received]],
) -> list[Row]:
    """Returns the rows of latency.

    Args:
        direct: rospy to rospy, while nothing else runs.
        rclpy: rclpy to rclpy.
        found: rospy to rclpy, by way.
        beside: rospy to rospy in the same windows, by way.
    """
    what = "pose at 50 Hz"
    rows = _latency(f"{what}, rospy to rospy", direct)
    rows += _latency(f"{what}, rclpy to rclpy", rclpy)
    for way in WAYS:
        rows += _latency(f"{what}, rospy to rclpy by {way}", found[way])
    for way in WAYS:
        pairs = list(zip(found[way], beside[way], strict=True))
        over = tuple(1e3 * (each.p50 - straight.p50) for each, straight in pairs)
        goal = LATENCY_GOAL if way == DOOR else None
        rows.append(Row(f"{what}, {way}: p50 above rospy to rospy", "ms", over, goal))
        tail = tuple(1e3 * (each.p99 - straight.p99) for each, straight in pairs)
        rows.append(Row(f"{what}, {way}: p99 above rospy to rospy", "ms", tail))
    return rows


def _latency(what: str, found: Sequence[Received]) -> list[Row]:
    return [
        Row(f"{what}: p50", "ms", tuple(1e3 * each.p50 for each in found)),
        Row(f"{what}: p99", "ms", tuple(1e3 * each.p99 for each in found)),
    ]
