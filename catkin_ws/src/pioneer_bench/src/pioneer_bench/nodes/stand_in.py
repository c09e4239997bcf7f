"""A fleet's topics without a fleet, for the bench of the door: `stand_in JSON`.

JSON is a list of `[TOPIC, TYPE, RATE]`; a rate of 0 is one latched message. Messages have the sizes of driving robots
and are serialised once, so that this node needs little CPU. The stamp in each Header is the monotonic time of sending.
"""

import heapq
import json
import math
import struct
import sys
import time
from collections.abc import Callable
from io import BytesIO
from typing import Any

import genpy
import rospy
from geometry_msgs.msg import Point32, Pose, PoseStamped, TransformStamped
from roslib.message import get_message_class

from pioneer_node.nodes import entry

BEAMS, PARTICLES, CELLS = 180, 500, 60
GLOBAL_PLAN, LOCAL_PLAN = 400, 40
"""Poses in a plan."""
SIDE = 1000
"""Cells on a side of the map."""
WIDTH, HEIGHT = 700, 500
"""Of an image of three bytes a pixel [pixels]."""
_STAMP = struct.Struct("<II")
_STAMP_AT = 4  # after Header.seq


class Raw(rospy.AnyMsg):
    """A message that is already serialised."""


def _scan(message: Any, name: str) -> None:
    message.header.frame_id = f"{name}/laser"
    message.angle_increment = math.tau / BEAMS
    message.range_max = 30.0
    message.ranges = [3.0 + math.sin(number) for number in range(BEAMS)]


def _odometry(message: Any, name: str) -> None:
    message.header.frame_id = f"{name}/odom"
    message.child_frame_id = f"{name}/base_link"


def _joints(message: Any, name: str) -> None:
    message.name = ["base_left_wheel_joint", "base_right_wheel_joint", "base_swivel_joint"]
    message.position = message.velocity = [1.0, 2.0, 3.0]


def _path(count: int, frame: str) -> list[PoseStamped]:
    poses = [PoseStamped() for _ in range(count)]
    for pose in poses:
        pose.header.frame_id = frame
    return poses


def _plan(message: Any, name: str) -> None:
    message.header.frame_id = "map"
    message.poses = _path(GLOBAL_PLAN, "map")


def _local_plan(message: Any, name: str) -> None:
    message.header.frame_id = f"{name}/odom"
    message.poses = _path(LOCAL_PLAN, f"{name}/odom")


def _grid(side: int) -> Callable[[Any, str], None]:
    def fill(message: Any, name: str) -> None:
        message.header.frame_id = f"{name}/odom" if name else "map"
        message.info.width = message.info.height = side
        message.info.resolution = 0.05
        message.data = [0] * (side * side)

    return fill


def _updates(message: Any, name: str) -> None:
    message.header.frame_id = "map"
    message.width = message.height = CELLS
    message.data = [0] * (CELLS * CELLS)


def _particles(message: Any, name: str) -> None:
    message.header.frame_id = "map"
    message.poses = [Pose() for _ in range(PARTICLES)]


def _pose(message: Any, name: str) -> None:
    message.header.frame_id = "map"


def _footprint(message: Any, name: str) -> None:
    message.header.frame_id = f"{name}/odom"
    message.polygon.points = [Point32() for _ in range(4)]


def _image(message: Any, name: str) -> None:
    message.header.frame_id = f"{name}/camera_link"
    message.width = WIDTH
    message.height = HEIGHT
    message.encoding = "rgb8"
    message.step = 3 * WIDTH
    message.data = bytes(3 * WIDTH * HEIGHT)


def _clock(message: Any, name: str) -> None:
    message.clock = rospy.Time(100)


_BY_ENDING: dict[str, Callable[[Any, str], None]] = {
    "/clock": _clock,
    "/map": _grid(SIDE),
    "/base_scan": _scan,
    "/odom": _odometry,
    "/base_pose_ground_truth": _odometry,
    "/joint_states": _joints,
    "/amcl_pose": _pose,
    "/current_goal": _pose,
    "/particlecloud": _particles,
    "/NavfnROS/plan": _plan,
    "/local_plan": _local_plan,
    "/local_costmap/costmap": _grid(CELLS),
    "/local_costmap/footprint": _footprint,
    "/costmap_updates": _updates,
    "/image_raw": _image,
}
"""How to fill a message, by the end of its topic; /tf is apart."""


def _transforms(robot: int) -> list[TransformStamped]:
    """Returns a message's transforms of one robot: odometry and wheels."""
    name = f"pioneer{robot}"
    links = ("base_link", "left_wheel", "right_wheel", "swivel")
    found = [TransformStamped() for _ in links]
    for transform, link in zip(found, links, strict=True):
        transform.header.frame_id = f"{name}/odom" if link == "base_link" else f"{name}/base_link"
        transform.child_frame_id = f"{name}/{link}"
        transform.transform.rotation.w = 1.0
    return found


def _serialised(message: genpy.Message) -> bytearray:
    buffer = BytesIO()
    message.serialize(buffer)
    return bytearray(buffer.getvalue())


def _parts(topic: str, kind: Any, robots: int) -> list[bytearray]:
    """Returns the messages that are sent on a topic in turn, serialised."""
    if topic == "/tf":
        return [_serialised(kind(_transforms(robot))) for robot in range(1, robots + 1)]
    message = kind()
    ending = next(ending for ending in _BY_ENDING if topic.endswith(ending))
    _BY_ENDING[ending](message, topic.split("/")[1] if topic.count("/") > 1 else "")
    return [_serialised(message)]


def serialised_example(topic: str, type_name: str) -> bytes:
    """Returns a message as it is sent on a topic."""
    return bytes(_parts(topic, get_message_class(type_name), 1)[0])


class Topic:
    """One topic, whose messages are sent in turn."""

    def __init__(self, name: str, type_name: str, rate: float, robots: int) -> None:
        kind = get_message_class(type_name)
        raw = type(
            "Raw", (Raw,), {key: getattr(kind, key) for key in ("_type", "_md5sum", "_full_text")}
        )
        self.period = 1.0 / rate if rate else 0.0
        self._message = raw()
        self._has_header = getattr(kind, "_has_header", False)
        self._bodies = _parts(name, kind, robots)
        self._turn = 0
        self._publisher = rospy.Publisher(
            name, raw, latch=not rate, tcp_nodelay=True, queue_size=10
        )
        if not rate:
            self.send()

    def send(self) -> None:
        """Publishes the next message."""
        body = self._bodies[self._turn % len(self._bodies)]
        self._turn += 1
        if self._has_header:
            now = time.monotonic_ns()
            _STAMP.pack_into(body, _STAMP_AT, now // 10**9, now % 10**9)
        self._message._buff = bytes(body)
        self._publisher.publish(self._message)


class StandIn:
    """Publishes all topics at their rates."""

    def __init__(self, streams: list[tuple[str, str, float]]) -> None:
        robots = {name.split("/")[1] for name, _, _ in streams if name.endswith("/odom")}
        self._topics = [Topic(name, kind, rate, len(robots)) for name, kind, rate in streams]

    def spin(self) -> None:
        """Runs until shutdown."""
        now = time.monotonic()
        # Spread over their periods, as the topics of independent nodes are.
        due = [
            (now + topic.period * index / len(self._topics), index)
            for index, topic in enumerate(self._topics)
            if topic.period
        ]
        heapq.heapify(due)
        while not rospy.is_shutdown():
            moment, index = due[0]
            rospy.rostime.wallsleep(max(0.0, moment - time.monotonic()))
            topic = self._topics[index]
            topic.send()
            heapq.heapreplace(due, (max(moment + topic.period, time.monotonic() - 0.1), index))


def main() -> int:
    """Entry point."""
    streams = json.loads(rospy.myargv(sys.argv)[1])
    return entry.run("stand_in", lambda: StandIn(streams))


if __name__ == "__main__":
    sys.exit(main())
