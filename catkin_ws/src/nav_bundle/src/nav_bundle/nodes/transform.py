"""A tf listener that keeps only the transforms its node asks for, and the names of a robot's frames.

tf2_ros' Python listener unpacks and stores every transform of every robot: at 50 robots most of a core. This one
searches the bytes of /tf for the few edges in use, and unpacks those. Static transforms, few and latched, are all kept.
"""

import threading
import time

import rospy
from geometry_msgs.msg import Transform as TransformMessage
from geometry_msgs.msg import TransformStamped, Vector3
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from nav_bundle.adapters.tf_message import RawTFMessage, StampedTransform, TransformPicker, transforms_of
from nav_bundle.conversions import quaternion_from_yaw
from nav_bundle.core.clock_jump import ClockJump
from nav_bundle.core.pose import Pose
from nav_bundle.core.transform import (
    DisconnectedError,
    ExtrapolationError,
    FrameError,
    Transform,
    TransformError,
    TransformTree,
    frame_fault,
)
from pioneer_node.core.frame import resolved, stripped
from pioneer_node.nodes import entry

_MOST_PAIRS = 512
_WARNING_PERIOD = 5.0


def _warn(text: str) -> None:
    rospy.logwarn_throttle(_WARNING_PERIOD, "%s", text)


def robot_frame(frame: str) -> str:
    """Returns a robot's frame ("odom", "base_link") as it is called in tf.

    It goes under the node's ``tf_prefix`` (found upwards in the parameter tree) unless it already carries it or has a
    leading slash, which is dropped. Do not use it for ``map``: all robots share one.
    """
    key = rospy.search_param("tf_prefix")
    prefix = str(rospy.get_param(key)).strip("/") if key else ""
    return stripped(frame) if frame.startswith(f"{prefix}/") else resolved(prefix, frame)


class TransformListener:
    """Transforms between the frames asked for, from /tf and /tf_static.

    A pair of frames is kept from its first ``lookup``, ``wait`` or ``listen`` on: call ``listen`` early. Of more pairs
    than anybody needs, those asked for longest ago are dropped.
    When time jumps back, all but the static transforms are forgotten, and transforms of the time before that arrive
    late are left out. Thread-safe.

    Subscribes: /tf, /tf_static (tf2_msgs/TFMessage).

    Threads: rospy's subscriber threads insert; ``wait`` is woken by them, without polling.

    On error: a message that does not parse, and a transform that no tree can take or that is stamped more than
        ``future_limit`` ahead of the clock, are dropped with a warning.

    Args:
        keep: history of each edge [s].
        future_limit: how far ahead of the clock a transform may be stamped [s]; one from the far future would pass
            for the newest until then.
    """

    def __init__(self, keep: float = 10.0, future_limit: float = 10.0) -> None:
        self._tree = TransformTree(keep)
        self._picker = TransformPicker(_warn)
        self._future_limit = future_limit
        self._pairs: dict[tuple[str, str], None] = {}
        self._fixed: set[str] = set()
        self._clock = ClockJump()
        self._arrived = threading.Condition()
        # A robot's edges may be published one a message by several nodes: a short queue would lose some.
        self._subscribers = [
            rospy.Subscriber("/tf", RawTFMessage, self._on_transforms, queue_size=100, tcp_nodelay=True),
            rospy.Subscriber("/tf_static", RawTFMessage, self._on_static, queue_size=100),
        ]
        entry.on_shutdown(self._wake)

    def listen(self, target: str, source: str) -> None:
        """Keeps from now on what joins the two frames."""
        with self._arrived:
            self._listen(target, source)

    def lookup(self, target: str, source: str, stamp: float | None = None) -> Transform:
        """Returns target_from_source at ROS time ``stamp`` [s], or at the newest common time when None.

        Raises:
            DisconnectedError: the frames are not joined, perhaps not yet.
            ExtrapolationError: joined, but not at ``stamp``; its ``future`` tells on which side.
        """
        with self._arrived:
            target, source = self._listen(target, source)
            return self._tree.lookup(target, source, stamp)

    def has_fixed(self, frame: str) -> bool:
        """Returns whether /tf_static has told of a frame fixed to this one."""
        with self._arrived:
            return frame in self._fixed

    def latest(self, target: str, source: str) -> float:
        """Returns the newest stamp [s] at which the frames can be joined (inf: static); raises DisconnectedError."""
        with self._arrived:
            target, source = self._listen(target, source)
            return self._tree.latest(target, source)

    def wait(self, target: str, source: str, stamp: float | None, timeout: float) -> Transform:
        """Does what ``lookup`` does, and waits for the transform if it has yet to come.

        Args:
            target: frame the result leads to.
            source: frame the result comes from.
            stamp: ROS time [s], or None for the newest.
            timeout: longest wait [s of wall time: the simulation may be paused].

        Raises:
            TransformError: at the timeout, at shutdown, or at once when ``stamp`` is already forgotten.
        """
        deadline = time.monotonic() + timeout
        with self._arrived:
            target, source = self._listen(target, source)
            while True:
                try:
                    return self._tree.lookup(target, source, stamp)
                except TransformError as error:
                    late = isinstance(error, ExtrapolationError) and not error.future
                    left = deadline - time.monotonic()
                    if late or left <= 0.0 or rospy.is_shutdown():
                        self._watch()  # a frame may have moved to another parent
                        raise
                    self._arrived.wait(left)

    def close(self) -> None:
        """Ends the subscriptions."""
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._wake()

    def _listen(self, *frames: str) -> tuple[str, str]:
        """Keeps the pair (target, source); returns the names as the tree has them."""
        target, source = pair = stripped(frames[0]), stripped(frames[1])
        for frame in pair:
            fault = frame_fault(frame)
            if fault:
                raise FrameError(f"no transform from {source!r} to {target!r}: {fault}")
        known = pair in self._pairs
        self._pairs.pop(pair, None)
        self._pairs[pair] = None
        if not known:
            if len(self._pairs) > _MOST_PAIRS:
                del self._pairs[next(iter(self._pairs))]
            self._watch()
        return pair

    def _watch(self) -> None:
        """Watches the edges between the pairs, and where a pair is not yet joined, the ends of its two chains."""
        children: set[str] = set()
        for target, source in self._pairs:
            try:
                children.update(*self._tree.path(target, source))
            except DisconnectedError:
                children.update(self._tree.chain(target), self._tree.chain(source))
        self._picker.watch(children)

    def _on_transforms(self, message: RawTFMessage) -> None:
        with self._arrived:
            picked = self._picker.pick(message.buffer)
            if picked:
                self._forget_if_time_jumped()
                self._insert([one for one in picked if self._is_timely(one)], static=False)

    def _on_static(self, message: RawTFMessage) -> None:
        with self._arrived:
            records = transforms_of(message.buffer, _warn)
            self._fixed.update(record.parent for record in records)
            self._insert(records, static=True)

    def _is_timely(self, record: StampedTransform) -> bool:
        if self._clock.is_of_before(record.stamp):
            return False
        ahead = record.stamp - self._clock.now
        if ahead <= self._future_limit:
            return True
        if self._clock.now > 0.0:  # before the first /clock every stamp is far ahead
            _warn(
                f"a transform from {record.parent!r} to {record.child!r} was dropped: it is stamped {ahead:.1f} s "
                f"ahead of the clock, more than ~transform_future_limit, {self._future_limit:g} s"
            )
        return False

    def _insert(self, records: list[StampedTransform], static: bool) -> None:
        changes = [self._tree.insert(*record, static=static) for record in records]
        if any(changes):
            self._watch()
        self._arrived.notify_all()

    def _forget_if_time_jumped(self) -> None:
        last, now = self._clock.now, rospy.get_time()
        if self._clock.jumped(now):
            rospy.logwarn("time jumped back from %.3f to %.3f s: transforms forgotten", last, now)
            self._tree.clear()

    def _wake(self) -> None:
        with self._arrived:
            self._arrived.notify_all()


class TransformBroadcaster:
    """Publishes planar transforms on /tf."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("/tf", TFMessage, queue_size=10, tcp_nodelay=True)

    def send(self, parent: str, child: str, stamp: rospy.Time, pose: Pose) -> None:
        """Publishes ``pose``, parent_from_child, at ROS time ``stamp``."""
        body = TransformMessage(Vector3(pose.x, pose.y, 0.0), quaternion_from_yaw(pose.yaw))
        header = Header(0, stamp, stripped(parent))
        self._publisher.publish(TFMessage([TransformStamped(header, stripped(child), body)]))
