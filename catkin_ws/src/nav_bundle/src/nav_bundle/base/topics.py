"""A tf listener that keeps only the transforms its node uses, a broadcaster, and the names of a robot's frames."""

import time
from collections.abc import Sequence

import rospy
from geometry_msgs.msg import Transform as TransformMessage
from geometry_msgs.msg import TransformStamped, Vector3
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from nav_bundle.base.conversions import quaternion_from_yaw
from nav_bundle.base.pose import Pose
from nav_bundle.base.tf_message import RawTFMessage
from nav_bundle.base.transform import ExtrapolationError, FrameNameError, Transform, TransformError
from nav_bundle.base.transform_store import FUTURE_LIMIT, TransformStore
from pioneer_node.core.frame import prefixed, stripped
from pioneer_node.nodes import entry

_WARNING_PERIOD = 5.0
_SCAN_TIMEOUT = 0.5
"""Maximum time [s, wall time] a scan waits for the odometry at its stamp."""


def _warn(text: str) -> None:
    rospy.logwarn_throttle(_WARNING_PERIOD, "%s", text)


def robot_frame(frame: str) -> str:
    """Returns the tf name of a robot's frame ("odom", "base_link").

    Adds the node's ``tf_prefix`` (searched upwards in the parameter tree) unless the name already has it or starts
    with a slash, which is dropped. Do not use it for ``map``, which all robots share.
    """
    key = rospy.search_param("tf_prefix")
    return prefixed(str(rospy.get_param(key)) if key else "", frame)


class TransformListener(TransformStore):
    """Transforms between the requested frames, from /tf and /tf_static; thread-safe.

    Subscribes: /tf, /tf_static (tf2_msgs/TFMessage).

    Threads: rospy's subscriber threads insert transforms and wake ``wait``, which does not poll.

    Args:
        future_limit: how far ahead of the clock a transform may be stamped [s].
    """

    def __init__(self, future_limit: float = FUTURE_LIMIT) -> None:
        super().__init__(rospy.get_time, _warn, future_limit)
        self._mounts: dict[tuple[str, str], Transform] = {}
        # Several nodes may publish a robot's edges, one per message; a short queue would lose some.
        rospy.Subscriber(
            "/tf", RawTFMessage, lambda one: self.take(one.buffer), queue_size=100, tcp_nodelay=True
        )
        rospy.Subscriber(
            "/tf_static", RawTFMessage, lambda one: self.take_static(one.buffer), queue_size=100
        )
        entry.on_shutdown(self.wake)

    def wait(self, target: str, source: str, stamp: float | None, timeout: float) -> Transform:
        """Returns the transform like ``lookup``, but waits for it if it is not available yet.

        Args:
            target: target frame.
            source: source frame.
            stamp: ROS time [s], or None for the newest.
            timeout: maximum wait [s, wall time, since the simulation may be paused].

        Raises:
            TransformError: after the timeout, at shutdown, or immediately if waiting cannot help: ``stamp`` is older
                than the history, or a frame's name is invalid.
        """
        return self.wait_for_any(target, (source,), stamp, timeout)

    def wait_for_any(
        self, target: str, sources: Sequence[str], stamp: float | None, timeout: float
    ) -> Transform:
        """Returns the transform from the first of ``sources`` that has one, waiting like ``wait`` for all of them.

        Raises:
            TransformError: as for ``wait``; the reason is that of the first source.
        """
        deadline = time.monotonic() + timeout
        with self.arrived:
            while True:
                faults = []
                for source in sources:
                    try:
                        return self.lookup(target, source, stamp)
                    except TransformError as error:
                        faults.append(error)
                left = deadline - time.monotonic()
                if all(map(_is_final, faults)) or left <= 0.0 or rospy.is_shutdown():
                    self.watch()  # a frame may have a new parent
                    raise faults[0]
                self.arrived.wait(left)

    def place_of_scan(self, header: Header, odom: str, base: str) -> tuple[Transform, Pose]:
        """Returns base_from_laser and odom_from_base for the scan with this ``header``; waits for each.

        base_from_laser is looked up only once, since lasers do not move.

        Raises:
            TransformError: as for ``wait``.
        """
        mount = base, stripped(header.frame_id)
        if mount not in self._mounts:
            self._mounts[mount] = self.wait(*mount, None, _SCAN_TIMEOUT)
        return self._mounts[mount], self.wait(
            odom, base, header.stamp.to_sec(), _SCAN_TIMEOUT
        ).planar()


def _is_final(error: TransformError) -> bool:
    """Returns whether no later message can provide the transform."""
    if isinstance(error, ExtrapolationError):
        return not error.future
    return isinstance(error, FrameNameError)


class TransformBroadcaster:
    """Publishes planar transforms on /tf."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=10, tcp_nodelay=True)

    def send(self, parent: str, child: str, stamp: rospy.Time, pose: Pose) -> None:
        """Publishes ``pose``, parent_from_child, at ROS time ``stamp``."""
        body = TransformMessage(Vector3(pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))
        header = Header(0, stamp, stripped(parent))
        self._publisher.publish(TFMessage([TransformStamped(header, stripped(child), body)]))
